"""Facts of dynamic neurons: their filter, their poles, their gradients, their own output fed back."""

import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from thruster_agents.dynamic_neurons import (
    DynamicLayer,
    DynamicNetwork,
    DynamicNeuron,
    GRUNetwork,
    StaticNetwork,
    dynamic_back_propagation,
    recursive_filter,
)
from thruster_agents.dynamic_neurons.layers import denominator

NETWORKS = {
    "source": lambda generator: DynamicNetwork((2, 10, 1), generator=generator),
    "static output": lambda generator: DynamicNetwork((2, 10, 1), output_dynamic=False, generator=generator),
    "deep, stable, biased": lambda generator: DynamicNetwork(
        (3, 4, 3, 1), order=3, stable=True, bias=True, memory=(2.0, 20.0), generator=generator
    ),
    "static": lambda generator: StaticNetwork((2, 10, 1), bias=True, generator=generator),
}


def _generator(seed=0):
    return torch.Generator().manual_seed(seed)


def _noise(generator, *shape):
    return torch.randn(*shape, dtype=torch.float64, generator=generator)


def _case(name, batch=3, samples=60):
    """A network, inputs and targets."""
    generator = _generator()
    network = NETWORKS[name](generator)
    return network, _noise(generator, batch, samples, network.inputs), _noise(generator, batch, samples, 1)


def _gradients(network):
    return torch.cat([parameter.grad.flatten() for parameter in network.parameters()])


def _error(network, inputs, targets):
    return (network(inputs) - targets).square().mean()


def _loop_filter(signal, feedforward, feedback):
    """What `recursive_filter` gives, sample by sample; autograd differentiates it."""
    filtered = []
    for k in range(signal.shape[1]):
        now = feedforward[:, 0] * signal[:, k]
        for j in range(1, min(feedback.shape[1], k) + 1):
            now = now + feedforward[:, j] * signal[:, k - j] - feedback[:, j - 1] * filtered[k - j]
        filtered.append(now)
    return torch.stack(filtered, dim=1)


def test_the_package_of_agents_loads_no_torch():
    code = "import sys, thruster_agents; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("order", [1, 2, 5])
def test_the_filter_is_scipys(order):
    generator = _generator(order)
    signal, feedforward = _noise(generator, 2, 50, 3), _noise(generator, 3, order + 1)
    feedback = _noise(generator, 3, order) / order
    ours = recursive_filter(signal, feedforward, feedback)
    for channel in range(3):
        theirs = lfilter(feedforward[channel], [1.0, *feedback[channel]], signal[..., channel], axis=1)
        np.testing.assert_allclose(ours[..., channel], theirs, rtol=1e-10, atol=1e-10 * abs(theirs).max())


def test_the_gradient_of_the_filter_is_that_of_a_loop_over_the_samples():
    generator = _generator()
    arguments = [_noise(generator, 2, 40, 3), _noise(generator, 3, 4), 0.3 * _noise(generator, 3, 3)]
    arguments = [argument.requires_grad_() for argument in arguments]
    against = _noise(generator, 2, 40, 3)
    for ours, theirs in zip(
        torch.autograd.grad((recursive_filter(*arguments) * against).sum(), arguments),
        torch.autograd.grad((_loop_filter(*arguments) * against).sum(), arguments),
        strict=True,
    ):
        torch.testing.assert_close(ours, theirs, rtol=1e-11, atol=1e-11)


def test_coefficients_of_another_size_are_refused():
    with pytest.raises(ValueError, match=r"feedback \(3, 2\); \(2, r \+ 1\) and \(2, r\) would be right"):
        recursive_filter(torch.zeros(1, 5, 2), torch.zeros(2, 3), torch.zeros(3, 2))


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
@given(seed=st.integers(0, 2**31), size=st.floats(0.1, 20.0))
@settings(max_examples=30, deadline=None)
def test_stable_poles_never_leave_the_unit_circle(order, seed, size):
    parameters = size * _noise(_generator(seed), 4, order)
    for polynomial in denominator(parameters, stable=True).numpy():
        # roots of multiplicity r are found to within the r-th root of the rounding error only
        assert abs(np.roots(polynomial)).max() < 1.0 + 1e-15 ** (1.0 / order)


def test_any_stable_section_can_be_had():
    """Parameters that give any point of the triangle of stable second-order sections exist."""
    wanted = np.array([[-1.9, 0.95], [1.5, 0.6], [0.0, -0.9], [0.3, -0.6]])
    second, first = np.arctanh(wanted[:, 1]), np.arctanh(wanted[:, 0] / (1.0 + wanted[:, 1]))
    found = denominator(torch.tensor(np.stack([first, second], 1)), stable=True)[:, 1:]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_poles_begin_with_the_memory_asked_for(order):
    layer = DynamicLayer(2, 6, order=order, stable=True, memory=(5.0, 80.0), generator=_generator())
    for coefficients in layer.feedback.detach().numpy():
        poles = np.roots([1.0, *coefficients])
        constants = -1.0 / np.log(abs(poles))
        assert ((constants > 4.999) & (constants < 80.001)).all()
        assert (abs(np.angle(poles)) < 3.0 / constants + 1e-9).all()


def test_constants_come_through_a_slow_filter_as_large_as_they_would_without_it():
    layer = DynamicLayer(1, 5, stable=True, memory=(5.0, 20.0), activation="linear", generator=_generator())
    settled = layer(torch.ones(1, 500, 1, dtype=torch.float64))[0, -1]
    expected = layer.weight[:, 0] * layer.feedforward.sum(dim=1)
    torch.testing.assert_close(settled, expected, rtol=1e-6, atol=1e-9)


