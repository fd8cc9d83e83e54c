"""The vector checker finds nothing wrong where all is right, and each defect by the check made for it."""

import json
import re

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.classic_control.cartpole import CartPoleVectorEnv
from gymnasium.spaces import Dict, Discrete, Tuple
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.testing.drift import Drift, DriftVector
from tests.testing.vector_zoo import ZOO
from thruster_envs.testing import VECTOR_CHECK_NAMES, CheckFailed, check_vector_env

IN_EVERY_MODE = 24
IN_ONE_MODE = 1 + 1 + 4


def outcomes(report, outcome):
    return [f"{result.check} [{result.setting}]" for result in report.results if result.outcome == outcome]


def test_an_environment_that_is_right_passes_every_check_in_every_mode():
    report = check_vector_env(DriftVector, Drift)
    assert len(outcomes(report, "passed")) == len(report.results) == 3 * IN_EVERY_MODE + IN_ONE_MODE
    assert report.passed == set(VECTOR_CHECK_NAMES)


def test_gymnasiums_sync_vector_env_passes_every_check_in_every_mode():
    report = check_vector_env("CartPole-v1", vectorization_mode="sync")
    assert len(outcomes(report, "passed")) == len(report.results) == 3 * IN_EVERY_MODE + IN_ONE_MODE


@pytest.mark.parametrize("broken", ZOO, ids=[broken.name for broken in ZOO])
def test_a_defect_is_caught_by_the_check_made_for_it_and_by_no_other(broken):
    report = check_vector_env(
        broken.make_vector,
        broken.make_single,
        steps=40,
        autoreset_modes=broken.modes,
        raise_failures=False,
        **broken.arguments,
    )
    assert report.failed == {broken.check} | broken.also, report
    lines = [line for line in report.failures if line.startswith(broken.check)]
    assert any(broken.says in line for line in lines), lines
    assert not any("\n" in line for line in lines)


def test_the_zoo_has_a_defect_for_every_check():
    assert {broken.check for broken in ZOO} == set(VECTOR_CHECK_NAMES)


# ---- Gymnasium's own ---------------------------------------------------------------------------------------


def test_cart_pole_vector_env_draws_all_copies_from_one_generator():
    report = check_vector_env(CartPoleVectorEnv, "CartPole-v1", raise_failures=False)
    assert report.failed == {"copies_are_independent", "batch_size_does_not_matter", "equals_single_copies"}
    assert outcomes(report, "not applicable") == ["seed_lists [NEXT_STEP]"]
    assert {result.setting for result in report.results} == {"NEXT_STEP"}


def test_a_check_is_skipped_with_a_reason_that_the_report_repeats():
    reason = "CartPoleVectorEnv draws all copies from one generator"
    skip = dict.fromkeys(
        ["copies_are_independent", "batch_size_does_not_matter", "equals_single_copies"], reason
    )
    report = check_vector_env("CartPole-v1", skip=skip)
    assert len(outcomes(report, "skipped")) == 3
    assert f"skipped        equals_single_copies [NEXT_STEP] {reason}" in str(report)


def test_sync_vector_env_without_copies_hands_out_its_buffer():
    def make(num_envs, autoreset_mode):
        return SyncVectorEnv(
            [lambda: gym.make("CartPole-v1")] * num_envs, copy=False, autoreset_mode=autoreset_mode
        )

    report = check_vector_env(make, "CartPole-v1", raise_failures=False)
    assert report.failed == {"returned_data_stays", "returned_data_is_not_shared"}


class Nested(gym.Env):
    """Observations in a Dict of Tuples, discrete actions, text and missing entries in infos."""

    observation_space = Dict({"pair": Tuple([Drift.observation_space, Discrete(5)]), "count": Discrete(3)})
    action_space = Dict({"which": Discrete(3), "how": Drift.action_space})

    def observation(self):
        return {
            "pair": (self.np_random.uniform(-1.0, 1.0, 2).astype(np.float32), self.np_random.integers(5)),
            "count": np.int64(self.clock % 3),
        }

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.clock = 0
        return self.observation(), {"phase": "begin"}

    def step(self, action):
        self.clock += 1
        info = {"phase": "fly", "odd": np.ones(2)} if self.clock % 2 else {"phase": "fly"}
        return self.observation(), float(action["how"][0]), bool(self.np_random.random() < 0.1), False, info


def test_nested_spaces_and_entries_that_come_and_go_are_compared_to_the_last():
    def make(num_envs, autoreset_mode):
        return SyncVectorEnv([Nested] * num_envs, autoreset_mode=autoreset_mode)

    report = check_vector_env(make, Nested, steps=40)
    assert report.passed == set(VECTOR_CHECK_NAMES)


# ---- how it is called --------------------------------------------------------------------------------------


def test_without_a_single_environment_the_copies_are_compared_with_batches_of_one():
    report = check_vector_env(DriftVector, steps=40, autoreset_modes=["Disabled"])
    assert outcomes(report, "not applicable") == ["equals_single_copies [DISABLED]"]
    assert "batch_size_does_not_matter" in report.passed


def test_a_maker_that_takes_nothing_is_checked_in_the_mode_that_it_states():
    report = check_vector_env(lambda: DriftVector(4, AutoresetMode.SAME_STEP), Drift, steps=40)
    assert {result.setting for result in report.results} == {"SAME_STEP"}
    assert outcomes(report, "not applicable") == ["batch_size_does_not_matter [SAME_STEP]"]


