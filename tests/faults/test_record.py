"""What a fault can be, and what it cannot."""

import copy
import dataclasses
import json
import math
import pickle
import re

import pytest
from hypothesis import given

from tests.faults.strategies import faults
from thruster_envs.faults import (
    DISCHARGE_KINDS,
    FULL_SCALE,
    GENERAL_KINDS,
    KINDS,
    MODULATOR_KINDS,
    PROFILES,
    SENSOR_KINDS,
    SENSORS,
    THRUSTER_KINDS,
    Fault,
    FaultDistribution,
    as_faults,
    decode,
    encode,
)
from thruster_envs.faults.kinds import ACTUATOR_TABLE, SENSOR_TABLE


def test_kinds_and_profiles_keep_their_order_since_it_is_their_code():
    assert GENERAL_KINDS == (
        "stuck_off", "stuck_on", "loss", "leak", "misalignment", "late_opening", "intermittent",
    )  # fmt: skip
    assert DISCHARGE_KINDS == ("propellant_loss", "electrode_sediment", "conductivity_loss")
    assert MODULATOR_KINDS == ("slow_opening",)
    assert KINDS[:13] == (*GENERAL_KINDS, *DISCHARGE_KINDS, *MODULATOR_KINDS, "sign", "bias")
    assert (*GENERAL_KINDS, "sign", "bias") == THRUSTER_KINDS
    assert SENSOR_KINDS == ("bias", "drift", "scale", "freeze", "spike", "drop_out")
    assert SENSORS == ("position", "velocity", "attitude", "rate")
    assert PROFILES == ("step", "ramp", "sine", "intermittent")


WORST = {"propellant_loss": 0.995, "electrode_sediment": 0.75}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_can_be_had_by_its_name_alone(kind):
    fault = Fault(1, kind)
    assert fault.severity == WORST.get(kind, 1.0)
    assert type(fault.severity) is float
    mapping = {"thruster": 1, "kind": kind}
    assert as_faults(mapping) == as_faults([mapping]) == as_faults(fault) == as_faults([fault]) == (fault,)
    assert as_faults(json.loads(json.dumps(dataclasses.asdict(fault)))) == (fault,)
    assert decode(encode([fault], 1, 8, slots=2, wheels=1, gyros=1)) == [fault]
    for again in (pickle.loads(pickle.dumps(fault)), copy.deepcopy(fault), dataclasses.replace(fault)):
        assert again == fault
        assert hash(again) == hash(fault)
    low, high = FaultDistribution(kinds=(kind,)).severity[kind]
    assert (
        Fault(1, kind, severity=low).severity <= Fault(1, kind, severity=high).severity <= fault.severity * 2
    )


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("kind", SENSOR_KINDS)
def test_every_kind_of_a_sensor_can_be_had_by_its_name_alone(kind, sensor):
    fault = Fault(sensor=sensor, kind=kind)
    assert (fault.thruster, fault.axis) == (0, 0)
    assert fault.severity > 0.0
    mapping = {"sensor": sensor, "kind": kind}
    assert as_faults(mapping) == as_faults([mapping]) == as_faults(fault) == (fault,)
    assert as_faults(json.loads(json.dumps(dataclasses.asdict(fault)))) == (fault,)
    assert decode(encode([fault], 1, 8, slots=2, wheels=1, gyros=1)) == [fault]
    for again in (pickle.loads(pickle.dumps(fault)), copy.deepcopy(fault), dataclasses.replace(fault)):
        assert again == fault
        assert hash(again) == hash(fault)
    low, high = FaultDistribution().sensor_severity[sensor][kind]
    assert Fault(sensor=sensor, kind=kind, severity=low).severity <= high


def test_errors_of_a_sensor_have_a_sign():
    for kind in ("bias", "drift", "scale"):
        assert Fault(sensor="rate", kind=kind, severity=-0.5).severity == -0.5
    for kind in ("spike", "drop_out", "freeze"):
        with pytest.raises(ValueError, match=f"severity of a '{kind}' fault of the rate sensor must be"):
            Fault(sensor="rate", kind=kind, severity=-0.5)


def test_an_actuator_is_another_name_of_a_thruster():
    fault = Fault(actuator=3, kind="loss", severity=0.5)
    assert fault == Fault(3, "loss", severity=0.5)
    assert fault.actuator == fault.thruster == 3
    assert dataclasses.replace(fault, thruster=5) == Fault(5, "loss", severity=0.5)
    with pytest.raises(ValueError, match="thruster and actuator are two names of one number; only one"):
        Fault(1, "loss", actuator=2)


