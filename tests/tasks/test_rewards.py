"""Success returns more than coming nearer, that more than doing nothing, and that more than being lost."""

import importlib
import re
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from tests.tasks import reward_flights as flights
from tests.tasks.flying import begin
from tests.tasks.reward_flights import DISCOUNTS, fly, nothing, spin_about, spin_up, steps_of, until
from thruster_envs.physics import rows as at
from thruster_envs.registration import ENVIRONMENTS, make_parallel
from thruster_envs.tasks import (
    ActiveDiagnosis,
    FaultDiagnosis,
    FormationAttitude,
    FormationKeeping,
    MarsRendezvous,
    OrionRendezvous,
    PulseDiagnosis,
    Task,
    ThrusterMapping,
)
from thruster_envs.tasks.shaping import delta_v_to_go

#: Shares of an episode after which the worlds of a batch go astray: at once, and later.
SHARES = np.linspace(0.0, 0.3, 20)
#: Limits that are reached sooner than those of the task.
TIGHT = {"rate_soft_limit": 0.01, "rate_limit": 0.012}
#: One thruster that lacks up to two fifths of its thrust, which every pilot here flies through.
WEAK = {"probability": 1.0, "kinds": ("loss",), "severity": {"loss": (0.1, 0.4)}, "onset": (0.0, 30.0)}
#: Faults under which a craft that holds its place is not lost.
MILD = {"probability": 0.8, "kinds": ("stuck_off", "loss"), "onset": (0.0, 300.0)}
HEALTHY: list[Any] = []


@dataclass
class Case:
    """A task, and policies for it.

    Attributes:
        task: Its configuration.
        success: What reaches its goal.
        near: What comes nearer.
        losing: What is lost as soon as can be, by ways of its own.
        faults: Those of the flights with faults.
        drifts: Whether doing nothing ends lost.
        declares: Whether to say nothing is right where there is no fault.
        steps: Periods that are flown outside of the nightly tests; None for all.
    """

    task: Task
    success: Any
    near: Any
    losing: tuple[Any, ...] = ()
    faults: Any = None
    drifts: bool = False
    declares: bool = False
    steps: int | None = None

    def fly(self, policy, worlds, faults=HEALTHY, *, whole=False):
        return fly(self.task, policy, worlds, faults=faults, limit=None if whole else self.steps)


KEEPING = (
    flights.keep_slots(),
    until(flights.keep_slots(), 0.3),
    (spin_up, flights.keep_slots(3000.0)),
    WEAK,
)
TURNING = (flights.turn(), flights.turn(0.5), (spin_up,), WEAK)
DECLARING = (flights.right, until(nothing, 0.5, flights.right))
CASES = {
    "ThrusterMapping": Case(ThrusterMapping(), flights.allocate(), flights.allocate(0.5)),
    "OrionRendezvous": Case(
        OrionRendezvous(), flights.approach(), flights.approach(0.3), (spin_up, flights.approach(30.0)), WEAK,
        drifts=True,
    ),
    "MarsRendezvous": Case(
        MarsRendezvous(), flights.capture, flights.stop_at(8.0),
        (spin_up, flights.pass_by(1.0), flights.rush(0.5)), WEAK,
        drifts=True,
    ),
    "FormationKeeping": Case(FormationKeeping(commanded=1), *KEEPING),
    "FormationKeeping, team": Case(FormationKeeping(), *KEEPING),
    "FormationAttitude": Case(FormationAttitude(commanded=1, **TIGHT), *TURNING, steps=1200),
    "FormationAttitude, team": Case(FormationAttitude(**TIGHT), *TURNING, steps=1200),
    "FaultDiagnosis": Case(FaultDiagnosis(), *DECLARING, declares=True),
    "ActiveDiagnosis": Case(ActiveDiagnosis(rate_limit=0.02), *DECLARING, (spin_up,), MILD, declares=True),
    "PulseDiagnosis": Case(PulseDiagnosis(), *DECLARING, declares=True),
}  # fmt: skip
LOSING = [name for name, case in CASES.items() if case.losing]


def means(flown):
    return np.array([flown.returns(discount).mean() for discount in DISCOUNTS])


def test_every_environment_and_form_has_a_case():
    named = {identifier.split("/")[1].split("-")[0] for identifier in ENVIRONMENTS}
    teams = {f"{name}, team" for name in named if _row(name).parallel}
    assert set(CASES) == named | teams