def test_memory_of_free_poles_is_refused():
    with pytest.raises(ValueError, match=r"free poles is \(5.0, 20.0\); None, or stable poles, would"):
        DynamicLayer(1, 5, memory=(5.0, 20.0))


def test_free_and_stable_poles_begin_alike():
    free, stable = (DynamicLayer(2, 6, order=2, stable=s, generator=_generator()) for s in (False, True))
    torch.testing.assert_close(free.feedback, stable.feedback, rtol=1e-12, atol=1e-12)


def test_a_neuron_is_the_equation_of_the_source():
    neuron = DynamicNeuron(3, bias=True, generator=_generator())
    with torch.no_grad():
        neuron.bias.fill_(0.2)
        neuron.slope.fill_(0.7)
    inputs = _noise(_generator(1), 1, 30, 3)
    summed = inputs[0] @ neuron.weight[0] + 0.2
    filtered = lfilter(
        neuron.feedforward[0].detach(), [1.0, *neuron.feedback[0].detach()], summed.detach().numpy()
    )
    np.testing.assert_allclose(neuron(inputs)[0, :, 0].detach(), np.tanh(0.7 * filtered), atol=1e-13)


def test_one_generator_state_one_network():
    first, second, other = (NETWORKS["source"](_generator(seed)) for seed in (3, 3, 4))
    vectors = [torch.nn.utils.parameters_to_vector(one.parameters()) for one in (first, second, other)]
    assert torch.equal(vectors[0], vectors[1])
    assert not torch.equal(vectors[0], vectors[2])


def test_the_gradient_of_the_sources_network_is_that_of_finite_differences():
    network, inputs, targets = _case("source", batch=1, samples=200)
    _error(network, inputs, targets).backward()
    parameters = torch.nn.utils.parameters_to_vector(network.parameters()).detach()
    differences = torch.empty_like(parameters)
    step = 1e-5
    for i in range(len(parameters)):
        sides = []
        for sign in (1.0, -1.0):
            moved = parameters.clone()
            moved[i] += sign * step
            torch.nn.utils.vector_to_parameters(moved, network.parameters())
            sides.append(_error(network, inputs, targets).item())
        differences[i] = (sides[0] - sides[1]) / (2.0 * step)
    largest = differences.abs().max()
    assert ((_gradients(network) - differences).abs().max() / largest).item() < 1e-6


@pytest.mark.parametrize("name", NETWORKS)
def test_exact_dynamic_back_propagation_is_autograd(name):
    network, inputs, targets = _case(name)
    error = _error(network, inputs, targets)
    error.backward()
    expected = _gradients(network)
    network.zero_grad()
    found = dynamic_back_propagation(network, inputs, targets, truncated=False)
    assert found.item() == pytest.approx(error.item(), rel=1e-12)
    torch.testing.assert_close(_gradients(network), expected, rtol=1e-9, atol=1e-12)


def test_truncating_loses_nothing_where_the_output_has_no_dynamics():
    network, inputs, targets = _case("source")
    output = network.layers[1]
    with torch.no_grad():
        output.feedforward[:, 1:] = 0.0
        output.pole_parameters.zero_()
    dynamic_back_propagation(network, inputs, targets, truncated=False)
    exact = _gradients(network)
    dynamic_back_propagation(network, inputs, targets, truncated=True)
    torch.testing.assert_close(_gradients(network), exact, rtol=1e-12, atol=1e-14)


def test_truncating_touches_the_hidden_layer_only():
    network, inputs, targets = _case("source")
    dynamic_back_propagation(network, inputs, targets, truncated=False)
    exact = [parameter.grad.clone() for parameter in network.parameters()]
    dynamic_back_propagation(network, inputs, targets, truncated=True)
    truncated = [parameter.grad for parameter in network.parameters()]
    hidden = len(list(network.layers[0].parameters()))
    assert all(torch.equal(*pair) for pair in zip(exact[hidden:], truncated[hidden:], strict=True))
    for one, other in zip(exact[:hidden], truncated[:hidden], strict=True):
        assert (one - other).abs().max() > 0.1 * one.abs().max()


@pytest.mark.parametrize("name", [*NETWORKS, "gru"])
def test_parallel_mode_is_prediction_from_the_own_output_one_sample_late(name):
    network = GRUNetwork(2, 4, generator=_generator()) if name == "gru" else NETWORKS[name](_generator())
    inputs = np.random.default_rng(0).normal(size=(35, 50, network.inputs - 1))
    parallel = network.predict_in_parallel(inputs)
    late = np.concatenate([np.zeros((35, 1)), parallel[:, :-1]], axis=1)
    expected = network.predict(np.concatenate([inputs, late[..., None]], axis=2))
    np.testing.assert_allclose(parallel, expected, atol=1e-12 * abs(expected).max())
    without = network.predict(np.concatenate([inputs, np.zeros((35, 50, 1))], axis=2))
    assert abs(expected - without).max() > 1e4 * abs(expected - parallel).max()


def test_in_parallel_mode_a_sequence_does_not_see_the_others():
    network = NETWORKS["source"](_generator())
    inputs = np.random.default_rng(0).normal(size=(40, 30, 1))
    np.testing.assert_array_equal(
        network.predict_in_parallel(inputs)[33:34], network.predict_in_parallel(inputs[33:34])
    )


def test_inputs_of_another_width_are_refused():
    network = NETWORKS["source"](_generator())
    with pytest.raises(ValueError, match=r"\(1, 5, 2\); \(batch, time, 1\) would be right"):
        network.predict_in_parallel(np.zeros((1, 5, 2)))
