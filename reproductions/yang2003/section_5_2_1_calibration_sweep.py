"""Initial misalignment after launch: each thruster fired alone, and what that tells.

The source announces such a test for chapter 6 and shows none. Here thrusters are misaligned by a random angle
about a random axis and their thrust is off by some per cent; the sweep of `thruster_baselines.estimation`
fires them one by one, with Orion's scatter and sensor noise, and estimates. Rate sensors see a turned torque
far better than Doppler sees a force; but a tilt towards the centre of mass changes the torque as a weaker
thrust does, and only the force tells them apart.
"""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import LogLocator
from scipy.stats import chi2

from reproductions.cells import proportion
from reproductions.figures import BLUE, INK, Figure, panels
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from thruster_baselines.estimation import CalibrationSweep
from thruster_baselines.statistics import clopper_pearson
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import load

ORION = load("orion")
NOMINAL = ORION.effectiveness()
PULSES, REPETITIONS = (1.0, 2.0, 5.0), (1, 3, 6)
SWEEPS_PER_EFFORT = 0.006  # simulated sweeps for each angle, of the effort's samples
ANGLES = (0.0, 0.5, 1.0, 2.0, 4.0)  # degrees
FALSE_ALARMS = 1e-3  # per thruster and sweep
FOUND = 4.0  # degrees that have to be found
_THREE_OF_5_S = (len(PULSES) - 1) * len(REPETITIONS) + 1  # that sweep, among all
THRUST_ERROR = 0.02  # one sigma of each thruster's own thrust, in the sweeps that test the covariance


@reproduces(
    "E51",
    lines="section 5.2.1, L1058",
    reported="announced for chapter 6, not shown",
    criterion="errors are as large as the estimate's covariance says; a tilt of 4 degrees is found in 95 % "
    "of thrusters at one false alarm in 1,000",
)
def misalignment(effort: Effort) -> Finding:
    """Calibration sweep for initial misalignment."""
    rng = np.random.default_rng(51)
    sweeps = max(4, int(SWEEPS_PER_EFFORT * effort.samples))
    deviations = [
        (pulse, count, *_deviations(CalibrationSweep(ORION, pulse, count)))
        for pulse in PULSES
        for count in REPETITIONS
    ]
    sweep = CalibrationSweep(ORION, PULSES[-1], REPETITIONS[1])
    squares = np.array([_normalised_square(sweep, rng) for _ in range(sweeps)])
    threshold = float(chi2.isf(FALSE_ALARMS, NOMINAL.shape[0]))
    flagged = {angle: _flagged(sweep, angle, threshold, sweeps, rng) for angle in ANGLES}
    size = NOMINAL.size
    spread = float(np.sqrt(2.0 * size / sweeps))
    trials = sweeps * NOMINAL.shape[1]
    known = Table.of(
        "How well a sweep knows each thruster (standard deviations; the worst of twelve)",
        deviations,
        {
            "pulse, s": "{0:g}",
            "firings of each": "{1}",
            "firing time, s": lambda pulse, count, *_: f"{pulse * count * NOMINAL.shape[1]:g}",
            "thrust, %": lambda _, __, thrust, ___: f"{100.0 * thrust:.2f}",
            "tilt, degrees": "{3:.3f}",
        },
    )
    found = Table.of(
        f"Thrusters said to be off, of those tilted by so much ({REPETITIONS[1]} firings of {PULSES[-1]:g} "
        f"s, threshold for {FALSE_ALARMS:g} false alarms)",
        flagged,
        {
            "tilt, degrees": "{0:g}",
            "said to be off, % (95 % interval)": lambda _, count: proportion(count, trials, ".2f", ""),
        },
    )
    return Finding(
        ours=f"three firings of 5 s each: thrust to {100.0 * deviations[_THREE_OF_5_S][2]:.1f} %, tilt to "
        f"{deviations[_THREE_OF_5_S][3]:.2f} degrees; normalised squared errors of {size} entries "
        f"average {squares.mean():.1f}; {FOUND:g} degrees found in {flagged[FOUND]} of {trials} thrusters",
        checks={
            "the mean squared error is what the covariance says, within four of its deviations": (
                abs(squares.mean() - size) < 4.0 * spread
            ),
            f"a tilt of {FOUND:g} degrees is found in 95 % of thrusters": flagged[FOUND] >= 0.95 * trials,
            "thrusters that are as built alarm no more often than stated, at 95 % confidence": (
                clopper_pearson(flagged[0.0], trials)[0] <= FALSE_ALARMS
            ),
        },
        beyond_source=True,
        note="Scatter from firing to firing bounds what can be known of a thrust, however long the pulse: "
        "only more firings help. For a tilt, longer pulses help too.",
        data={
            "deviations": deviations,
            "mean normalised square": squares.mean(),
            "sweeps": sweeps,
            "flagged": {f"{angle:g}": count for angle, count in flagged.items()},
            "threshold": threshold,
        },
        tables=(known, found),
        figure=lambda: _draw(deviations),
    )


