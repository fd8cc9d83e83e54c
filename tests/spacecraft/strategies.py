"""Random spacecraft, for property tests."""

import math

import numpy as np
from hypothesis import strategies as st

from thruster_envs.spacecraft import Feed, Sensors, Spacecraft, Thruster

COORDINATES = st.floats(-10.0, 10.0)
TIMES = st.floats(0.0, 5.0)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
DIRECTIONS = st.tuples(COORDINATES, COORDINATES, COORDINATES).filter(lambda vector: math.hypot(*vector) > 0.0)


@st.composite
def inertias(draw):
    """Of bodies that are extended along all three axes, well away from singular, kg m^2."""
    spread = np.array([draw(st.floats(0.01, 100.0)) for _ in range(3)])  # mean squares times mass, per axis
    moments = np.diag(spread.sum() - spread)
    axis = np.array(draw(DIRECTIONS))
    axis /= np.abs(axis).max()  # the square of a tiny vector would underflow
    reflection = np.eye(3) - 2.0 * np.outer(axis, axis) / np.dot(axis, axis)
    matrix = reflection @ moments @ reflection.T
    return tuple(map(tuple, ((matrix + matrix.T) / 2.0).tolist()))


@st.composite
def spacecraft(draw):
    """Any spacecraft that the description accepts."""
    names = draw(st.lists(TEXTS, min_size=1, max_size=5, unique=True))
    propellant = draw(st.just(math.inf) | st.floats(0.0, 9.0))
    impulses = st.just(math.inf) if math.isinf(propellant) else st.just(math.inf) | st.floats(1.0, 4000.0)
    thrusters = tuple(
        Thruster(
            name=name,
            position=draw(st.tuples(COORDINATES, COORDINATES, COORDINATES)),
            direction=draw(DIRECTIONS),
            thrust=draw(st.floats(1e-6, 1e3)),
            minimum_pulse=draw(TIMES),
            opening_delay=draw(TIMES),
            closing_delay=draw(TIMES),
            rise_time=draw(TIMES),
            fall_time=draw(TIMES),
            scatter=draw(st.floats(0.0, 0.99)),
            specific_impulse=draw(impulses),
        )
        for name in names
    )
    return Spacecraft(
        name=draw(TEXTS),
        mass=draw(st.floats(10.0, 1e5)),
        inertia=draw(inertias()),
        thrusters=thrusters,
        feed=Feed(coupling=draw(st.floats(0.0, 1.0)), propellant_mass=propellant),
        sensors=Sensors(position=draw(TIMES), velocity=draw(TIMES), attitude=draw(TIMES), rate=draw(TIMES)),
        control_period=draw(st.floats(1e-3, 100.0)),
        mean_motion=draw(st.floats(1e-6, 1e-2)),
        provenance=draw(st.dictionaries(TEXTS, TEXTS, max_size=3)),
    )
