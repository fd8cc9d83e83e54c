"""Random faults, for property tests."""

import math

from hypothesis import strategies as st

from thruster_envs.faults import KINDS, PROFILES, SENSOR_KINDS, SENSORS, Fault

SHARES = st.floats(0.0, 1.0)
LARGEST = {
    "misalignment": math.pi / 2,
    "late_opening": 100.0,
    "propellant_loss": 0.995,
    "electrode_sediment": 0.75,
}


@st.composite
def faults(draw, number_of_craft=3, number_of_thrusters=12):
    """Any fault that a fleet of this size can have."""
    if draw(st.integers(0, 3)) == 0:
        return draw(sensor_faults(number_of_craft))
    kind = draw(st.sampled_from(KINDS))
    return Fault(
        draw(st.integers(1, number_of_thrusters)),
        kind,
        severity=draw(SHARES) * LARGEST.get(kind, 1.0),
        onset=draw(st.floats(0.0, 1e5)),
        duration=draw(st.just(math.inf) | st.floats(1e-3, 1e5)),
        profile="step" if kind == "intermittent" else draw(st.sampled_from(PROFILES)),
        profile_time=draw(st.floats(1e-3, 1e4)),
        dwell=draw(st.floats(0.01, 1.0)),
        azimuth=draw(st.floats(-10.0, 10.0)),
        craft=draw(st.integers(1, number_of_craft)),
        shared=draw(st.booleans()),
    )


@st.composite
def sensor_faults(draw, number_of_craft=3):
    """Any fault of a sensor."""
    kind = draw(st.sampled_from(SENSOR_KINDS))
    return Fault(
        sensor=draw(st.sampled_from(SENSORS)),
        axis=draw(st.integers(0, 3)),
        kind=kind,
        severity=1.0 if kind == "freeze" else draw(SHARES),
        onset=draw(st.floats(0.0, 1e5)),
        duration=draw(st.just(math.inf) | st.floats(1e-3, 1e5)),
        profile=draw(st.sampled_from(("step", "intermittent") if kind == "freeze" else PROFILES)),
        profile_time=draw(st.floats(1e-3, 1e4)),
        dwell=draw(st.floats(0.01, 1.0)),
        craft=draw(st.integers(1, number_of_craft)),
    )
