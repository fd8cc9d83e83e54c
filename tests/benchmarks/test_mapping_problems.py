"""What the mapping benchmarks measure on is what they say: kinds of command, flights, requests, referees."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from benchmarks.allocation_value import CASES, compare, farthest, reachable
from benchmarks.mapping import peak_memory
from benchmarks.problems import KINDS, MIXTURE, SHARE_DEAD, VEHICLES, flight, problems, vehicle
from benchmarks.solvers import (
    clipped_nnls,
    clipped_pseudo_inverse,
    cold_highs,
    interior_clarabel,
    proximal_daqp,
    scipy_linprog,
    tight_highs,
    warm_glpk,
    warm_highs,
)
from benchmarks.timing import QUICK, Calls, clock_cost, race_calls


@pytest.mark.parametrize("craft", VEHICLES)
@pytest.mark.parametrize("make", [problems, flight])
def test_commands_are_of_the_kind_that_they_are_named_for(craft, make):
    for kind in KINDS:
        these = make(500, craft, kind)
        size = np.abs(these.command) @ these.slack_cost
        miss = np.abs(these.solve()[1]) @ these.slack_cost
        tracked = miss <= 1e-9 * size
        assert tracked.all() if kind != "saturated" else not tracked.any()
        axes = np.count_nonzero(these.command, axis=1)
        assert axes.max() <= 2 if kind == "degenerate" else axes.min() >= 5  # a sine may cross zero


@pytest.mark.parametrize("craft", VEHICLES)
def test_a_flight_changes_little_from_command_to_command(craft):
    for kind in ("interior", "degenerate"):
        these = flight(1000, craft, kind)
        step = np.abs(np.diff(these.command, axis=0)) / vehicle(craft).authority
        assert step.max() < 0.2 * (np.abs(these.command) / vehicle(craft).authority).max()


def test_the_mixture_has_its_share_of_dead_thrusters_and_no_empty_command():
    these = problems(20_000, kind=MIXTURE)
    dead = (these.max_on_time == 0.0).sum(axis=1)
    assert set(np.unique(dead)) == {0, 1}
    assert dead.mean() == pytest.approx(SHARE_DEAD, abs=0.015)  # five standard deviations
    assert np.abs(these.command).max(axis=1).min() > 0.0
    assert np.array_equal(these.faulted[dead == 1].any(axis=1), these.max_on_time[dead == 1] > 0.0)


@pytest.mark.parametrize("craft", VEHICLES)
def test_exact_solvers_find_the_least_objective_of_the_mixture(craft):
    these = problems(40, craft)
    least = these.solve()[2]
    makers = [scipy_linprog, cold_highs, warm_highs, tight_highs, interior_clarabel]
    solvers = [make(these) for make in makers]
    if importlib.util.find_spec("swiglpk") is not None:  # a peer that need not be installed
        solvers.append(warm_glpk(these, importlib.import_module("swiglpk")))
    for solve in solvers:
        assert [solve(i) for i in range(40)] == pytest.approx(least.tolist(), rel=1e-8)


@pytest.mark.parametrize("craft", VEHICLES)
def test_maps_that_are_no_solvers_never_beat_the_least_objective(craft):
    these = problems(200, craft)
    least = these.solve()[2]
    for make in (clipped_nnls, clipped_pseudo_inverse):
        solve = make(these)
        assert min(solve(i) / least[i] for i in range(200)) >= 1.0 - 1e-9


def test_daqp_solves_saturated_commands():
    these = problems(100, kind="saturated")
    least = these.solve()[2]
    solve = proximal_daqp(these, importlib.import_module("daqp"))
    assert np.mean([abs(solve(i) - least[i]) <= 1e-6 * least[i] for i in range(100)]) > 0.9


@pytest.mark.parametrize(
    ("dead", "axis", "share"), [(None, 0, 1.0), (None, 4, 1.0), (1, 0, 0.5), (1, 4, 0.5), (1, 1, 1.0)]
)
def test_the_farthest_request_is_orions_authority(dead, axis, share):
    """What a period gives on one axis, the others held: halved where thruster 1 is missed."""
    craft = vehicle(VEHICLES[0])
    effectiveness = craft.effectiveness.copy()
    sign = 1.0 if dead is None else np.sign(effectiveness[axis, dead - 1]) or 1.0
    if dead is not None:
        effectiveness[:, dead - 1] = 0.0
    direction = np.zeros((1, 6))
    direction[0, axis] = sign * craft.authority[axis]
    assert farthest(craft, effectiveness, direction) == pytest.approx([share], abs=1e-9)


@pytest.mark.parametrize("craft", VEHICLES)
@pytest.mark.parametrize("case", CASES)
def test_the_linear_program_meets_every_request_and_a_map_that_does_too_burns_no_less(craft, case):
    value = compare(craft, "minimum norm and shift", case, 600)
    assert value.linear_error.max() < 1e-9
    met = value.error < 1e-9
    assert met.any()
    assert value.burnt[met].min() >= 1.0 - 1e-9


def test_the_pair_mixer_burns_on_spheres_what_the_linear_program_burns():
    value = compare("SPHERES 6x12", "null space", "healthy", 500)
    assert value.burnt == pytest.approx(np.ones(500), rel=1e-9)
    assert value.error.max() < 1e-9


def test_requests_are_as_many_as_asked_for_even_if_half_of_all_directions_cannot_be_given():
    craft = vehicle("SPHERES 6x12")
    effectiveness = craft.effectiveness.copy()
    effectiveness[:, 0] = 0.0
    assert reachable(craft, effectiveness, 300, np.random.default_rng(0)).shape == (300, 6)


def test_calls_are_timed_one_by_one():
    works = {name: (range, [(stop,)] * 40) for name, stop in (("one", 1), ("two", 2))}
    found = race_calls(works, QUICK, repetitions=1)
    assert found["one"].rounds.shape == (1, 40)
    assert (found["one"].rounds >= 0.0).all()
    assert 0.0 < clock_cost() < 1e-4
    calls = Calls(np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [10.0, 10.0, 10.0]]))
    assert calls.median == 4.0
    assert calls.percentile(100.0) == 6.0
    assert Calls(calls.rounds / 5.0).times_faster_than(calls) == pytest.approx(5.0)


def test_the_peak_counts_what_is_thrown_away():
    assert peak_memory(lambda: np.zeros(10_000) + 1.0) == pytest.approx(160_000, rel=0.02)
