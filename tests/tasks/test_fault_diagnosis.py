"""Diagnosis of a flight: declarations are judged as the page says; a classical player finds the faults."""

import numpy as np
import pytest

from tests.tasks.diagnosing import LikelihoodPlayer
from tests.tasks.flying import begin
from tests.views.cases import FAULTS
from thruster_envs.faults import KINDS, Fault, mode_of
from thruster_envs.physics import rows as at
from thruster_envs.spacecraft import load
from thruster_envs.tasks import FaultDiagnosis
from thruster_envs.tasks.fault_diagnosis import FLIGHT, Parameters

ORION = load("orion")
PERIOD = ORION.control_period


def nothing(worlds):
    return np.zeros((worlds, 1, 2), np.int64)


def right_now(batch):
    """What would be right to declare, (worlds, 1, 2)."""
    told = batch.info()["diagnosis"]
    return np.stack((told["thruster"], told["mode"]), axis=-1)


def play(player, worlds=150, seed=1000, task=None):
    """Mean score, share of successes and mean return of a player, (worlds, size) to (worlds, 2)."""
    batch = begin(task or FaultDiagnosis(), worlds=worlds, seed=seed)
    observations, returned = batch.observe()[:, 0], 0.0
    for _ in range(FLIGHT):
        step = batch.step(player(observations)[:, np.newaxis])
        observations = step.observations[:, 0]
        returned += step.rewards.mean()
    truth = batch.task.truth(batch.state)
    return truth.score.mean(), truth.success.mean(), returned


# ---- Players -----------------------------------------------------------------------------------------------


def test_a_classical_player_finds_the_faults():
    score, success, returned = play(LikelihoodPlayer(150))
    assert score >= 0.8
    assert success >= 0.9
    assert returned >= 2.0  # of 2.9 that there are on average


@pytest.mark.parametrize(
    ("player", "best"),
    [
        (lambda observations: np.zeros((len(observations), 2)), 0.3),  # a flight in five is sound
        (lambda observations: np.tile((1, 0), (len(observations), 1)), 0.02),
        (lambda observations: np.random.default_rng(int(observations[0, 12] * 1e6)).integers(
            0, (13, 6), (len(observations), 2)), 0.05),
    ],
    ids=["never", "always the same", "random"],
)  # fmt: skip
def test_a_player_that_does_not_look_gets_little(player, best):
    score, success, _ = play(player)
    assert score <= best
    assert success <= best


def test_to_declare_what_info_says_is_worth_the_most_and_costs_nothing():
    batch = begin(FaultDiagnosis(), worlds=200)
    for _ in range(FLIGHT):
        right = right_now(batch)
        step = batch.step(right)
        np.testing.assert_allclose(step.rewards[:, 0], 5.0 / FLIGHT * (right[:, 0, 0] > 0), rtol=1e-12)
        assert not step.terminated.any()  # no default fault makes the scripted pilot lose the craft
    truth, told = batch.task.truth(batch.state), batch.info()["diagnosis"]
    assert (truth.score == 1.0).all()
    assert truth.success.all()
    faulty = told["thruster"] > 0
    assert 0.7 < faulty.mean() < 0.9
    assert (told["detected"] == faulty).all()
    assert (told["delay"][faulty] < PERIOD).all()
    assert (told["delay"][~faulty] == -1.0).all()
    assert not told["false_alarms"].any()
    assert (told["identified"] == faulty).all()


# ---- How declarations are judged ---------------------------------------------------------------------------


