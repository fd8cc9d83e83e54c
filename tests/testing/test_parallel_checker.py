"""The parallel checker finds nothing wrong where all is right, and each defect by the check made for it."""

import re

import pettingzoo
import pytest

from tests.testing.drift import DriftParallel
from tests.testing.parallel_zoo import ZOO, IsRandomFromTheThirdStepOn
from thruster_envs.testing import (
    PARALLEL_CHECK_NAMES,
    CheckFailed,
    check_parallel_env,
    check_parallel_env_seed,
)


def test_an_environment_that_is_right_passes_every_check():
    report = check_parallel_env(DriftParallel, another_process=True)
    assert report.passed == set(PARALLEL_CHECK_NAMES)


@pytest.mark.parametrize("broken", ZOO, ids=[broken.name for broken in ZOO])
def test_a_defect_is_caught_by_the_check_made_for_it_and_by_no_other(broken):
    report = check_parallel_env(broken.make_env, steps=60, raise_failures=False, **broken.arguments)
    assert report.failed == {broken.check}, report
    (line,) = report.failures
    assert broken.says in line


def test_the_zoo_has_a_defect_for_every_check():
    assert {broken.check for broken in ZOO} == set(PARALLEL_CHECK_NAMES)


def test_the_seed_check_alone_sees_what_turns_random_at_the_third_step():
    assert check_parallel_env_seed(DriftParallel).passed == {
        "agents_stay",
        "seed_reproduces",
        "seeds_differ",
        "reset_goes_on",
    }
    with pytest.raises(CheckFailed, match="step 3"):
        check_parallel_env_seed(IsRandomFromTheThirdStepOn)


def test_an_environment_is_named_by_its_pettingzoo_id():
    pettingzoo.register("parallel", "test/Drift-v0", "tests.testing.drift:DriftParallel")
    try:
        with pytest.warns(UserWarning, match="expected to be an instance of ParallelEnv"):
            report = check_parallel_env("test/Drift-v0", max_cycles=5, another_process=True)
    finally:
        del pettingzoo.parallel_registry["test/Drift-v0"]
    assert report.environment == "test/Drift-v0"
    assert report.passed == set(PARALLEL_CHECK_NAMES)


def test_what_cannot_be_sent_to_another_process_is_refused():
    with pytest.raises(
        ValueError, match=re.escape("pass an id or a function that stands at the top of a module")
    ):
        check_parallel_env(lambda: DriftParallel(), another_process=True)
