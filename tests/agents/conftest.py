"""What the tests of the agents share: Orion, and a training small enough to be repeated."""

import pytest
import torch

import train
from tests.agents.runs import TINY
from thruster_agents.ppo import Settings
from thruster_envs.spacecraft import Spacecraft, load


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    """Sums of floats are in one order only with one thread; with more, tests run side by side would wait."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def orion() -> Spacecraft:
    return load("orion")


@pytest.fixture
def small(orion):
    """Makes settings of a training of six rollouts of eight worlds, a checkpoint after every second."""

    def settings(form: str = "beliefs", seed: int = 0) -> Settings:
        return Settings(
            spacecraft=orion,
            form=form,
            seed=seed,
            steps=6 * 8 * 32,
            worlds=8,
            learning_rate=3e-3,
            minibatch=64,
            epochs=2,
            discount=0.5,
            trace=0.9,
            exploration=0.7,
            checkpoint_every=2,
            validate_every=2,
            validation_worlds=4,
        )

    return settings


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    """A finished run, tiny."""
    parent = tmp_path_factory.mktemp("runs")
    results = parent / "results.md"
    assert train.main([*TINY, "--runs", str(parent), "--results", str(results), "--name", "tiny"]) == 0
    (folder,) = (path for path in parent.iterdir() if path.is_dir())
    return folder