class Reckoning:
    """The page's rules in plain Python, for one world."""

    costs = {"delay": 2.5, "false_alarm": 5.0, "wrong_name": 4.0, "wrong_mode": 2.5}  # noqa: RUF012

    def __init__(self, faults):
        self.faults, self.last, self.onset, self.standing, self.delay = faults, 0, None, 0, -1.0
        self.credits, self.alarms, self.steps = [], 0, []

    def declare(self, time, thruster, mode):
        acting = [fault for fault in self.faults if fault["onset"] <= time < fault["end"]]
        named = [fault for fault in acting if fault["thruster"] == thruster]
        exact = [fault for fault in named if fault["mode"] == mode]
        terms = {"right": 5.0 / FLIGHT if named else 0.0, "delay": 0.0, "false_alarm": 0.0, "wrong_name": 0.0}
        if acting:
            if self.onset is None:
                self.onset, self.standing = min(fault["onset"] for fault in acting), self.last
            if self.delay < 0.0 and thruster and (thruster != self.standing or named):
                self.delay = time - self.onset
            if not thruster:
                terms["delay"] = -self.costs["delay"] / FLIGHT
            elif not exact:
                terms["wrong_name"] = -self.costs["wrong_mode" if named else "wrong_name"] / FLIGHT
            self.credits.append(1.0 if exact else 0.5 if named else 0.0)
        else:
            if thruster:
                terms["false_alarm"] = -self.costs["false_alarm"] / FLIGHT
                self.alarms += thruster != self.last
            self.steps.append(thruster > 0)
        self.last = thruster
        self.isolated, self.identified = bool(named), bool(exact)
        self.right = self.identified if acting else thruster == 0
        return terms

    @property
    def score(self):
        credit = np.mean(self.credits) if self.credits else 1.0
        return credit * (1.0 - np.mean(self.steps) if self.steps else 1.0)


def test_costs_delays_and_scores_are_those_of_the_page():
    worlds, generator = 60, np.random.default_rng(0)
    batch = begin(FaultDiagnosis(faults=FAULTS), worlds=worlds)
    reckonings = []
    for rows in batch.fleet.fault_rows()[:, 0]:
        faults = [
            {
                "thruster": int(row[1]) + 1,
                "mode": mode_of(KINDS[int(row[0]) - 1], row[2]),
                "onset": row[3],
                "end": row[4],
            }
            for row in rows[rows[:, 0] > 0]
        ]
        reckonings.append(Reckoning(faults))
    declared = nothing(worlds)
    for number in range(60):
        # Mostly what is right or was said before, so that every rule comes to bear.
        choice = generator.random((worlds, 1, 1))
        anything = generator.integers(0, (13, 6), (worlds, 1, 2))
        declared = np.where(choice < 0.5, right_now(batch), np.where(choice < 0.8, declared, anything))
        step = batch.step(declared)
        assert not step.terminated.any()
        told, truth = batch.info(step), batch.task.truth(batch.state)
        for world, reckoning in enumerate(reckonings):
            terms = reckoning.declare(number * PERIOD, *declared[world, 0].tolist())
            for name, value in terms.items():
                assert told["reward_terms"][name][world, 0] == pytest.approx(value, abs=1e-15)
            says = {name: values[world, 0] for name, values in told["diagnosis"].items()}
            assert says["delay"] == pytest.approx(reckoning.delay, abs=1e-9)
            assert says["detected"] == (reckoning.delay >= 0.0)
            assert says["false_alarms"] == reckoning.alarms
            assert (says["isolated"], says["identified"]) == (reckoning.isolated, reckoning.identified)
            assert truth.score[world, 0] == pytest.approx(reckoning.score, abs=1e-12)
            assert truth.success[world, 0] == (reckoning.right and reckoning.alarms == 0)
    assert max(reckoning.alarms for reckoning in reckonings) >= 2
    assert {reckoning.delay >= 0.0 for reckoning in reckonings} == {True, False}