def _row(name):
    return next(row for identifier, row in ENVIRONMENTS.items() if f"/{name}-v" in identifier)


@pytest.mark.parametrize("faulty", [False, True], ids=["healthy", "faulty"])
@pytest.mark.parametrize("name", CASES)
def test_success_beats_coming_nearer_and_that_doing_nothing_and_that_being_lost(name, faulty):
    check_order(CASES[name], faulty, 20, whole=False)


@pytest.mark.nightly
@pytest.mark.parametrize("faulty", [False, True], ids=["healthy", "faulty"])
@pytest.mark.parametrize("name", CASES)
def test_the_order_holds_over_a_hundred_seeds(name, faulty):
    check_order(CASES[name], faulty, 100, whole=True)


def check_order(case, faulty, worlds, *, whole):
    faults = case.faults if faulty else HEALTHY
    success, near, idle = (
        case.fly(policy, worlds, faults, whole=whole) for policy in (case.success, case.near, nothing)
    )
    if not isinstance(case.task, ThrusterMapping):  # where most commands are out of reach
        assert success.success.mean() >= 0.95
    assert (idle.terminated & ~idle.success[:, 0]).all() == case.drifts
    if case.declares and not faulty:
        assert (means(success) == means(near)).all()
        assert (means(near) == means(idle)).all()
    else:
        assert (means(success) > means(near)).all()
        assert (means(near) > means(idle)).all()
    later = [until(nothing, share, spin_up) for share in SHARES[::6]] if case.losing else []
    for policy in (*case.losing, *later):
        lost = case.fly(policy, worlds, faults, whole=whole)
        assert lost.terminated.all()
        assert not lost.success.any()
        assert (means(idle) > means(lost)).all()


@pytest.mark.parametrize("name", LOSING)
def test_at_no_time_and_under_no_discount_does_it_pay_to_be_lost(name):
    """Whatever was flown before, each world returns less than if it had gone on, well or not at all."""
    case = CASES[name]
    worlds = len(SHARES)
    lost = case.fly(until(case.success, SHARES, spin_up), worlds)
    well = case.fly(case.success, worlds)
    rest = None if case.drifts else case.fly(until(case.success, SHARES), worlds)
    assert lost.terminated.all()
    for discount in DISCOUNTS:
        assert (lost.returns(discount) < well.returns(discount)).all()
        if rest is not None:
            assert (lost.returns(discount) < rest.returns(discount)).all()


def test_a_lost_flight_that_is_watched_costs_no_less_than_one_that_goes_on():
    """The agent has no part in it: what was right stays right, and what was not is charged to the end."""
    faults = {"thruster": 3, "kind": "stuck_on", "onset": 50.0}
    lost, whole = FaultDiagnosis(rate_limit=0.05), FaultDiagnosis()
    wrong = flights.constant(np.array([[5.0, 0.0]]))
    order = []
    for policy in (flights.right, nothing, wrong):
        ended, flown = fly(lost, policy, 20, faults=faults), fly(whole, policy, 20, faults=faults)
        assert ended.terminated.all()
        assert not flown.terminated.any()
        for discount in DISCOUNTS:
            assert (ended.returns(discount) <= flown.returns(discount) + 1e-12).all()
        order.append(means(ended))
    assert (order[0] > order[1]).all()
    assert (order[1] > order[2]).all()


def gaming(seeds):
    """Policies that know nothing of their task."""
    policies = {f"spin about {axis}": spin_about(axis) for axis in range(3)}
    for seed in range(seeds):
        policies[f"constant {seed}"] = flights.random_constants(seed)
        policies[f"random {seed}"] = flights.random_duties(seed)
        policies[f"bang-bang {seed}"] = flights.bang_bang(seed)
    return policies


