"""Training is a function of its settings: repeated, interrupted or not, it gives the same bits."""

import os

import numpy as np
import pytest
import torch

from thruster_agents.ppo import train

ROLLOUT = 8 * 32


class _Interruption(Exception):
    pass


def _interrupt_after(rollouts):
    def progress(steps, point):
        if steps == rollouts * ROLLOUT:
            raise _Interruption

    return progress


def _parameters(trained):
    return {name: value.numpy().copy() for name, value in trained.model.policy.state_dict().items()}


def _same(first, second):
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)


@pytest.mark.parametrize("form", ["beliefs", "duties"])
@pytest.mark.parametrize("rollouts", [1, 3, 4])
def test_an_interrupted_training_ends_with_the_same_bits(small, tmp_path, form, rollouts):
    """Before the first checkpoint, between two, at one: with other random numbers drawn in between."""
    whole = train(small(form), tmp_path / "whole")
    with pytest.raises(_Interruption):
        train(small(form), tmp_path / "broken", progress=_interrupt_after(rollouts))
    torch.manual_seed(99)
    np.random.seed(99)  # noqa: NPY002  # the generator that SB3 draws from
    resumed = train(small(form), tmp_path / "broken")
    assert _same(_parameters(whole), _parameters(resumed))
    assert whole.curve == resumed.curve
    assert [point.steps for point in resumed.curve] == [0, 2 * ROLLOUT, 4 * ROLLOUT, 6 * ROLLOUT]
    optimizers = [one.model.policy.optimizer.state_dict()["state"] for one in (whole, resumed)]
    for k, moments in optimizers[0].items():
        assert all(torch.equal(value, optimizers[1][k][name]) for name, value in moments.items())


def test_an_interruption_while_the_checkpoint_is_written_leaves_the_last_one(small, tmp_path, monkeypatch):
    whole = train(small(), tmp_path / "whole")
    with pytest.raises(_Interruption):
        train(small(), tmp_path / "broken", progress=_interrupt_after(3))

    def half(_):
        raise _Interruption

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", half)
        with pytest.raises(_Interruption):
            train(small(), tmp_path / "broken")
    assert not list((tmp_path / "broken").glob(".*"))
    assert _same(_parameters(whole), _parameters(train(small(), tmp_path / "broken")))


def test_a_finished_training_is_not_trained_further(small, tmp_path):
    first = _parameters(train(small(), tmp_path))
    again = train(small(), tmp_path)
    assert _same(first, _parameters(again))


def test_seeds_make_a_difference(small, tmp_path):
    first, second = (train(small(seed=seed), tmp_path / str(seed)) for seed in (0, 1))
    assert not _same(_parameters(first), _parameters(second))