@pytest.mark.parametrize(
    ("declared", "cost", "credit"),
    [((0, 0), 2.5, 0.0), ((5, 0), 4.0, 0.0), ((3, 1), 2.5, 0.5), ((3, 0), 0.0, 1.0)],
)
def test_a_lost_flight_is_charged_to_its_end(declared, cost, credit):
    """Else an agent that is wrong would be glad of the loss. What was right stays worth what it was."""
    batch = begin(FaultDiagnosis(faults=[Fault(3, "stuck_off")]))
    chosen = np.array(declared).reshape(1, 1, 2)
    returned = sum(batch.step(chosen).rewards.item() for _ in range(10))
    batch.fleet.write(at.RATE, np.array((1.5, 0.0, 0.0)))
    step = batch.step(chosen)
    assert step.terminated.all()
    worth = 11 * 5.0 / FLIGHT if declared[0] == 3 else 0.0
    assert returned + step.rewards.item() == pytest.approx(worth - cost, abs=1e-12)
    assert batch.task.truth(batch.state).score.item() == credit
    assert not batch.step(chosen).reward_terms.sum() < -5.0 / FLIGHT  # and only once


def test_a_craft_that_is_too_far_from_its_slot_is_lost():
    batch = begin(FaultDiagnosis(faults=[]), worlds=2)
    batch.fleet.write(at.POSITION, np.array([[[0.0, 480.0, 0.0]], [[0.0, 520.0, 0.0]]]))
    assert batch.step(nothing(2)).terminated.tolist() == [False, True]


# ---- The flight --------------------------------------------------------------------------------------------


def test_every_thruster_fires_enough_in_every_sound_flight():
    batch = begin(FaultDiagnosis(faults=[]), worlds=200)
    on_times, pulses = np.zeros((200, 12)), np.zeros((200, 12))
    for _ in range(FLIGHT):
        batch.step(nothing(200))
        fired = PERIOD * batch.fleet.read(at.DUTIES, 12)[:, 0]
        on_times += fired
        pulses += fired > 0.3
    assert on_times.min() > 15.0  # s
    assert pulses.min() >= 10


def test_what_is_declared_changes_nothing_in_the_flight():
    quiet, loud = (begin(FaultDiagnosis(), worlds=7) for _ in range(2))
    for number in range(40):
        quiet.step(nothing(7))
        loud.step(np.full((7, 1, 2), number % 6))
        assert np.array_equal(quiet.fleet.data, loud.fleet.data)
        assert np.array_equal(quiet.state.slots, loud.state.slots)


def test_slots_change_every_leg_and_fill_the_cube():
    batch = begin(FaultDiagnosis(faults=[], reach=4.0, leg=10), worlds=500)
    drawn = [batch.state.slots[:, 0].copy()]
    for number in range(1, 41):
        batch.step(nothing(500))
        changed = (batch.state.slots[:, 0, :3] != drawn[-1][:, :3]).all(axis=1)
        assert changed.all() if number % 10 == 0 else not changed.any()
        if number % 10 == 0:
            drawn.append(batch.state.slots[:, 0].copy())
    places = np.concatenate(drawn)[:, :3] / 4.0
    assert np.abs(places).max() <= 1.0
    # 2,500 draws: four standard deviations of a mean, and of a variance, of the uniform distribution.
    np.testing.assert_allclose(places.mean(axis=0), 0.0, atol=4.0 / np.sqrt(3.0 * 2500))
    np.testing.assert_allclose((places**2).mean(axis=0), 1.0 / 3.0, atol=4.0 * 0.298 / np.sqrt(2500))
    assert np.abs(np.corrcoef(places.T) - np.eye(3)).max() < 4.0 / np.sqrt(2500)
    assert not np.concatenate(drawn)[:, 3:].any()


def test_by_default_the_cube_suits_the_vehicle():
    """A third of 0.03 m/s on Orion, at 0.002 m/s asked for in a period for each m of distance."""
    assert Parameters(*begin(FaultDiagnosis()).state.model.parameters).reach == pytest.approx(5.0, rel=1e-12)
    batch = begin(
        FaultDiagnosis(spacecraft="spheres", faults={"probability": 1.0, "kinds": ["stuck_off"]}), 100
    )
    for _ in range(FLIGHT):
        assert not batch.step(nothing(100)).terminated.any()


