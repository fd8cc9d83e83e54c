"""Which kinds of fault a fleet takes: those that its spacecraft can have and that what flies it knows."""

import pytest

from thruster_envs.faults import DISCHARGE_KINDS, GENERAL_KINDS, KINDS, Fault, FaultDistribution
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import load

ORION, CUBESAT = load("orion"), load("ppt_cubesat")


@pytest.mark.parametrize("kind", DISCHARGE_KINDS)
def test_no_fault_of_a_discharge_strikes_a_craft_without_one(kind):
    for source in ([Fault(1, kind, severity=0.1)], FaultDistribution(kinds=(kind,))):
        for kinds in (GENERAL_KINDS, KINDS):
            with pytest.raises(
                ValueError, match=f"kind '{kind}' is a fault of a discharge, and 'orion' has none"
            ):
                Fleet(ORION, 1, kinds=kinds).plan(source)


def test_a_fleet_refuses_kinds_that_what_flies_it_does_not_know():
    with pytest.raises(ValueError, match="kind 'propellant_loss' has no meaning here; one of stuck_off"):
        Fleet(CUBESAT, 1).plan([Fault(1, "propellant_loss", severity=0.1)])
    with pytest.raises(ValueError, match="kind 'leak' has no meaning here; one of propellant_loss"):
        Fleet(CUBESAT, 1, kinds=DISCHARGE_KINDS).plan([Fault(1, "leak")])
    faults = [Fault(number + 1, kind, severity=0.1) for number, kind in enumerate(DISCHARGE_KINDS)]
    assert Fleet(CUBESAT, 1, kinds=KINDS).plan(faults).rows[0, :3, 0].tolist() == [8, 9, 10]


def test_only_thrusters_on_one_capacitor_share_a_fault():
    for source in ([Fault(1, "loss", shared=True)], FaultDistribution(shared=True)):
        with pytest.raises(
            ValueError, match="shared is True, and here no thrusters of 'orion' share a capacitor"
        ):
            Fleet(ORION, 1, kinds=KINDS).plan(source)
        with pytest.raises(ValueError, match="shared=False would be right"):
            Fleet(CUBESAT, 1).plan(source)
        Fleet(CUBESAT, 1, kinds=KINDS).plan(source)
