from __future__ import annotations

import numpy as np
import pytest

from reproductions.yang2003.closed_loop_mappers import ControllerAllocation, NoFiring
from reproductions.yang2003.rendezvous_flights import fly
from reproductions.yang2003.section_6_3_coupling_in_flight import (
    ROOM,
    SHARE,
    compensated,
    followed,
    longer_if,
    plan_on_times,
)
from thruster_baselines.control import RendezvousController
from thruster_baselines.mapping import LPMapper
from thruster_envs.seeds import VALIDATION
from thruster_envs.spacecraft import load

ORION = load("orion")


def test_without_firing_the_orbit_takes_the_craft_out_of_bounds():
    """300 m above the target x = 300 (4 - 3 cos nt): 2000 m are passed well before half an orbit."""
    flights = fly(ORION, NoFiring, VALIDATION[:1])
    assert flights.lost.all()
    assert not flights.success.any()
    np.testing.assert_array_equal(flights.firing_time, 0.0)
    assert (flights.miss > 2000.0).all()
    assert (flights.miss < 2000.0 + 5.0 * flights.speed).all()  # no farther than one period took it


def test_a_flight_does_not_depend_on_its_company():
    together, alone = (fly(ORION, LPMapper, VALIDATION[first:2], orbits=0.05) for first in (0, 1))
    assert together.miss[1] == alone.miss[0]
    assert together.firing_time[1] == alone.firing_time[0]
    assert together.commanded[1] == alone.commanded[0]
    assert (together.firing_time > 100.0).all()


def test_the_reference_row_allocates_as_the_controller():
    mapper, controller = ControllerAllocation(ORION), RendezvousController(ORION, steps=1)
    commands = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 3, 6)) * 0.5 * ORION.authority()
    on_times = mapper(commands).on_times
    assert on_times.shape == (2, 3, 12)
    np.testing.assert_array_equal(on_times[1, 2], controller.allocate(commands[1, 2]))


def test_open_loop_the_loss_is_counted_by_overlap_or_for_all_that_are_used():
    on_times = plan_on_times(SHARE)
    by_overlap, together = followed(on_times), followed(on_times, as_if_together=True)
    assert by_overlap.miss == pytest.approx(821.0, abs=0.1)
    assert together.miss == pytest.approx(841.0, abs=0.1)
    assert by_overlap.lost_by == pytest.approx({2: 0.06, 4: 0.18})
    assert longer_if({2: 0.06, 4: 0.18}) == pytest.approx(0.156, abs=1e-3)


def test_method_2_arrives_if_the_period_has_room_for_it():
    beyond, within = compensated(SHARE, 2.0 * ORION.control_period), compensated(ROOM, ORION.control_period)
    cut = compensated(SHARE, ORION.control_period)
    assert beyond.longest == pytest.approx(4.5 / 0.82, rel=1e-3)  # four together for 4.5 s of thrust each
    assert within.longest <= ORION.control_period
    assert beyond.miss < 2.0
    assert within.miss < 2.0
    assert cut.miss > 300.0  # farther off than it began