@pytest.mark.parametrize(
    ("seeds", "whole"), [(1, False), pytest.param(10, True, marks=pytest.mark.nightly)], ids=["few", "many"]
)
@pytest.mark.parametrize("name", CASES)
def test_no_policy_that_knows_nothing_games_the_reward(name, seeds, whole):
    """None returns as much as success, and in no world does a loss return more than to do nothing there.

    Where that is lost too, the earlier loss returns less.
    """
    case, worlds = CASES[name], 20
    success, idle = (case.fly(policy, worlds, case.faults, whole=whole) for policy in (case.success, nothing))
    for policy in gaming(seeds).values():
        flown = case.fly(policy, worlds, case.faults, whole=whole)
        assert (means(success) > means(flown)).all()
        lost = flown.terminated & ~flown.success.any(axis=1) & (flown.score == 0.0).all(axis=1)
        lost &= flown.length < 0.8 * idle.length if case.drifts else ~idle.terminated
        for discount in DISCOUNTS:
            assert (flown.returns(discount)[lost] < idle.returns(discount)[lost]).all()


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.declares])
def test_no_constant_declaration_returns_more_than_to_declare_no_fault(name):
    case = CASES[name]
    idle = case.fly(nothing, 100, None)
    for thruster in range(1, case.task.choices[0]):
        action = np.zeros((1, len(case.task.choices)))
        action[0, 0] = thruster
        assert (means(case.fly(flights.constant(action), 100, None)) < means(idle)).all()


def to_pay(batch):
    """(worlds,): delta-v to go, and attitude errors at their worth, over what the mission costs."""
    task, period = batch.task, batch.task.vehicle.control_period
    truth = batch.fleet.read(at.POSITION, 13)[:, 0]
    n, numbers = task.vehicle.mean_motion, batch.state.model
    acceleration = task.vehicle.authority()
    lever = acceleration[:3].mean() / acceleration[3:].mean()
    reference = delta_v_to_go(task.start, (0.0, 0.0, 0.0), task.steps * period, n)
    assert numbers.parameters[4:6] == pytest.approx([lever, reference])
    result = []
    for world, (r, v, q, w) in enumerate(zip(*np.split(truth, [3, 6, 10], axis=1), strict=True)):
        left = period * (task.steps - batch.steps[world])
        turned = n * np.array([
            2.0 * (q[1] * q[3] + q[0] * q[2]) * 1.0,
            2.0 * (q[2] * q[3] - q[0] * q[1]) * 1.0,
            1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2),
        ])  # fmt: skip
        angle = 2.0 * np.sign(q[0]) * q[1:]
        attitude = np.abs(w - turned).sum() + np.abs(angle).sum() / 60.0
        result.append((delta_v_to_go(tuple(r), tuple(v), left, n) + lever * attitude) / reference)
    return np.array(result)


@pytest.mark.parametrize("policy", [flights.approach(), nothing, flights.bang_bang(0), spin_up])
def test_the_progress_of_a_rendezvous_sums_to_the_difference_of_its_potentials(policy):
    task = OrionRendezvous(orbits=0.1)
    batch = begin(task, worlds=8)
    first, total, open_worlds = to_pay(batch), np.zeros(8), np.ones(8, bool)
    expected = np.full(8, np.nan)
    for step in range(task.steps):
        result = batch.step(policy(batch, step))
        total += np.where(open_worlds, result.reward_terms[:, 0, 1], 0.0)
        lost = result.reward_terms[:, 0, 3] < 0.0
        ends = open_worlds & result.done
        last = to_pay(batch)
        potential = np.where(lost, -1.0, -last / (1.0 + last))
        expected[ends] = (5.0 * (potential + first / (1.0 + first)))[ends]
        open_worlds &= ~ends
    assert not open_worlds.any()
    np.testing.assert_allclose(total, expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    "policy", [flights.capture, flights.pass_by(0.4), flights.rush(0.3), nothing, spin_up]
)
def test_the_progress_of_a_capture_sums_to_the_difference_of_its_potentials(policy):
    task = MarsRendezvous(distance=4.0)
    batch = begin(task, worlds=8)
    nominal = task.distance / 0.1

    def potential():
        distance = np.linalg.norm(batch.fleet.read(at.POSITION, 3)[:, 0], axis=1)
        return -np.maximum(distance / task.distance, 1.0 - batch.steps * 0.1 / nominal)

    first, total, open_worlds, expected = potential(), np.zeros(8), np.ones(8, bool), np.full(8, np.nan)
    for step in range(task.steps):
        result = batch.step(policy(batch, step))
        total += np.where(open_worlds, result.reward_terms[:, 0, 3], 0.0)
        ends = open_worlds & result.done
        unsafe = ~batch.info(result)["approach"]["safe"][:, 0]
        last = np.where(unsafe, -1.0 - 10.0 / task.distance, potential())
        expected[ends] = 4.0 * (last - first)[ends]
        open_worlds &= ~ends
    assert not open_worlds.any()
    np.testing.assert_allclose(total, expected, rtol=0.0, atol=1e-9)


