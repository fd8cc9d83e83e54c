"""A formation that turns: the law as a team meets the requirements, and the flight is that of a mission."""

import numpy as np
import pytest

from tests.tasks.flying import begin
from thruster_baselines.control import QuaternionTeam
from thruster_envs.faults import Fault
from thruster_envs.missions import attitude_of, fly_missions
from thruster_envs.physics import rows as at
from thruster_envs.pilots.attitude import AttitudePilot
from thruster_envs.spacecraft import Sensors, load
from thruster_envs.tasks import FormationAttitude

PPT = load("ppt_cubesat")
TEAM = QuaternionTeam(PPT)


def by_law(batch):
    """Options that the scripted law would choose for the commanded craft, from what it measures."""
    task, scratch = batch.task, batch.fleet.data.copy()
    AttitudePilot.of(task.vehicle).fly(scratch, batch.state.targets, 0, task.craft, batch.number)
    rows = scratch[:, at.DUTIES : at.DUTIES + 6].transpose(0, 2, 1).reshape(-1, 6)
    rows = rows[: batch.number * task.craft].reshape(batch.number, task.craft, 6)
    options = np.where(rows[..., ::2] > 0.0, 1, np.where(rows[..., 1::2] > 0.0, 2, 0))
    return options[:, task.first_commanded :][:, : len(task.agents)]


def nothing(batch):
    return np.zeros((batch.number, len(batch.task.agents), 3))


def test_the_classical_team_meets_the_requirements_and_idlers_do_not():
    """The heuristic that proves the task: it acts on observations alone, and scores at least 0.95."""
    batch = begin(FormationAttitude(), worlds=60, seed=1000)
    observations = batch.observe()
    total = np.zeros((60, 2))
    for _ in range(3000):
        step = batch.step(TEAM(observations))
        observations = step.observations
        total += step.rewards
        assert not step.terminated.any()
        assert not step.cost.any()
    truth = batch.task.truth(batch.state)
    assert truth.score.min() >= 0.95
    assert truth.success.all()
    settling = batch.task.report(batch.state)["attitude"]["settling_time"]
    assert 600.0 < settling.min() <= settling.max() < 1000.0
    idle = begin(FormationAttitude(), worlds=60, seed=1000)
    idlers = np.zeros((60, 2))
    for _ in range(3000):
        idlers += idle.step(nothing(idle)).rewards
    assert not idle.task.truth(idle.state).score.any()
    assert (total > 2.0 * idlers).all()


def test_the_same_law_flies_the_same_flight_as_a_mission_to_the_last_bit():
    faults = [
        Fault(1, "conductivity_loss", severity=0.02, craft=2, onset=30.0),
        Fault(4, "late_opening", severity=0.4, craft=3),
    ]
    batch = begin(FormationAttitude(faults=faults, command_leader=True), worlds=4, seed=7)
    missions = fly_missions(batch.state.targets[:, 1:], faults=faults, seeds=7, steps=400)
    np.testing.assert_array_equal(missions.targets, batch.state.targets)
    for k in range(400):
        options = by_law(batch)
        np.testing.assert_array_equal(np.where(options == 2, -1, options), missions.pulses[:, k])
        batch.step(options)
        leader = batch.fleet.read(at.RATE, 3)[:, 0]
        np.testing.assert_array_equal(leader, missions.rate[:, k + 1, 0])
        np.testing.assert_array_equal(
            batch.fleet.read(batch.fleet.rows.delivered, 6) / 0.016, missions.thrust[:, k]
        )


def test_craft_that_nobody_commands_fly_by_the_law():
    flights = []
    for options in ({"commanded": 1}, {}, {"command_leader": True}, {"command_leader": True, "commanded": 2}):
        batch = begin(FormationAttitude(craft=4, **options), worlds=3, seed=5)
        for _ in range(200):
            batch.step(by_law(batch))
        flights.append(batch.fleet.data)
    for other in flights[1:]:
        assert np.array_equal(flights[0], other)


