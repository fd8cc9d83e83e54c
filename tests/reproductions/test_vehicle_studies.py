"""What the studies of Orion and SPHERES measure with, checked by hand and by an independent solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from reproductions.yang2003.fig_4_coupling_loss import fire
from reproductions.yang2003.section_6_3_nominal_firing import REPORTED_ON_TIMES, range_of_optima
from reproductions.yang2003.section_6_3_redundancy import NAMES, authority, kept_by_mapper
from reproductions.yang2003.spheres_loop import LOOP_PERIOD, SPHERES, regulate
from reproductions.yang2003.table_3_spheres_accuracy import AUTHORITY, reachable_commands
from thruster_baselines.mapping import LPMapper
from thruster_envs.spacecraft import load

ORION = load("orion")


def test_a_healthy_orion_has_the_authority_of_its_description_each_way():
    assert authority(()) == pytest.approx(np.tile(ORION.authority(), 2), rel=1e-6)


def test_two_opposed_losses_take_away_the_translation_that_they_share():
    left = dict(
        zip(NAMES, authority((0, 9)), strict=True)
    )  # thrusters 1 and 10, the only two that push to -x
    assert left["-x"] == pytest.approx(0.0, abs=1e-9)
    assert left["+x"] == pytest.approx(0.03, rel=1e-6)
    assert dict(zip(NAMES, kept_by_mapper((0, 9)), strict=True)) == {name: name != "-x" for name in NAMES}


def test_more_firing_than_the_least_leaves_room_for_other_on_times():
    least, most = range_of_optima(18.0)
    assert least == pytest.approx(REPORTED_ON_TIMES, abs=1e-6)
    assert most == pytest.approx(REPORTED_ON_TIMES, abs=1e-6)
    assert (range_of_optima(20.0)[1] - range_of_optima(20.0)[0]).max() > 0.1


def test_firings_scatter_from_one_to_the_next():
    shares = fire(np.ones((3, 4, 12)))
    assert shares.shape == (3, 4, 12)
    assert len(np.unique(shares)) == shares.size
    assert np.abs(shares / 0.34 - 1.0).max() <= 0.1  # all twelve open: 1 - 11 * 0.06


@pytest.mark.parametrize("axes", [1, 3, 6])
def test_commands_that_count_as_reachable_are(axes):
    scale = AUTHORITY[:, np.newaxis]
    for command in reachable_commands(np.random.default_rng(axes), 20, axes):
        assert np.count_nonzero(command) == axes
        answer = linprog(
            np.ones(12),
            A_eq=SPHERES.effectiveness() / scale,
            b_eq=command / AUTHORITY,
            bounds=(0.0, LOOP_PERIOD),
        )
        assert answer.status == 0


def test_the_loop_comes_to_rest():
    flown = regulate(LPMapper(SPHERES, max_on_time=LOOP_PERIOD), craft=3, seconds=120.0)
    assert np.abs(flown.final).max() < 1e-8
    assert flown.commands.shape == (2400, 3, 6)
    assert np.abs(flown.commands[-1]).max() < 1e-8
    assert flown.deviation.max() < 1e-9