def test_the_declaration_is_in_the_next_observation():
    batch = begin(FaultDiagnosis(), worlds=3)
    declared = np.array([[[0, 4]], [[12, 5]], [[1, 0]]])
    columns = batch.step(declared).observations[:, 0, -18:]
    expected = np.zeros((3, 18))
    expected[1, [11, 17]] = expected[2, [0, 12]] = 1.0
    assert np.array_equal(columns, expected)


def test_a_dead_thruster_shows_in_what_is_projected_on_it():
    batch = begin(FaultDiagnosis(faults=[Fault(8, "stuck_off")]), worlds=100)
    missing, fired = [], []
    for _ in range(30):
        observations = batch.step(nothing(100)).observations[:, 0]
        fired.append(observations[:, 13 + 7])
        missing.append(observations[:, 25 + 12 + 7])
    fired, missing = np.concatenate(fired), np.concatenate(missing)
    assert np.corrcoef(fired, missing)[0, 1] < -0.9


# ---- One's own pilot ---------------------------------------------------------------------------------------


def test_ones_own_pilot_flies_by_what_the_flight_software_sees():
    seen = []

    def pilot(sight):
        seen.append(sight)
        return np.where(np.arange(12) == 4, 2.0, 0.25) * np.ones((5, 1))

    batch = begin(FaultDiagnosis(faults=[], pilot=pilot), worlds=5)
    measured, slots = batch.fleet.read(at.MEASURED, 13)[:, 0], batch.state.slots[:, 0].copy()
    batch.step(nothing(5))
    changes = batch.fleet.read(at.MEASURED_CHANGE, 12)[:, 0]
    batch.step(nothing(5))
    first, second = seen
    assert np.array_equal(
        np.concatenate((first.position, first.velocity, first.attitude, first.rate), axis=1), measured
    )
    assert np.array_equal(first.target, slots)
    assert first.time.tolist() == 5 * [0.0]
    assert not first.duties.any()
    assert second.time.tolist() == 5 * [PERIOD]
    assert second.duties[0].tolist() == 4 * [0.25] + [1.0] + 7 * [0.25]  # clipped
    assert np.array_equal(np.concatenate((second.measured_change, second.expected_change), axis=1), changes)


def test_the_scripted_pilot_could_be_ones_own():
    scripted = begin(FaultDiagnosis(), worlds=6)

    def pilot(sight):
        law = scripted.state.model.pilot
        data = np.zeros((1, at.DUTIES + 12, 6))
        data[0, at.FRAME_RATE + 1] = scripted.task.vehicle.mean_motion
        data[0, at.MEASURED : at.MEASURED + 13] = np.concatenate(
            (sight.position, sight.velocity, sight.attitude, sight.rate), axis=1
        ).T
        law.fly(data, sight.target[:, np.newaxis], 0, 1, 6)
        return data[0, at.DUTIES :].T

    own = begin(FaultDiagnosis(pilot=pilot), worlds=6)
    for _ in range(50):
        first, second = scripted.step(nothing(6)), own.step(nothing(6))
        assert np.array_equal(first.observations, second.observations)


@pytest.mark.parametrize(
    ("duties", "message"),
    [
        (np.zeros((3, 11)), r"shape \(3, 11\); \(3, 12\) would be right"),
        (np.where(np.arange(36).reshape(3, 12) == 26, np.nan, 0.0), "world 2, thruster 3 is nan"),
    ],
)
def test_a_pilot_that_gives_no_duties_is_refused(duties, message):
    batch = begin(FaultDiagnosis(pilot=lambda _: duties), worlds=3)
    with pytest.raises(ValueError, match=message):
        batch.step(nothing(3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"pilot": 3}, "pilot is 3; None or a callable"),
        ({"leg": 0}, "leg is 0; a whole number from 1 to 120"),
        ({"reach": -1.0}, "reach is -1.0"),
        ({"false_alarm_cost": np.inf}, "false_alarm_cost is inf"),
        ({"rate_limit": 0.0}, "rate_limit is 0.0"),
    ],
)
def test_a_bad_argument_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        FaultDiagnosis(**arguments)
