"""Facts of the training of dynamic neurons: the source's criterion, its rule, interruptions, overflow."""

import numpy as np
import pytest
import torch

from tests.agents.pulses import pulses
from thruster_agents.checkpoints import read_tree, write_tree
from thruster_agents.dynamic_neurons import DynamicNetwork, GRUNetwork, StaticNetwork, TrainingSettings, train


def _network(seed=0, **options):
    return DynamicNetwork((2, 10, 1), generator=torch.Generator().manual_seed(seed), **options)


@pytest.fixture(scope="module")
def data():
    """Four healthy pulses at random charge voltages: (voltage, current) now, current one sample later."""
    generator = np.random.default_rng(0)
    voltage, current = pulses(generator.uniform(857.0, 977.0, 4), generator)
    voltage, current = voltage[:, ::5] / 1000.0, current[:, ::5] / 12000.0
    return np.stack([voltage, current], -1)[:, :-1], current[:, 1:]


@pytest.mark.parametrize(
    "settings",
    [
        TrainingSettings(),
        TrainingSettings(gradient="exact"),
        TrainingSettings(optimiser="adam"),
        TrainingSettings(optimiser="adam", gradient="truncated"),
    ],
    ids=lambda settings: f"{settings.optimiser} {settings.gradient}",
)
def test_the_criterion_of_the_source_is_reached(data, settings):
    network = _network()
    record = train(network, *data, settings)
    assert record.reached
    error = np.mean((network.predict(data[0]) - data[1]) ** 2)
    assert record.error == pytest.approx(error, rel=1e-12)
    assert error <= 1e-4 < record.errors[-2]


def test_the_rule_of_the_source_goes_downhill(data):
    """Truncated, plain descent: every step of it, where the rate is small."""
    settings = TrainingSettings(
        optimiser="gradient_descent", gradient="truncated", learning_rate=1e-3, iterations=20
    )
    record = train(_network(), *data, settings)
    assert record.iterations == 20
    assert (np.diff(record.errors) < 0.0).all()


@pytest.mark.parametrize("optimiser", ["lbfgs", "adam"])
def test_an_interrupted_training_ends_with_the_same_bits(data, tmp_path, optimiser):
    whole, parts = _network(), _network()
    settings = TrainingSettings(optimiser=optimiser, stop=0.0, iterations=12)
    record = train(whole, *data, settings)
    file = tmp_path / "low.pt"
    train(parts, *data, TrainingSettings(optimiser=optimiser, stop=0.0, iterations=5), checkpoint=file)
    steps = []
    resumed = train(
        _network(), *data, settings, checkpoint=file, progress=lambda step, error: steps.append(step)
    )
    np.testing.assert_array_equal(resumed.errors, record.errors)
    assert steps == list(range(6, 13))
    other = _network(seed=1)
    train(other, *data, settings, checkpoint=file)
    for one, same in zip(other.parameters(), whole.parameters(), strict=True):
        assert torch.equal(one, same)


def test_overflow_is_stepped_back_from(data):
    """Poles outside of the unit circle within reach of the first step: the error stays finite and falls."""
    network = _network()
    with torch.no_grad():
        network.layers[1].pole_parameters.copy_(torch.tensor([[0.0, -0.999]]))
    record = train(network, *data, TrainingSettings(stop=0.0, iterations=10))
    assert np.isfinite(record.errors).all()
    assert (np.diff(record.errors) < 0.0).all()


def test_a_network_that_overflows_from_the_start_is_refused(data):
    network = _network()
    with torch.no_grad():
        network.layers[1].pole_parameters.copy_(torch.tensor([[0.0, -9.0]]))
    with pytest.raises(ValueError, match="is inf before the first step"):
        train(network, *data)


def test_the_parameters_left_are_the_best_ones(data):
    network = _network()
    settings = TrainingSettings(optimiser="gradient_descent", learning_rate=30.0, stop=0.0, iterations=30)
    record = train(network, *data, settings)
    assert (np.diff(record.errors) > 0.0).any()  # too large a rate
    error = np.mean((network.predict(data[0]) - data[1]) ** 2)
    assert error == pytest.approx(record.errors.min(), rel=1e-12)


def test_other_networks_train_behind_the_same_call(data):
    for network in (StaticNetwork((2, 10, 1)), GRUNetwork(2, 4)):
        record = train(network, *data, TrainingSettings(iterations=3, stop=0.0))
        assert (np.diff(record.errors) < 0.0).all()
    with pytest.raises(ValueError, match="'exact' for a GRUNetwork; 'autograd' would be right"):
        train(GRUNetwork(2, 4), *data, TrainingSettings(gradient="exact"))


def test_truncated_gradients_are_refused_by_a_line_search():
    with pytest.raises(ValueError, match="gradient with L-BFGS is 'truncated'"):
        TrainingSettings(gradient="truncated")


def test_a_checkpoint_of_another_network_is_refused(data, tmp_path):
    train(_network(), *data, TrainingSettings(iterations=1), checkpoint=tmp_path / "low.pt")
    with pytest.raises(ValueError, match="has 96 parameters; 91, those of the network, would be right"):
        train(_network(output_dynamic=False), *data, checkpoint=tmp_path / "low.pt")


def test_a_damaged_checkpoint_gives_way_to_the_one_before_it(data, tmp_path):
    """To the same result; and what it holds is not run, whatever it is."""
    whole, parts = _network(), _network()
    settings = TrainingSettings(stop=0.0, iterations=12, checkpoint_every=4)
    train(whole, *data, settings)
    file = tmp_path / "low.pt"
    train(_network(), *data, TrainingSettings(stop=0.0, iterations=9, checkpoint_every=4), checkpoint=file)
    file.write_bytes(b"\x80\x04cos\nsystem\n")
    with pytest.warns(UserWarning, match=r"low\.pt is damaged .*; going on from an earlier moment"):
        train(parts, *data, settings, checkpoint=file)
    for one, same in zip(parts.parameters(), whole.parameters(), strict=True):
        assert torch.equal(one, same)


@pytest.mark.parametrize(
    ("name", "value"),
    [("best", None), ("errors", ["x"]), ("optimiser", {99: {}}), ("optimiser", {0: {"d": torch.ones(3)}})],
)
def test_a_checkpoint_that_says_something_else_is_refused(data, tmp_path, name, value):
    file = tmp_path / "low.pt"
    train(_network(), *data, TrainingSettings(iterations=1), checkpoint=file)
    write_tree(file, read_tree(file) | {name: value})
    with pytest.raises(ValueError, match=f"low.pt: {name}"):
        train(_network(), *data, checkpoint=file)


def test_threads_of_torch_are_left_as_they_were(data):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        train(_network(), *data, TrainingSettings(iterations=1))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
