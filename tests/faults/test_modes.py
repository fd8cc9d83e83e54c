"""Kinds and severities of faults fall into the modes that the table says."""

import pytest

from thruster_envs.faults import KINDS, MODES, mode_of
from thruster_envs.faults.kinds import GYRO_KINDS, WHEEL_KINDS

TABLE = [
    ("stuck_off", 1.0, "dead"),
    ("stuck_off", 0.9, "dead"),
    ("loss", 0.95, "dead"),
    ("intermittent", 1.0, "dead"),
    ("stuck_off", 0.89, "weak"),
    ("loss", 0.5, "weak"),
    ("loss", 0.49, "slightly weak"),
    ("intermittent", 0.1, "slightly weak"),
    ("leak", 0.1, "leaking"),
    ("stuck_on", 0.49, "leaking"),
    ("leak", 0.5, "stuck open"),
    ("stuck_on", 1.0, "stuck open"),
    ("misalignment", 0.1, "tilted or late"),
    ("late_opening", 3.0, "tilted or late"),
    ("electrode_sediment", 0.15, "tilted or late"),
    ("slow_opening", 0.3, "tilted or late"),
    ("sign", 1.0, "tilted or late"),
    ("bias", 0.3, "leaking"),
    ("bias", 0.5, "stuck open"),
    ("propellant_loss", 0.99, "weak"),
    ("propellant_loss", 0.98, "slightly weak"),
    ("conductivity_loss", 0.4, "dead"),
    ("conductivity_loss", 0.05, "weak"),
    ("conductivity_loss", 0.01, "slightly weak"),
]


@pytest.mark.parametrize(("kind", "severity", "mode"), TABLE)
def test_a_fault_has_the_mode_of_the_table(kind, severity, mode):
    assert MODES[mode_of(kind, severity)] == mode


def test_every_kind_has_a_mode_and_every_mode_a_kind():
    assert {kind for kind, _, _ in TABLE} == set(KINDS) - set(WHEEL_KINDS + GYRO_KINDS)
    assert {mode for _, _, mode in TABLE} == set(MODES)


def test_what_is_no_fault_has_no_mode():
    with pytest.raises(ValueError, match="leak"):
        mode_of("leek", 0.5)
    with pytest.raises(ValueError, match="a share from 0 to 1"):
        mode_of("leak", 1.5)