def test_a_maker_that_takes_anything_is_tried_out():
    report = check_vector_env(lambda **arguments: DriftVector(**arguments), Drift, steps=40)
    assert len(outcomes(report, "passed")) == len(report.results) == 3 * IN_EVERY_MODE + IN_ONE_MODE


def test_arguments_go_to_both_makers():
    report = check_vector_env(DriftVector, Drift, steps=40, autoreset_modes=["SameStep"], max_episode_steps=3)
    assert "equals_single_copies" in report.passed


def test_a_registered_native_environment_is_checked_by_its_id_alone():
    gym.register("test/Drift-v0", entry_point=Drift, vector_entry_point=DriftVector)
    try:
        report = check_vector_env("test/Drift-v0", steps=40, max_episode_steps=5)
    finally:
        del gym.registry["test/Drift-v0"]
    assert report.environment == "test/Drift-v0"
    assert len(outcomes(report, "passed")) == len(report.results) == 3 * IN_EVERY_MODE + IN_ONE_MODE


def test_an_id_may_name_the_module_that_registers_it():
    report = check_vector_env("gymnasium.envs:CartPole-v1", only=["spaces"])
    assert outcomes(report, "passed") == ["spaces [NEXT_STEP]"]


def test_small_differences_pass_within_a_tolerance():
    class Rounding(DriftVector):
        def rewards(self, actions):
            return super().rewards(actions) * (1.0 + 1e-12)

    assert check_vector_env(
        Rounding, Drift, steps=40, autoreset_modes=["SameStep"], raise_failures=False
    ).failed == {"equals_single_copies"}
    assert not check_vector_env(
        Rounding, Drift, steps=40, autoreset_modes=["SameStep"], tolerance=1e-9
    ).failed


def test_an_entry_of_info_that_is_ignored_may_be_anything():
    class WithAClock(DriftVector):
        ticks = 0

        def infos(self):
            WithAClock.ticks += 1
            now = np.full(self.num_envs, float(WithAClock.ticks))
            return {
                **super().infos(),
                "wall_clock": now,
                "_wall_clock": np.ones(self.num_envs, dtype=np.bool_),
            }

    assert (
        "seed_reproduces"
        in check_vector_env(
            WithAClock, Drift, steps=40, autoreset_modes=["SameStep"], raise_failures=False
        ).failed
    )
    assert not check_vector_env(
        WithAClock, Drift, steps=40, autoreset_modes=["SameStep"], ignore_info=["wall_clock"]
    ).failed


def test_all_failures_are_raised_together_one_line_each():
    class TwoDefects(DriftVector):
        def rewards(self, actions):
            return super().rewards(actions) / self.num_envs

        def accept_mask(self, mask):
            return mask

    with pytest.raises(CheckFailed) as caught:
        check_vector_env(TwoDefects, steps=40)
    head, *lines = str(caught.value).splitlines()
    assert head == f"TwoDefects failed 2 of {len(VECTOR_CHECK_NAMES)} checks:"
    assert [line.split(" ")[2] for line in lines] == [
        "batch_size_does_not_matter",
        "bad_reset_masks_are_refused",
    ]
    assert "[NEXT_STEP, SAME_STEP, DISABLED]" in lines[0]
    assert caught.value.report.failures == tuple(line.strip() for line in lines)


def test_checks_that_stand_on_a_failed_one_are_not_run():
    class NoSpace(DriftVector):
        def __init__(self, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP):
            super().__init__(num_envs, autoreset_mode)
            self.action_space = None

    report = check_vector_env(NoSpace, raise_failures=False, autoreset_modes=["SameStep"])
    assert outcomes(report, "passed") == ["can_be_made [SAME_STEP]"]
    assert {result.message for result in report.results[2:]} == {"spaces comes first"}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"num_envs": 1}, "num_envs is 1; pass at least 2"),
        ({"steps": 3}, "steps is 3; checks need at least 10"),
        ({"skip": {"equals_single": "why not"}}, "the nearest is 'equals_single_copies'"),
        ({"skip": {"spaces": ""}}, "skip['spaces'] is empty; say in a few words why"),
        (
            {"only": ["masked_resets"]},
            "only names the check 'masked_resets', which does not exist; the nearest",
        ),
        (
            {"autoreset_modes": ["Never"]},
            "autoreset_modes has 'Never'; it takes NextStep, SameStep, Disabled",
        ),
    ],
)
def test_a_wrong_argument_is_named(arguments, says):
    with pytest.raises(ValueError, match=re.escape(says)):
        check_vector_env(DriftVector, Drift, **arguments)


def test_a_mode_that_the_maker_cannot_be_asked_for_is_refused():
    with pytest.raises(ValueError, match="takes no autoreset_mode and makes environments in NEXT_STEP"):
        check_vector_env(CartPoleVectorEnv, autoreset_modes=["SameStep"])


def test_an_environment_that_was_already_made_is_refused():
    with pytest.raises(TypeError, match="not an environment that was already made"):
        check_vector_env(DriftVector())


def test_the_report_is_plain_data():
    report = check_vector_env(DriftVector, only=["spaces"], autoreset_modes=["NextStep"])
    (result,) = report.results
    assert json.loads(json.dumps(result.__dict__)) == {
        "check": "spaces",
        "setting": "NEXT_STEP",
        "outcome": "passed",
        "message": "",
    }