BOUNDS = r"\| ([^|]+?) (?:to|or) ([^|]+?) "
ROW = re.compile(rf"^ *\| `(\w+)` \|.*?{BOUNDS}{BOUNDS}\|$", re.MULTILINE)


@pytest.mark.parametrize("name", CASES)
def test_terms_stay_within_the_bounds_that_the_page_states(name):
    case = CASES[name]
    task, row = case.task, _row(name.split(",")[0])
    module, _, attribute = (row.parallel if "team" in name else row.single).partition(":")
    page = getattr(importlib.import_module(module), attribute).__doc__.partition("## Rewards")[2]
    bounds = {}
    for term, low, high, least, most in ROW.findall(page.partition("## Starting State")[0]):
        values = [eval(value, {"T": steps_of(task)}) for value in (low, high, least, most)]
        bounds[term] = np.array(values, float)
    assert set(bounds) == set(task.reward_terms)
    for policy in (case.success, nothing, flights.random_duties(0), *case.losing):
        flown = case.fly(policy, 8, case.faults)
        for term, (low, high, least, most) in bounds.items():
            values, slack = flown.term(task, term), 1.02
            assert values.min() >= slack * low
            assert values.max() <= slack * high
            assert values.sum(axis=0).min() >= slack * least
            assert values.sum(axis=0).max() <= slack * most


@pytest.mark.parametrize("identifier", ENVIRONMENTS)
def test_every_form_gives_the_same_rewards(identifier):
    rng = np.random.default_rng(2)
    envs = gym.make_vec(identifier, num_envs=2, vectorization_mode="vector_entry_point")
    env, (first, _) = gym.make(identifier), envs.reset(seed=7)
    assert (env.reset(seed=7)[0] == first[0]).all()
    batch = begin(envs.unwrapped.task, 2, seed=7)
    space = env.action_space
    for _ in range(5):
        box = isinstance(space, gym.spaces.Box)
        actions = rng.uniform(-1.0, 1.0, (2, *space.shape)) if box else np.zeros((2, *space.shape), np.int64)
        step = batch.step(actions.reshape(batch._shape))
        assert (envs.step(actions)[1] == step.rewards[:, 0]).all()
        assert env.step(actions[0])[1] == step.rewards[0, 0]
    if ENVIRONMENTS[identifier].parallel is None:
        return
    team = make_parallel(identifier)
    team.reset(seed=7)
    batch = begin(team.task, 1, seed=7, limit=team.max_cycles)
    for _ in range(5):
        actions = {agent: team.action_space(agent).sample() for agent in team.agents}
        step = batch.step(np.array([list(actions.values())], np.float64))
        assert list(team.step(actions)[1].values()) == step.rewards[0].tolist()


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["FormationKeeping", "OrionRendezvous"])
def test_what_a_learner_finds_first_is_not_to_be_lost(name):
    """A short run on raw duties: it ends with longer flights than it began with, and no loss pays it."""
    stable_baselines3 = pytest.importorskip("stable_baselines3")
    from thruster_envs.views import SB3VecEnv

    case = CASES[name]
    identifier = next(one for one in ENVIRONMENTS if f"/{name}-v" in one)
    envs = SB3VecEnv(gym.make_vec(identifier, num_envs=32, vectorization_mode="vector_entry_point"))
    model = stable_baselines3.PPO(
        "MlpPolicy", envs, n_steps=128, batch_size=1024, n_epochs=5, learning_rate=5e-4, seed=0, device="cpu"
    )

    def policy(batch, step):
        return model.predict(batch.observe()[:, 0], deterministic=False)[0].reshape(batch._shape)

    before = case.fly(policy, 20)
    model.learn(150_000)
    learnt, idle = case.fly(policy, 20), case.fly(nothing, 20)
    assert learnt.length.mean() >= before.length.mean()
    assert learnt.returns(0.99).mean() > before.returns(0.99).mean()
    lost = learnt.terminated & (learnt.score == 0.0).all(axis=1)
    if case.drifts:
        lost &= learnt.length < 0.8 * idle.length
    assert (learnt.returns(1.0)[lost] < idle.returns(1.0)[lost]).all()