def _misaligned(rng: np.random.Generator, degrees: float) -> FloatArray:
    """(6, n): every thruster of Orion turned by this angle about a random axis across its thrust."""
    columns = []
    inverse = np.linalg.inv(np.array(ORION.inertia))
    for thruster in ORION.thrusters:
        along = np.array(thruster.direction)
        across = np.cross(along, rng.normal(size=3))
        across /= np.linalg.norm(across)
        force = thruster.thrust * (np.cos(np.radians(degrees)) * along + np.sin(np.radians(degrees)) * across)
        columns.append(
            np.concatenate([force / ORION.mass, inverse @ np.cross(np.array(thruster.position), force)])
        )
    return np.array(columns).T


def _fired(sweep: CalibrationSweep, effectiveness: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Rate changes (firings, 6) that the sensors give, with scatter."""
    firings = len(sweep.on_times)
    scatter = np.array([thruster.scatter for thruster in ORION.thrusters])[sweep.order - 1]
    strength = 1.0 + scatter * rng.uniform(-1.0, 1.0, firings)
    sigmas = np.repeat([ORION.sensors.velocity, ORION.sensors.rate], 3)
    errors = sigmas * rng.normal(size=(firings + 1, 6))
    changes: FloatArray = (sweep.on_times * strength[:, np.newaxis]) @ effectiveness.T
    return changes + np.diff(errors, axis=0)


def _normalised_square(sweep: CalibrationSweep, rng: np.random.Generator) -> float:
    """Squared error of one sweep, weighed by the inverse of the stated covariance."""
    true = _misaligned(rng, float(rng.uniform(0.0, ANGLES[-1])))
    true *= 1.0 + THRUST_ERROR * rng.normal(size=true.shape[1])
    answer = sweep.estimate(_fired(sweep, true, rng))
    error = (answer.effectiveness - true).T.ravel()
    return float(error @ np.linalg.solve(answer.covariance, error))


def _flagged(
    sweep: CalibrationSweep, degrees: float, threshold: float, sweeps: int, rng: np.random.Generator
) -> int:
    """How many thrusters exceed the threshold in so many sweeps in which all are tilted by this angle."""
    return sum(
        int((sweep.estimate(_fired(sweep, _misaligned(rng, degrees), rng)).statistic > threshold).sum())
        for _ in range(sweeps)
    )


def _deviations(sweep: CalibrationSweep) -> tuple[float, float]:
    """One sigma of the thrust, as a share, and of a tilt, degrees: the worst over thrusters and azimuths."""
    covariance = sweep.estimate(sweep.on_times @ NOMINAL.T).covariance
    inverse = np.linalg.inv(np.array(ORION.inertia))
    thrusts, tilts = [], []
    for i, thruster in enumerate(ORION.thrusters):
        block = covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6]
        along = np.array(thruster.direction)
        across = np.linalg.svd(along[np.newaxis])[2][1:]
        moves = np.array([NOMINAL[:, i]] + [
            np.concatenate([push / ORION.mass, inverse @ np.cross(np.array(thruster.position), push)])
            for push in thruster.thrust * across
        ])  # fmt: skip
        # of thrust and two tilts, fitted together
        spread = np.linalg.inv(moves @ np.linalg.solve(block, moves.T))
        thrusts.append(np.sqrt(spread[0, 0]))
        tilts.append(np.degrees(np.sqrt(np.linalg.eigvalsh(spread[1:, 1:])[-1])))
    return float(max(thrusts)), float(max(tilts))


def _draw(deviations: list[tuple[float, int, float, float]]) -> Figure:
    figure, (left, right) = panels(2)
    for panel, column, label, scale in ((left, 2, "thrust, %", 100.0), (right, 3, "tilt, degrees", 1.0)):
        for pulse, style in zip(PULSES, ("o:", "o--", "o-"), strict=True):
            values = [scale * row[column] for row in deviations if row[0] == pulse]
            panel.plot(REPETITIONS, values, style, color=BLUE, markersize=4.0, label=f"{pulse:g} s")
        panel.set(
            xscale="log", yscale="log", xlabel="firings of each thruster", ylabel=f"one sigma of {label}"
        )
        panel.set_xticks(REPETITIONS, [f"{count}" for count in REPETITIONS])
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.minorticks_off()
    left.legend(title="pulse", labelcolor=INK)
    return figure