def test_the_docstring_says_what_each_severity_means():
    for table in (ACTUATOR_TABLE, SENSOR_TABLE):
        for one in table:
            assert f"- `{one.name}`: {one.meaning}." in Fault.__doc__


def test_fault_is_total_at_once_and_for_good_unless_told_otherwise():
    fault = Fault(1, "stuck_off")
    assert (fault.severity, fault.onset, fault.duration, fault.profile) == (1.0, 0.0, math.inf, "step")
    assert fault == Fault(thruster=1, kind="stuck_off", craft=1)


def test_intermittent_fault_comes_and_goes():
    assert Fault(1, "intermittent").profile == "intermittent"
    assert Fault(1, "intermittent").profile_time == 20.0
    assert Fault(1, "intermittent", profile_time=3.0).profile_time == 3.0


def test_every_kind_has_a_full_scale():
    assert set(FULL_SCALE) == set(KINDS)
    assert (FULL_SCALE["loss"], FULL_SCALE["misalignment"], FULL_SCALE["late_opening"]) == (
        1.0,
        math.pi / 2,
        5.0,
    )


def test_faults_are_values():
    assert len({Fault(1, "loss", severity=0.5), Fault(1, "loss", severity=0.5), Fault(2, "loss")}) == 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        Fault(1, "loss").severity = 0.1
    with pytest.raises(TypeError):
        Fault(1, "loss", 0.5)


@given(faults())
def test_faults_survive_json(fault):
    assert as_faults(json.loads(json.dumps(dataclasses.asdict(fault)))) == (fault,)


