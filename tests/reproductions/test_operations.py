"""Operations of a solve follow from its pivots."""

import numpy as np

from reproductions.yang2003.operations import count
from thruster_baselines.mapping import LPMapper
from thruster_envs.spacecraft import load


def test_each_change_of_basis_touches_the_whole_tableau_once():
    commands = np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 6)) * load("orion").authority()
    counted = count(LPMapper("orion"), commands)
    assert counted.arithmetic.shape == (2000,)
    # 2 (m + 1)(n + m) operations and the lesser parts
    slope = np.polyfit(counted.pivots + 1e-9 * counted.flips, counted.arithmetic, 1)[0]
    assert 2 * 7 * 18 < slope < 2 * 7 * 18 + 150
