"""Exact decoupling from a varying delay is impossible: shown by computation.

The source makes the residual blind to the unknown input of a delay that varies, by left eigenvectors (Theorem
1). For its own model no gain L and no weight W do that without making the residual blind to thruster faults
too: G_rd(s) = -4 s / (tau0 s + 2) G_rf(s), whatever L and W. For L = 0 it can be read off the model: both
inputs act through the same three forces; a gain multiplies both transfers from the left by the same matrix.
Tried are many random gains and weights at many frequencies; that rows of W C are left eigenvectors for no
eigenvalue, by rank; and how near they come, as a cosine.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reproductions.figures import BLUE, INK, ORANGE, Figure, panels
from reproductions.fonod2013 import reproduces
from reproductions.record import Effort, Finding, Table
from thruster_baselines.detection.residuals import DelayModel, assigned_gain, decoupling, delay_model
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import load

DELAY = 0.1  # s
EIGENVALUES = (-0.49, -0.50, -0.51)  # rad/s, of the source
FREQUENCIES = np.geomspace(1e-2, 1e3, 61)  # rad/s
PAIRS_PER_SAMPLES = 100
ALIGNMENTS = (("newtons", -0.5, 0.447), ("force over mass", -0.5, 0.214), ("force over mass", -10.0, 0.924))
"""Units of the command, eigenvalue in rad/s, cosine that our draft has computed."""


@reproduces(
    "MSR-3.4",
    lines="L151-213",
    reported="the residual is decoupled from the delay's variation by left eigenvectors",
    criterion="the transfer from the delay is -4 s / (tau0 s + 2) that from a fault for any L and W",
)
def impossible(effort: Effort) -> Finding:
    """Exact decoupling from a varying delay is impossible."""
    chaser = load("msr_chaser")
    model = delay_model(chaser.mean_motion, DELAY)
    source = _gains(model, assigned_gain(model.dynamics, model.measurement, EIGENVALUES), np.eye(3))
    rng = np.random.default_rng(33)
    other = _gains(model, rng.standard_normal((9, 3)), rng.standard_normal((3, 3)))
    pairs = max(effort.samples // PAIRS_PER_SAMPLES, 1)
    errors = _ratio_errors(model, pairs)
    mixed = _independent_rows(model)
    alignment = []
    for units, eigenvalue, drafted in ALIGNMENTS:
        mass = chaser.mass if units == "newtons" else 1.0
        found = decoupling(delay_model(chaser.mean_motion, DELAY, mass), (eigenvalue, -0.61, -0.71))
        alignment.append((units, eigenvalue, float(found.alignment[0]), drafted))
    own = decoupling(model, EIGENVALUES)
    table = Table.of(
        "How near the wanted left eigenvectors come to possible ones",
        alignment,
        {"commands in": "{0}", "eigenvalue, rad/s": "{1:.1f}", "cosine": "{2:.4f}", "our draft": "{3:.3f}"},
    )
    return Finding(
        ours=f"the ratio holds to {errors.max():.1e} for {pairs} random pairs of L and W; cosines "
        f"{', '.join(f'{found:.3f}' for _, _, found, _ in alignment)}",
        checks={
            "G_rd = -4 s / (tau0 s + 2) G_rf to 1e-10 for every random L and W": errors.max() < 1e-10,
            "no row of W C is a left eigenvector, whatever W and L, at 40 eigenvalues": mixed == 6,
            "the first condition, W C D = 0, holds for any W and decides nothing": own.weight_rank == 0,
            "fault and delay reach the residual through the same three channels": own.rank_of_both == 3,
            "the cosines are those of our draft to 0.001": all(
                abs(found - drafted) < 1e-3 for _, _, found, drafted in alignment
            ),
            "the delay is rejected at rest and passed with a gain of 40 at most": (
                source[1][0, 0] / source[0][0, 0] < 0.021 and (source[1] / source[0]).max() < 40.0
            ),
        },
        not_reproducible="no gain and weight decouple the residual from a varying delay and leave it "
        "sensitive to faults; what makes it robust is the nominal delay in the model, and slow poles",
        note=f"Gains have entries of a normal distribution, scaled to 0.1 to 10 by turns; weights are random "
        f"3 x 3 matrices, every third of them singular. Compared at {FREQUENCIES.size} frequencies from "
        "0.01 to 1000 rad/s, relative to the largest entry. That W C D = 0 for any W is what the source "
        "takes for the first half of a decoupling (its eq. 20): D does not enter the position directly, "
        "and neither does a fault. A constant thrust is not disturbed by a delay, so that the ratio "
        "vanishes at rest; above 20 rad/s it is 40, and the slow poles do the rest.",
        data={"pairs": pairs, "largest_ratio_error": errors.max(), "rank": mixed, "alignment": alignment},
        tables=(table,),
        figure=partial(_draw, source, other),
    )


def _ratio_errors(model: DelayModel, pairs: int) -> FloatArray:
    """(pairs,): the largest difference between G_rd and what it should be, over that, over frequencies."""
    rng = np.random.default_rng(34)
    errors = np.empty(pairs)
    for k in range(pairs):
        gain = 10.0 ** (k % 3 - 1) * rng.standard_normal((9, 3))
        weight = rng.standard_normal((3, 3))
        if k % 3 == 2:
            weight[2] = weight[0] + weight[1]
        worst = 0.0
        for frequency in FREQUENCIES:
            s = 1j * frequency
            fault, delay = _transfers(model, gain, weight, s)
            expected = -4.0 * s / (model.delay * s + 2.0) * fault
            worst = max(worst, float(np.abs(delay - expected).max() / np.abs(expected).max()))
        errors[k] = worst
    return errors


def _transfers(
    model: DelayModel, gain: FloatArray, weight: FloatArray, s: complex
) -> tuple[NDArray[Any], NDArray[Any]]:
    """(3, 3) each: from a fault and from the delay's unknown input to the residual, at s."""
    c = model.measurement
    closed = s * np.eye(c.shape[1]) - model.dynamics + gain @ c
    both = weight @ c @ np.linalg.solve(closed, np.hstack([model.fault, model.delay_variation]))
    return both[:, :3], both[:, 3:]


