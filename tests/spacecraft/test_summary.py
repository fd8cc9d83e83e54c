"""What is said of a spacecraft: authority, what a thruster is worth, pairs, stores of momentum."""

import numpy as np
import pytest

from thruster_envs.commands import main
from thruster_envs.spacecraft import ControlMomentGyro, ReactionWheel, catalogue, describe, load


def with_copies(*, strength):
    """Orion with a thirteenth thruster where the first is."""
    orion = load("orion").to_dict()
    first = orion["thrusters"][0]
    copy = first | {"name": "copy", "thrust": strength * first["thrust"]}
    return load(orion | {"thrusters": (*orion["thrusters"], copy)})


@pytest.mark.parametrize("name", catalogue())
def test_the_larger_sign_is_the_authority_and_losses_of_all_thrusters_are_the_whole(name):
    summary, craft = describe(name), load(name)
    np.testing.assert_allclose(summary.authority.max(axis=0), craft.authority(), rtol=1e-14)
    there = (summary.authority > 0.0).astype(float)
    np.testing.assert_allclose(summary.loss.sum(axis=0), there, rtol=0.0, atol=1e-14)
    assert summary.rank == np.linalg.matrix_rank(craft.wrenches())


@pytest.mark.parametrize("name", catalogue())
def test_without_a_thruster_the_authority_is_smaller_by_what_is_said(name):
    summary, craft = describe(name), load(name)
    for k in range(craft.number_of_thrusters):
        left = np.delete(craft.effectiveness(), k, axis=1) * craft.control_period
        remaining = np.stack([left.clip(min=0.0).sum(axis=1), (-left).clip(min=0.0).sum(axis=1)])
        np.testing.assert_allclose(summary.authority * (1.0 - summary.loss[k]), remaining, atol=1e-15)


def test_the_shortest_firing_of_each_kind_of_thruster():
    np.testing.assert_allclose(describe("spheres").minimum_impulse, 0.112 * 0.010, rtol=1e-14)
    np.testing.assert_allclose(describe("ppt_cubesat").minimum_impulse, 1e-4 * 0.016, rtol=1e-14)
    np.testing.assert_allclose(describe("spheres").minimum_change[:3], 0.112 * 0.010 / 4.616, rtol=1e-14)
    assert not describe("orion").minimum_impulse.any()


def test_pairs_that_push_opposite_ways_or_the_same_way():
    assert describe("spheres").opposite_pairs == tuple((k, k + 6) for k in range(1, 7))
    assert describe("atmos_like").opposite_pairs == ((1, 2), (3, 4), (5, 6), (7, 8))
    for name in ("orion", "astrobee_like", "msr_chaser"):
        assert describe(name).opposite_pairs == describe(name).parallel_pairs == ()
    same, stronger = (describe(with_copies(strength=strength)) for strength in (1.0, 1.5))
    assert same.parallel_pairs == same.identical_pairs == stronger.parallel_pairs == ((1, 13),)
    assert stronger.identical_pairs == ()


def test_the_text_names_axes_without_authority_pairs_and_stores_of_momentum():
    text = str(describe("atmos_like"))
    assert "rank 3 of 6" in text
    assert "no authority: +z, +x-rotation, +y-rotation, -z, -x-rotation, -y-rotation" in text
    assert "opposite pairs: 1 and 2" in text
    wheel = ReactionWheel(name="W", axis=(0, 0, 1), inertia=1e-3, max_torque=0.02, max_speed=300.0)
    gyro = ControlMomentGyro(
        name="G", gimbal_axis=(1, 0, 0), spin_axis=(0, 1, 0), momentum=0.5, max_gimbal_rate=0.2
    )
    summary = describe(load("orion").replace(reaction_wheels=[wheel], control_moment_gyros=[gyro]))
    assert "reaction wheel W: 0.02 N m, 0.3 N m s" in str(summary)
    assert "control-moment gyro G: 0.1 N m, 0.5 N m s" in str(summary)


def test_the_repr_is_a_few_lines():
    text = repr(with_copies(strength=1.5))
    assert len(text.splitlines()) == 3
    assert max(map(len, text.splitlines())) <= 120
    assert "13 thrusters of 0.06 to 0.09 N" in text


def test_the_command_prints_it_and_refuses_in_one_line(capsys, tmp_path):
    assert main(["describe", "spheres"]) == 0
    assert capsys.readouterr().out == f"{describe('spheres')}\n"
    (tmp_path / "mine.toml").write_text('name = "mine"')
    for source, line in (
        ("sphere", "did you mean 'spheres'?"),
        (str(tmp_path / "mine.toml"), "'mass' is missing"),
    ):
        assert main(["describe", source]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1
        assert line in said[0]