BAD = {
    "thruster from 0": ({"thruster": 0}, "thruster is 0; a number from 1 would be right"),
    "half a thruster": ({"thruster": 1.5}, "thruster is 1.5; a whole number would be right"),
    "craft from 0": ({"craft": 0}, "craft is 0; a number from 1 would be right"),
    "unknown kind": ({"kind": "stuck_of"}, "kind 'stuck_of' is unknown; did you mean 'stuck_off'?"),
    "unlike any kind": ({"kind": "xyzzy"}, "kind 'xyzzy' is unknown; known are stuck_off, stuck_on, loss"),
    "unknown profile": ({"profile": "rampp"}, "profile 'rampp' is unknown; did you mean 'ramp'?"),
    "share above 1": ({"severity": 1.5}, "severity of a 'stuck_off' fault is 1.5; a share from 0 to 1"),
    "negative share": ({"severity": -0.1}, "severity of a 'stuck_off' fault is -0.1; a share from 0 to 1"),
    "NaN severity": ({"severity": math.nan}, "severity is NaN; a number would be right"),
    "tilt beyond a right angle": (
        {"kind": "misalignment", "severity": 1.6},
        "severity of a 'misalignment' fault is 1.6; an angle from 0 to pi/2 rad would be right",
    ),
    "never opening": (
        {"kind": "late_opening", "severity": math.inf},
        "severity of a 'late_opening' fault is inf; a finite number of s, zero or more",
    ),
    "no slug left": (
        {"kind": "propellant_loss", "severity": 1.0},
        "severity of a 'propellant_loss' fault is 1.0; a share from 0 to 0.995 would be right",
    ),
    "no width left": (
        {"kind": "electrode_sediment", "severity": 0.8},
        "severity of a 'electrode_sediment' fault is 0.8; a share from 0 to 0.75 would be right",
    ),
    "broken wire": (
        {"kind": "conductivity_loss", "severity": 2.0},
        "severity of a 'conductivity_loss' fault is 2.0; a resistance from 0 to 1 ohm would be right",
    ),
    "never following": (
        {"kind": "slow_opening", "severity": 1e5},
        "severity of a 'slow_opening' fault is 100000.0; a time from 0 to 10000 s would be right",
    ),
    "over when it begins": (
        {"onset": 1e16, "duration": 1.0},
        "duration must be at least 2 s with an onset of 1e+16 s, got 1 s",
    ),
    "wave of no length": (
        {"profile": "sine", "profile_time": 1e-300},
        "profile_time must be at least 1e-06 s, got 1e-300 s",
    ),
    "thruster of 401 digits": (
        {"thruster": 10**400},
        f"thruster must be a whole number of 64 bits, got 1{'0' * 76}...",
    ),
    "craft of 5000 digits": (
        {"craft": 10**5000},
        "craft must be a whole number of 64 bits, got <int of 16610",
    ),
    "onset beyond floats": ({"onset": 10**400}, "onset must be within +/-1.8e+308, got 1000"),
    "kind of a book": ({"kind": "k" * 10**6}, f"kind '{'k' * 76}... is unknown; known are stuck_off"),
    "no kind": ({"kind": None}, "kind is None; a value of type str would be right"),
    "list of kinds": ({"kind": ["loss"]}, "kind is ['loss']; a value of type str would be right"),
    "half shared": ({"shared": 0.5}, "shared is 0.5; a value of type bool would be right"),
    "negative onset": ({"onset": -1.0}, "onset is -1.0; a finite number of s, zero or more"),
    "no onset": ({"onset": math.inf}, "onset is inf; a finite number of s"),
    "no duration": ({"duration": 0.0}, "duration is 0.0; a positive number of s, or inf"),
    "ramp without a time": (
        {"profile": "ramp"},
        "profile_time of a 'ramp' profile is 0.0; a positive number of s would be right",
    ),
    "sine without a time": ({"profile": "sine"}, "profile_time of a 'sine' profile is 0.0"),
    "wave without a time": ({"profile": "intermittent"}, "profile_time of a 'intermittent' profile is 0.0"),
    "negative time": ({"profile_time": -1.0}, "profile_time is -1.0; a finite number of s, zero or more"),
    "intermittent with a ramp": (
        {"kind": "intermittent", "profile": "ramp", "profile_time": 1.0},
        "profile is 'ramp'; 'intermittent', as the kind is, would be right",
    ),
    "no dwell": ({"dwell": 0.0}, "dwell is 0.0; a share above 0 and up to 1 would be right"),
    "dwell above 1": ({"dwell": 1.1}, "dwell is 1.1; a share above 0 and up to 1"),
    "thruster and sensor": (
        {"sensor": "rate", "kind": "bias"},
        "a fault must be of a thruster or of a sensor, got thruster 1 and sensor 'rate'",
    ),
    "fourth axis": (
        {"thruster": 0, "sensor": "rate", "kind": "bias", "axis": 4},
        "axis must be 1, 2 or 3, or 0 for all three, got 4",
    ),
    "axis of a thruster": ({"axis": 2}, "axis must be 0 where no sensor is given, got 2"),
    "kind of a sensor": (
        {"kind": "drop_out"},
        "kind 'drop_out' is a fault of a sensor; of an actuator it must be one of stuck_off, stuck_on",
    ),
    "kind of a thruster": (
        {"thruster": 0, "sensor": "rate", "kind": "leak"},
        "kind 'leak' is a fault of an actuator; of the rate sensor it must be one of bias, drift, scale",
    ),
    "no sensor": (
        {"thruster": 0, "sensor": "ratee", "kind": "bias"},
        "sensor 'ratee' is unknown; did you mean 'rate'?",
    ),
    "turned too far": (
        {"thruster": 0, "sensor": "attitude", "kind": "bias", "severity": 4.0},
        "severity of a 'bias' fault of the attitude sensor must be from -3.142 to 3.142 rad, got 4.0",
    ),
    "frozen in part": (
        {"thruster": 0, "sensor": "rate", "kind": "freeze", "severity": 0.5},
        "severity of a 'freeze' fault of the rate sensor must be 1, all of the measurement, got 0.5",
    ),
    "frozen by and by": (
        {"thruster": 0, "sensor": "rate", "kind": "freeze", "profile": "ramp", "profile_time": 1.0},
        "profile of a 'freeze' fault must be 'step' or 'intermittent', got 'ramp'",
    ),
    "sensor on a capacitor": (
        {"thruster": 0, "sensor": "rate", "kind": "bias", "shared": True},
        "shared must be False for a fault of a sensor, got True",
    ),
    "infinite azimuth": ({"azimuth": math.inf}, "azimuth is inf; a finite number of rad would be right"),
}


@pytest.mark.parametrize(("changes", "message"), BAD.values(), ids=BAD.keys())
def test_impossible_faults_are_refused_in_one_clear_line(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        Fault(**{"thruster": 1, "kind": "stuck_off", **changes})
    assert "\n" not in str(refusal.value)