def _independent_rows(model: DelayModel) -> int:
    """Least rank, over eigenvalues, of the assignable left eigenvectors and the rows of C together.

    Six is all of them: then no combination of the rows of C is assignable.
    """
    a, c = model.dynamics, model.measurement
    least = 6
    for eigenvalue in -np.geomspace(0.01, 19.0, 40):
        rows = -c @ np.linalg.inv(eigenvalue * np.eye(9) - a)
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        least = min(least, int(np.linalg.matrix_rank(np.vstack([rows, c]))))
    return least


def _gains(model: DelayModel, gain: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(frequencies, 3) each: singular values of both transfers."""
    both = [_transfers(model, gain, weight, 1j * frequency) for frequency in FREQUENCIES]
    fault, delay = (
        np.array([np.linalg.svd(one[which], compute_uv=False) for one in both]) for which in range(2)
    )
    return fault, delay


def _draw(source: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> Figure:
    figure, (left, right) = panels(2, height=3.8)
    for values, colour, name in zip(source, (BLUE, ORANGE), ("fault", "delay"), strict=True):
        left.plot(FREQUENCIES, values[:, 0], color=colour, label=name)
        left.plot(FREQUENCIES, values[:, 2], color=colour, linestyle=":", linewidth=2.5)
    left.set(title="Singular values of the source's design", ylabel="largest (line) and least (dots)")
    for (fault, delay), mark, name in ((source, "o", "the source's L and W"), (other, "x", "random L and W")):
        right.plot(FREQUENCIES, delay[:, 0] / fault[:, 0], mark, markersize=5.0, label=name)
    ratio = 4.0 * FREQUENCIES / np.hypot(DELAY * FREQUENCIES, 2.0)
    right.plot(FREQUENCIES, ratio, color=INK, linewidth=1.2, label="|4 s / (τ₀ s + 2)|")
    right.set(title="Delay over fault", ylabel="ratio of the largest, 1/s")
    for panel in (left, right):
        panel.set(xscale="log", yscale="log", xlabel="frequency, rad/s")
        panel.legend(loc="best", fontsize=8.5)
    return figure