def test_agents_are_the_followers_or_all_and_are_told_of_their_own_faults():
    faults = [Fault(3, "loss", craft=1), Fault(5, "leak", craft=3)]
    followers = begin(FormationAttitude(faults=faults))
    assert followers.task.agents == ("follower_1", "follower_2")
    assert followers.info()["fault"]["thruster"][0, :, 0].tolist() == [0, 5]
    everyone = begin(FormationAttitude(faults=faults, command_leader=True))
    assert everyone.task.agents == ("leader", "follower_1", "follower_2")
    assert everyone.info()["fault"]["thruster"][0, :, 0].tolist() == [3, 0, 5]
    assert begin(FormationAttitude(craft=16)).observe().shape == (1, 15, 21)


def test_targets_fill_the_hull_and_contain_the_missions_of_the_source():
    batch = begin(FormationAttitude(), worlds=4000)
    q = batch.state.targets[:, 1:].reshape(-1, 4) * (1, -1, -1, -1)
    w, x, y, z = q.T
    roll = np.degrees(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    pitch = np.degrees(np.arcsin(2.0 * (w * y - z * x)))
    yaw = np.degrees(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    for angle, low, high in ((roll, 20, 35), (pitch, 30, 50), (yaw, 40, 60)):
        assert low - 1e-9 <= angle.min() < low + 0.1
        assert high - 0.1 < angle.max() <= high + 1e-9
        assert angle.mean() == pytest.approx(0.5 * (low + high), abs=4.0 * (high - low) / np.sqrt(12 * 8000))
    assert abs(np.corrcoef(roll[::2], roll[1::2])[0, 1]) < 4.0 / np.sqrt(4000)
    fixed = begin(
        FormationAttitude(roll_degrees=(25.0, 25.0), pitch_degrees=(40.0, 40.0), yaw_degrees=(55.0, 55.0))
    )
    np.testing.assert_allclose(
        fixed.state.targets[0, 1:], np.tile(attitude_of([25, 40, 55], degrees=True), (2, 1)), atol=1e-15
    )


def test_new_targets_come_within_the_episode_and_the_count_begins_anew():
    batch = begin(FormationAttitude(retarget_interval=50), worlds=2)
    seen = [batch.state.targets.copy()]
    for k in range(1, 151):
        batch.step(by_law(batch))
        if k % 50 == 0:
            assert not np.array_equal(batch.state.targets[:, 1:], seen[-1][:, 1:])
            seen.append(batch.state.targets.copy())
        else:
            assert np.array_equal(batch.state.targets, seen[-1])
        assert (batch.state.targets[:, 0] == (1.0, 0.0, 0.0, 0.0)).all()
    again = begin(FormationAttitude(retarget_interval=50), worlds=2)
    assert np.array_equal(again.state.targets, seen[0])


def test_the_outcome_of_a_period_is_that_of_the_target_it_was_flown_for():
    """Also of the last period of an episode, whose end may set a new target."""
    batch, plain = (begin(FormationAttitude(retarget_interval=interval), worlds=2) for interval in (30, None))
    for _ in range(30):
        one, two = batch.step(by_law(batch)), plain.step(by_law(plain))
    assert np.array_equal(one.rewards, two.rewards)
    assert np.array_equal(batch.info()["score"], plain.info()["score"])
    assert not np.array_equal(one.observations, two.observations)
    batch.step(nothing(batch))
    batch.step(nothing(batch))
    assert not np.array_equal(batch.info()["score"], plain.info()["score"])
    assert (batch.info()["score"] < 0.5).all()


def test_a_retargeted_formation_succeeds_at_its_second_target():
    batch = begin(FormationAttitude(retarget_interval=1500), worlds=5)
    for _ in range(3000):
        step = batch.step(TEAM(batch.observe()))
    assert not step.terminated.any()
    assert batch.task.truth(batch.state).success.all()


def test_what_a_step_is_worth_is_what_the_page_says():
    task = FormationAttitude(
        balance_price=2.0, pulse_price=3.0, gravity_gradient=False, bias_torque=(0, 0, 0), command_leader=True
    )
    batch = begin(task)
    batch.step(np.array([[[1, 0, 0], [1, 2, 0], [0, 0, 0]]]))
    step = batch.step(np.array([[[0, 0, 0], [1, 2, 1], [0, 0, 0]]]))
    angle = batch.task.report(batch.state)["attitude"]["error"]
    w = batch.state.targets[0, 1:, 0]
    np.testing.assert_allclose(angle[0, 1:], 2.0 * np.arccos(w), rtol=1e-3)
    pointing, balance, pulses, lost = np.moveaxis(step.reward_terms[0], -1, 0)
    error = 0.5 * (angle[0] / np.pi + angle[0] / (angle[0] + 0.05))
    np.testing.assert_allclose(pointing, 7.0 / 3000.0 * (1.0 - error), rtol=1e-12)
    np.testing.assert_allclose(pulses, [0.007, 0.0, 0.007], atol=1e-12)  # one pulse on each axis
    # 1, 5 and no pulses so far, 2 in the mean.
    np.testing.assert_allclose(balance, [7.0 / 1500.0, 0.0, 7.0 / 1500.0], atol=1e-12)
    assert not lost.any()
    np.testing.assert_allclose(batch.task.truth(batch.state).fuel[0], [0.016, 0.08, 0.0], rtol=1e-12)
    np.testing.assert_allclose(batch.observe()[0, :, 20], [-0.5, 1.5, -1.0], rtol=1e-6)
    assert batch.observe()[0, 1, 14:20].tolist() == [1.0, 0.0, 0.0, 1.0, 1.0, 0.0]


def test_the_observation_is_the_error_the_rate_and_the_target():
    vehicle = PPT.replace(sensors=Sensors())
    batch = begin(FormationAttitude(spacecraft=vehicle, command_leader=True))
    leader, follower = attitude_of([5, -3, 2], degrees=True), attitude_of([1, 20, 30], degrees=True)
    attitude = np.stack([leader, follower, follower])
    batch.fleet.write(at.ATTITUDE, attitude[np.newaxis])
    batch.fleet.write(at.MEASURED + 6, attitude[np.newaxis])
    rates = np.array([[1e-3, 0, 0], [0, 2e-3, 1e-3], [0, 0, 0]])
    batch.fleet.write(at.RATE, rates[np.newaxis])
    batch.fleet.write(at.MEASURED + 10, rates[np.newaxis])
    seen = batch.observe()[0].astype(float)

    def matrix(q):
        w, x, y, z = q
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    target = batch.state.targets[0, 1]
    relative = matrix(follower) @ matrix(leader).T
    np.testing.assert_allclose(matrix(seen[1, :4]), relative @ matrix(target).T, atol=1e-6)
    np.testing.assert_allclose(seen[1, 7:10], 1e3 * (rates[1] - relative @ rates[0]), atol=1e-6)
    np.testing.assert_allclose(seen[1, 10:14], target, atol=1e-7)
    np.testing.assert_allclose(seen[0, :4], leader, atol=1e-7)
    np.testing.assert_allclose(seen[0, 4:7], np.clip(-2.0 * leader[1:] / 0.05, -1.0, 1.0), atol=1e-6)
    assert seen[0, 10:14].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_standing_still_is_no_merit_and_a_slow_rate_counts_where_the_attitude_is_right():
    batch = begin(FormationAttitude(spacecraft=PPT.replace(sensors=Sensors()), command_leader=True), worlds=2)
    report = batch.task.report(batch.state)["attitude"]
    assert report["requirements_met"].tolist() == [[6, 0, 0]] * 2
    assert batch.info()["score"].tolist() == [[1.0, 0.0, 0.0]] * 2
    attitude = batch.state.targets.copy()
    rates = np.zeros((2, 3, 3))
    rates[0, 1, 0] = 1e-4  # too fast about x, in the right attitude
    half = np.array([0.0, np.sin(0.01), 0.0])  # 0.02 rad off about y, without a rate
    off = np.concatenate([[np.cos(0.01)], half])
    w, v, u = attitude[0, 2, 0], attitude[0, 2, 1:], half
    attitude[0, 2] = np.concatenate([[off[0] * w - u @ v], off[0] * v + w * u + np.cross(u, v)])
    batch.fleet.write(at.ATTITUDE, attitude)
    batch.fleet.write(at.RATE, rates)
    batch.step(nothing(batch))
    assert batch.task.report(batch.state)["attitude"]["requirements_met"].tolist() == [[6, 5, 4], [6, 6, 6]]


def test_duties_add_up_to_whole_pulses_and_the_one_that_is_owed_more_fires():
    batch = begin(FormationAttitude(action="duties", faults=[]))
    assert batch.observe().shape == (1, 2, 27)
    duties = np.full((1, 2, 6), -1.0)
    duties[0, 0] = 2.0 * np.array([0.3, 0.0, 1.0, 0.0, 0.5, 0.6]) - 1.0
    fired = []
    for _ in range(20):
        batch.step(duties)
        fired.append(batch.fleet.read(batch.fleet.rows.delivered, 6)[0] / 0.016)
    fired = np.round(np.array(fired)).astype(int)
    assert fired[:, 1, 0].nonzero()[0].tolist() == [3, 6, 9, 13, 16, 19]  # 1.2, 1.1, 1.0, 1.2, ...
    assert fired[:, 1, 2].all()
    assert not (fired[:, 1, 4] & fired[:, 1, 5]).any()
    # Together they ask for more than one pulse a period: none is lost but what exceeds two in debt.
    assert fired[:, 1, 4:].sum() == 19
    assert not fired[:, [0, 2]][:, 1].any()
    owed = batch.observe()[0, 0, 21:27]
    assert owed[0] == pytest.approx(20 * 0.3 - 6, abs=1e-6)


def test_the_team_may_command_duties_and_flies_the_same_flight():
    pulses, duties = begin(FormationAttitude(), seed=3), begin(FormationAttitude(action="duties"), seed=3)
    team = QuaternionTeam(PPT, action="duties")
    for _ in range(300):
        pulses.step(TEAM(pulses.observe()))
        duties.step(team(duties.observe()))
        assert np.array_equal(pulses.fleet.data, duties.fleet.data)


def test_a_craft_that_spins_ends_the_episode_for_all():
    batch = begin(FormationAttitude(), worlds=2)
    rates = np.zeros((2, 3, 3))
    rates[1, 0, 1] = 0.06
    rates[0, 1, 2] = 0.02
    batch.fleet.write(at.RATE, rates)
    step = batch.step(nothing(batch))
    assert step.terminated.tolist() == [False, True]
    assert step.cost[0] == pytest.approx([1.0, 0.0], rel=1e-3)
    truth = batch.task.truth(batch.state)
    assert not truth.success.any()
    assert truth.score[1].tolist() == [0.0, 0.0]


def test_the_oracle_view_shows_the_impulse_of_a_failed_discharge():
    faults = [
        Fault(1, "conductivity_loss", severity=0.008, shared=True, craft=2, onset=1.0),
        Fault(3, "stuck_on", severity=0.25, craft=2),
    ]
    batch = begin(FormationAttitude(faults=faults, observe_fault=True))
    plain = begin(FormationAttitude(faults=faults))
    assert batch.observe()[0, 0, 21:].tolist() == [
        1.0,
        1.0,
        0.0,
        1.0,
        1.0,
        1.0,
        0.0,
        0.0,
        0.25,
        0.0,
        0.0,
        0.0,
    ]
    assert np.array_equal(batch.observe()[..., :21], plain.observe())
    batch.step(nothing(batch))
    np.testing.assert_allclose(batch.observe()[0, 0, 21:23], 0.85, atol=1e-3)
    assert batch.observe()[0, 1, 21:].tolist() == [1.0] * 6 + [0.0] * 6


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"spacecraft": "orion"}, "'orion' has no discharge"),
        ({"craft": 17}, "craft is 17; a whole number from 2 to 16"),
        ({"commanded": 3}, "commanded is 3; a whole number from 1 to 2"),
        ({"action": "torques"}, "action is 'torques'; 'pulses' or 'duties'"),
        ({"yaw_degrees": (60.0, 40.0)}, r"yaw_degrees is \(60.0, 40.0\)"),
        ({"bias_torque": (0.0, 0.0, np.nan)}, "bias_torque, entry 3 is NaN"),
        ({"rate_limit": 0.0}, "rate_limit is 0.0"),
        ({"rate_limit": 0.005}, "rate_limit is 0.005; rate_soft_limit, 0.01, or more"),
        ({"pulse_price": -1.0}, "pulse_price is -1.0"),
        ({"retarget_interval": 0}, "retarget_interval is 0"),
    ],
)
def test_a_wrong_configuration_is_refused_in_one_line(wrong, message):
    with pytest.raises(ValueError, match=message) as caught:
        FormationAttitude(**wrong)
    assert "\n" not in str(caught.value)
