"""A network of dynamic neurons on its own past output (parallel mode), compiled, many sequences side by side.

At each sample the network sees the inputs of that sample and what it gave out one sample before, zero at
first. Nothing in this can be done for all samples at once, so a kernel steps through them; sequences stand in
blocks of lanes, so that the arithmetic of a block is vector arithmetic.

The hyperbolic tangent is a series and six squarings, within 1e-14 of the true one, since a call of the
library's for each lane would take most of the time. Left out: gradients in this mode; the source trains on
measured outputs (series-parallel mode).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from thruster_agents.dynamic_neurons.layers import DynamicLayer
from thruster_envs.kernels import kernel
from thruster_envs.protocols import FloatArray

__all__ = ["run_on_own_output"]

_LANES = 32


def run_on_own_output(layers: list[DynamicLayer], inputs: FloatArray) -> FloatArray:
    """What a cascade of layers gives out, its own output one sample before being its last input.

    Args:
        layers: The last one has one neuron; the first one as many inputs as `inputs` has, and one more.
        inputs: (batch, time, inputs).

    Returns:
        (batch, time).
    """
    order = max(layer.order for layer in layers)
    sizes = np.array([layers[0].inputs, *(layer.units for layer in layers)])
    units, widest = int(sizes[1:].sum()), int(sizes.max())
    weights, rest = np.zeros((units, widest)), np.zeros((units, 2))
    feedforward, feedback = np.zeros((units, order + 1)), np.zeros((units, order))
    feedforward[:, 0] = 1.0
    bent = np.zeros(units, np.bool_)
    first = 0
    for layer in layers:
        own = slice(first, first + layer.units)
        gain = np.ones(layer.units) if layer.gain is None else layer.gain.numpy()
        weights[own, : layer.inputs] = gain[:, np.newaxis] * layer.weight.detach().numpy()
        if layer.bias is not None:
            rest[own, 0] = gain * layer.bias.detach().numpy()
        rest[own, 1] = layer.slope.detach().numpy()
        if layer.order:
            feedforward[own, : layer.order + 1] = layer.feedforward.detach().numpy()
            feedback[own, : layer.order] = layer.feedback.detach().numpy()
        bent[own] = layer.activation == "tanh"
        first += layer.units
    batch, time, _ = inputs.shape
    blocks = -(-batch // _LANES)
    lanes = np.zeros((blocks * _LANES, time, inputs.shape[2]))
    lanes[:batch] = inputs
    lanes = np.ascontiguousarray(lanes.reshape(blocks, _LANES, time, -1).transpose(0, 2, 3, 1))
    output = np.empty((blocks, time, _LANES))
    _run(lanes, sizes, weights, rest, feedforward, feedback, bent, output)
    return np.ascontiguousarray(output.transpose(0, 2, 1).reshape(blocks * _LANES, time)[:batch])


@njit(error_model="numpy")
def _tanh(x):
    """1 - 2 e / (1 + e), odd, of e = exp(-2 |x|) = (exp(-2 |x| / 64))^64; beyond 20 it is 1."""
    size = min(abs(x), 20.0)
    z = -size / 32.0
    e = 1.0 + z / 14.0
    for n in range(13, 0, -1):
        e = 1.0 + z * e / n
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    bent = (1.0 - e) / (1.0 + e)
    return bent if x >= 0.0 else -bent


@kernel(nogil=True)
def _run(inputs, sizes, weights, rest, feedforward, feedback, bent, output):
    """Fills the output (blocks, time, lanes) for inputs (blocks, time, inputs, lanes).

    The past of a neuron's weighted sum and of its filter's output stand in rings of r + 1 samples.
    """
    blocks, time, external, lanes = inputs.shape
    units, depth = feedforward.shape
    summed, filtered = np.empty((units, depth, lanes)), np.empty((units, depth, lanes))
    seen, given = np.empty((weights.shape[1], lanes)), np.empty((weights.shape[1], lanes))
    for block in range(blocks):
        summed[:] = 0.0
        filtered[:] = 0.0
        seen[:] = 0.0
        for k in range(time):
            now = k % depth
            for i in range(external):
                for lane in range(lanes):
                    seen[i, lane] = inputs[block, k, i, lane]
            if k > 0:
                for lane in range(lanes):
                    seen[external, lane] = output[block, k - 1, lane]
            first = 0
            for layer in range(sizes.size - 1):
                for s in range(sizes[layer + 1]):
                    u = first + s
                    for lane in range(lanes):
                        summed[u, now, lane] = rest[u, 0]
                    for i in range(sizes[layer]):
                        w = weights[u, i]
                        for lane in range(lanes):
                            summed[u, now, lane] += w * seen[i, lane]
                    for lane in range(lanes):
                        filtered[u, now, lane] = feedforward[u, 0] * summed[u, now, lane]
                    for j in range(1, depth):
                        then = (now + depth - j) % depth
                        b, a = feedforward[u, j], feedback[u, j - 1]
                        for lane in range(lanes):
                            filtered[u, now, lane] += b * summed[u, then, lane] - a * filtered[u, then, lane]
                    slope = rest[u, 1]
                    if bent[u]:
                        for lane in range(lanes):
                            given[s, lane] = _tanh(slope * filtered[u, now, lane])
                    else:
                        for lane in range(lanes):
                            given[s, lane] = slope * filtered[u, now, lane]
                first += sizes[layer + 1]
                for s in range(sizes[layer + 1]):
                    for lane in range(lanes):
                        seen[s, lane] = given[s, lane]
            for lane in range(lanes):
                output[block, k, lane] = given[0, lane]
