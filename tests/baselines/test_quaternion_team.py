"""The classical team has the gains of the source, and of the environments' own scripted law."""

import numpy as np
import pytest

from thruster_baselines.control import QuaternionTeam
from thruster_envs.pilots.attitude import AttitudePilot
from thruster_envs.spacecraft import load

PPT = load("ppt_cubesat")


def test_gains_are_those_of_table_5_3_and_of_the_scripted_law():
    team, gains = QuaternionTeam(PPT), AttitudePilot.of(PPT).gains
    np.testing.assert_allclose(team.rate_gain, [5.33e-2, 5.486e-2, 5.193e-2], rtol=2e-3)
    np.testing.assert_allclose(team.angle_gain, 2.865e-4, rtol=1e-3)
    np.testing.assert_allclose(team.rate_gain, gains.rate, rtol=1e-14)
    np.testing.assert_allclose(team.angle_gain, gains.angle, rtol=1e-14)
    np.testing.assert_allclose(team.threshold, gains.dead_band, rtol=1e-14)


def test_it_fires_by_the_sign_of_the_torque_outside_of_the_dead_band():
    team = QuaternionTeam(PPT)
    seen = np.zeros((5, 21))
    seen[:, 0] = 1.0
    edge = team.threshold[0] / (2.0 * team.angle_gain[0])  # 2.5 mrad of half an angle
    seen[:, 1] = [0.0, 0.99 * edge, 1.01 * edge, -1.01 * edge, 0.0]
    seen[4, 7:10] = [0.0, 1e3 * 1.01 * team.threshold[1] / team.rate_gain[1], -1.0]
    assert team(seen).tolist() == [[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 2, 1]]
    np.testing.assert_array_equal(team(seen.reshape(5, 1, 21))[:, 0], team(seen))
    duties = QuaternionTeam(PPT, action="duties")(seen)
    assert duties[2].tolist() == [1.0, -1.0, -1.0, -1.0, -1.0, -1.0]
    assert duties[4].tolist() == [-1.0, -1.0, -1.0, 1.0, 1.0, -1.0]


def test_what_it_cannot_fly_is_named():
    with pytest.raises(ValueError, match=r"no thruster of 'orion' turns it about .x; one for each way"):
        QuaternionTeam(load("orion"))
    with pytest.raises(ValueError, match="action is 'torque'; 'pulses' or 'duties' would be right"):
        QuaternionTeam(PPT, action="torque")
