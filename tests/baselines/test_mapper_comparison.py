"""Every mapper that fits a vehicle on the same commands, and what mappers of pulses take from its file."""

import numpy as np
import pytest

from thruster_baselines.mapping import (
    CarryingMapper,
    LPMapper,
    MinimumPulseMapper,
    SchmittTriggerMapper,
    TruncatingMapper,
    compare_mappers,
    minimum_pulses,
)
from thruster_envs.spacecraft import catalogue, load

COMPENSATIONS = {
    "DifferentialCompensationMapper",
    "AdditiveCompensationMapper",
    "MILPMapper",
    "ExactCompensationMapper",
}
PULSED = {"MinimumPulseMapper", "TruncatingMapper", "SchmittTriggerMapper", "CarryingMapper"}


def names(table):
    return {row.name for row in table.rows}


@pytest.mark.parametrize("name", catalogue())
def test_every_vehicle_of_the_catalogue_has_a_table_with_the_mappers_that_fit(name):
    table, craft = compare_mappers(name, count=4, slowest=60.0), load(name)
    assert (names(table) >= COMPENSATIONS) == (craft.feed.coupling > 0.0)
    assert (names(table) >= PULSED) == bool(minimum_pulses(craft).any())
    assert not names(table) & set(table.left_out)
    assert "needs to be told" in table.left_out["RobustCommandMapper"]
    assert table.rows[0].name == "LPMapper"
    assert all(np.isfinite(row[1:]).all() and row.solve_time > 0.0 for row in table.rows)
    assert len(str(table).splitlines()) == 3 + len(table.rows) + len(table.left_out)


def test_a_command_by_hand():
    """0.012 m/s along x on SPHERES: 0.2473 s in each of jets 1 and 2, the LP to round-off."""
    table = compare_mappers("spheres", [[0.012, 0.0, 0.0, 0.0, 0.0, 0.0]])
    row = table["LPMapper"]
    assert row.propellant == pytest.approx(0.012 * 4.616 / 0.112, rel=1e-9)
    assert row.residual == row.worst_residual == pytest.approx(0.0, abs=1e-12)
    assert table.unreachable == 0.0


def test_twice_the_authority_is_out_of_reach_and_half_of_it_is_missed():
    spheres = load("spheres")
    table = compare_mappers(spheres, np.diag(2.0 * spheres.authority()))
    assert table.unreachable == 1.0
    assert table["LPMapper"].residual == pytest.approx(1.0, rel=1e-9)


def test_mappers_that_know_the_coupling_miss_less_and_only_a_memory_keeps_the_sum():
    orion = compare_mappers("orion", count=60)
    assert orion["ExactCompensationMapper"].residual < 0.3 * orion["LPMapper"].residual
    small = 0.05 * compare_mappers("spheres", count=60).commands
    spheres = compare_mappers("spheres", small)
    assert (
        spheres["TruncatingMapper"].propellant == spheres["LPMapper"].propellant
    )  # no valve opens otherwise
    assert spheres["CarryingMapper"].residual_of_sum < 0.5 * spheres["TruncatingMapper"].residual_of_sum
    assert spheres["MinimumPulseMapper"].residual <= spheres["TruncatingMapper"].residual


def test_commands_are_those_of_the_seed_and_are_spanned_where_an_axis_is_dead():
    one, same, other = (compare_mappers("atmos_like", seed=seed, count=8).commands for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    assert not one[:, 2:5].any()
    matrix = load("ppt_cubesat").effectiveness()
    turns = compare_mappers("ppt_cubesat", count=8).commands
    given = turns @ np.linalg.pinv(matrix).T @ matrix.T
    np.testing.assert_allclose(given, turns, atol=1e-9 * np.abs(turns).max())


def test_a_mapper_that_is_too_slow_is_left_out_and_said_so():
    table = compare_mappers("atmos_like", count=4, slowest=0.0)
    assert table.rows == ()
    assert "more than slowest, 0 s" in table.left_out["LPMapper"]


def test_a_figure_has_a_bar_for_each_mapper_and_measure():
    table = compare_mappers("atmos_like", count=4)
    axes = table.figure().axes
    assert [len(one.patches) for one in axes] == [len(table.rows)] * 3


@pytest.mark.parametrize("commands", [np.zeros((0, 6)), np.zeros(6), np.zeros((2, 5))])
def test_commands_of_another_shape_are_refused(commands):
    with pytest.raises(ValueError, match="shape"):
        compare_mappers("orion", commands)


@pytest.mark.parametrize("mapper_type", [TruncatingMapper, SchmittTriggerMapper])
def test_mappers_of_pulses_take_what_they_need_from_the_vehicle(mapper_type):
    spheres = load("spheres")
    commands = 0.01 * np.random.default_rng(0).normal(size=(40, 6)) * spheres.authority()
    for source in ("spheres", spheres):
        short, long = mapper_type(source), mapper_type(LPMapper(spheres), minimum_pulses(spheres))
        np.testing.assert_array_equal(short(commands).on_times, long(commands).on_times)
    np.testing.assert_array_equal(mapper_type("spheres", 0.5).minimum_pulse, 0.5)
    with pytest.raises(ValueError, match="minimum_pulse is missing"):
        mapper_type(LPMapper(spheres))


def test_a_mapper_that_carries_says_what_it_wants():
    for wrong in ("spheres", load("spheres"), 3):
        with pytest.raises(
            ValueError, match=r"must be a mapper such as MinimumPulseMapper\(spacecraft\), got"
        ):
            CarryingMapper(wrong)
    assert not CarryingMapper(MinimumPulseMapper("spheres")).remainder.any()
