"""Fig. 30 to 32: the fault of the mission, second by second (E41 to E44).

Thrusters 1, 6, 10 and 12 are commanded to fire for the one second between two measurements, and thruster 1 is
dead. The likelihood ratio test has the source's R = 10; the residual covariance Y is R here (the filter's
first Y is 10.08, which changes all statistics by 0.8 %). On-times are effective: the shared feed plays no
part.
"""

from __future__ import annotations

import numpy as np

from reproductions.cells import finite, named, with_interval
from reproductions.figures import BLUE, INK, ORANGE, Figure, annotate, panels
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.detection_study import CONFIDENCE, EFFECTIVENESS, ERROR, THRUSTERS, measure
from thruster_baselines.detection import GLRDetector, ModelComparison
from thruster_baselines.detection.evaluate import Rate
from thruster_baselines.detection.glr import SOURCE_THRESHOLD
from thruster_baselines.detection.settings import SOURCE_MEASUREMENT_NOISE
from thruster_envs.protocols import FloatArray

FIRING = np.isin(np.arange(1, THRUSTERS + 1), (1, 6, 10, 12)).astype(np.float64)
DEAD = 1
DELIVERED = FIRING * (np.arange(1, THRUSTERS + 1) != DEAD)
PERIOD = 5.0  # s, the longest on-time, which the source's model of stuck on takes
GAP = 2e-5  # between the statistics of thrusters 1 and 10, as reported
LOSSES = (0.2, 0.4, 0.6, 0.8)


def _detector(vehicles: int = 1) -> GLRDetector:
    return GLRDetector.yang2003(EFFECTIVENESS, SOURCE_THRESHOLD, process_noise=0.0, vehicles=vehicles)


@reproduces(
    "E41",
    lines="Fig. 30, L1452-1459",
    reported="measured significantly different from expected (values not readable)",
    criterion="the sound firing turns nothing; what is missing is the column of thruster 1",
)
def residual(effort: Effort) -> Finding:
    """Measured and expected rate change when thruster 1 dies."""
    expected, measured = EFFECTIVENESS @ FIRING, EFFECTIVENESS @ DELIVERED
    missing = expected - measured
    rng = np.random.default_rng(41)
    drawn = measure(rng, np.tile(FIRING, (effort.samples, 1))) - expected
    deviation = drawn.std(axis=0)
    axes = ("x", "y", "z", "about x", "about y", "about z")
    rows = tuple(
        (name, f"{1e3 * a:.1f}", f"{1e3 * b:.1f}", f"{1e3 * s:.2f}")
        for name, a, b, s in zip(axes, expected, measured, deviation, strict=True)
    )
    sigmas = np.abs(missing) / deviation
    table = Table("Rate change", ("axis", "expected", "measured", "healthy deviation"), rows)
    return Finding(
        ours=f"expected {named(expected, '.1f', 1e3)}, measured {named(measured, '.1f', 1e3)} (mm/s, "
        f"mrad/s); off by up to {sigmas.max():.0f} standard deviations of a healthy firing",
        checks={
            "the sound firing turns nothing": np.allclose(expected[3:], 0.0),
            "what is missing is the column of thruster 1": np.allclose(missing, EFFECTIVENESS[:, DEAD - 1]),
            "it differs by more than five standard deviations": sigmas.max() > 5.0,
        },
        data={"expected": expected, "measured": measured, "standard deviation": deviation},
        note=f"Standard deviations of {effort.samples:,} healthy firings with scatter and sensor errors.",
        tables=(table,),
    )


@reproduces(
    "E42",
    lines="Fig. 31, L1461-1466",
    reported="thruster 1 highest, 10 second, 2e-5 apart; 1e-6 on average without a fault",
    criterion="this order; the values by closed form",
)
def ratios(effort: Effort) -> Finding:
    """Likelihood ratio of each thruster when thruster 1 dies."""
    detector = _detector()
    said = detector.update(FIRING, EFFECTIVENESS @ DELIVERED, 1.0)
    values = said.suspicion[0]
    order = np.argsort(values)[::-1] + 1
    gap = float(values[0] - values[9])
    a, b = EFFECTIVENESS[:, 0], EFFECTIVENESS[:, 9]
    along = float(a @ b) ** 2 / float(a @ a) / float(b @ b)
    closed = float(a @ a) / SOURCE_MEASUREMENT_NOISE
    needed = (1.0 - along) * float(a @ a) / GAP
    rng = np.random.default_rng(42)
    count = effort.samples
    commanded = np.tile(FIRING, (count, 1))
    noise = _detector(count).update(commanded, measure(rng, commanded), 1.0).statistic
    table = Table.of(
        "Likelihood ratio of each thruster",
        zip(range(1, THRUSTERS + 1), values, said.shortfall[0], strict=True),
        {"thruster": "{0}", "statistic": "{1:.4g}", "seconds too few": "{2:.4f}"},
    )
    return Finding(
        ours=f"thruster {order[0]} at {values[order[0] - 1]:.4g}, {order[1]} at {values[order[1] - 1]:.4g}, "
        f"difference {gap:.2g}; {noise.mean():.2g} on average without a fault",
        checks={
            "thruster 1 is highest, thruster 10 second": order[0] == 1 and order[1] == 10,
            "the highest is the square of its column over R": np.isclose(values[0], closed),
            "it is above the threshold": values[0] > SOURCE_THRESHOLD,
            "the difference is what the angle between the columns gives": (
                np.isclose(gap, closed * (1.0 - along))
            ),
            "without a fault the average is 0.5e-6 to 10e-6": 5e-7 < noise.mean() < 1e-5,
        },
        data={"statistics": values, "healthy mean": noise.mean(), "Y of the reported gap": needed},
        not_reproducible=f"a difference of {GAP:g} between thrusters 1 and 10: the squared cosine of their "
        f"columns is {along:.5f}, so that the second is {1.0 - along:.2%} below the first, {gap:.2g} at R = "
        f"10. It would take Y = {needed:.2f}, and with it the average without a fault would be "
        f"{noise.mean() * SOURCE_MEASUREMENT_NOISE / needed:.1g}, not 1e-6",
        tables=(table,),
        figure=lambda: _draw(values, noise),
    )  # fmt: skip


def _draw(values: FloatArray, noise: FloatArray) -> Figure:
    figure, (axis,) = panels(height=3.8)
    numbers = np.arange(1, THRUSTERS + 1)
    axis.bar(numbers, values, color=[ORANGE if one == DEAD else BLUE for one in numbers], width=0.7)
    for number, value in zip(numbers, values, strict=True):
        annotate(axis, f"{value:.3g}", (number, value), ha="center", va="bottom", fontsize=8)
    axis.axhline(SOURCE_THRESHOLD, color=INK, linestyle="--", linewidth=1.1, label="threshold")
    low, high = np.quantile(noise, (0.05, 0.95))
    axis.axhspan(float(low), float(high), color=INK, alpha=0.2, label="healthy firings, 90 % of them")
    axis.grid(axis="x", visible=False)
    axis.set(yscale="log", ylim=(1e-7, 4e-3), xticks=numbers, xlabel="thruster", ylabel="likelihood ratio")
    axis.set(title="Thruster 1 is dead; 10 pushes the same way and turns the other")
    axis.legend(loc="upper center", ncols=2)
    return figure


@reproduces("E43", lines="section 6.4.3, L1466", reported="99.9 %", criterion="99.9 % or more after 1 s")
def isolation(effort: Effort) -> Finding:
    """How often the dead thruster is named."""
    count = 10 * effort.samples
    rng = np.random.default_rng(43)
    rates = {}
    for time in (1.0, 0.5):
        for gate in (False, True):
            commanded = np.tile(time * FIRING, (count, 1))
            detector = GLRDetector.yang2003(
                EFFECTIVENESS, SOURCE_THRESHOLD, sign_gate=gate, process_noise=0.0, vehicles=count
            )
            said = detector.update(commanded, measure(rng, np.tile(time * DELIVERED, (count, 1))), 1.0)
            found = int(said.detected.sum())
            rates[time, gate] = (
                Rate.of(found, count, CONFIDENCE),
                Rate.of(int((said.thruster == DEAD).sum()), max(found, 1), CONFIDENCE),
            )
    right, half = rates[1.0, False][1], rates[0.5, False][1]
    table = Table.of(
        "Detected, and of them rightly named",
        [(*key, *those) for key, those in rates.items()],
        {
            "on-time": "{0:g} s",
            "sign gate": lambda _, gate, *__: "yes" if gate else "no",
            "detected": "{2.value:.2%}",
            "rightly named (95 %)": lambda _, __, ___, right: with_interval(right, ".3%"),
        },
    )
    return Finding(
        ours=f"{right.value:.3%} ({right.low:.3%} at least) after 1 s, {half.value:.2%} ({half.low:.2%} to "
        f"{half.high:.2%}) after 0.5 s",
        checks={
            "99.9 % or more are rightly named after 1 s": right.low >= 0.999 or right.value >= 0.999,
            "99 % or more after 0.5 s": half.value >= 0.99,
            "all are detected after 1 s": rates[1.0, False][0].value >= 0.9999,
        },
        data={f"{time:g} s, sign gate {gate}": {"detected": one[0].value, "named": (one[1].value, one[1].low,
              one[1].high)} for (time, gate), one in rates.items()},
        note=f"{count:,} firings, with scatter of 10 % and errors of {1e3 * ERROR:g} mm/s and mrad/s. "
        "Whether it is thruster 1 or 10 is decided by the force alone, 3 mm/s against the noise.",
        tables=(table,),
    )  # fmt: skip


@reproduces(
    "E44",
    lines="Fig. 32, L1468-1473",
    reported="stuck off has the minimum chi-squared (values not readable)",
    criterion="the same; the values by closed form",
)
def comparison(effort: Effort) -> Finding:
    """Model comparison when thruster 1 dies."""
    compare = ModelComparison(THRUSTERS, losses=LOSSES, openings=())
    columns = {}
    for duration in (1.0, PERIOD):
        detector = _detector()
        said = detector.update(FIRING, EFFECTIVENESS @ DELIVERED, duration)
        assert detector.last is not None
        columns[duration] = compare(detector.last, said.thruster)
    values = dict(zip(compare.models, columns[1.0].statistic[0], strict=True))
    on = float(columns[PERIOD].statistic[0][compare.models.index(("stuck_on", 1.0))])
    closed = float(EFFECTIVENESS[:, 0] @ EFFECTIVENESS[:, 0]) / SOURCE_MEASUREMENT_NOISE
    rng = np.random.default_rng(44)
    count = effort.samples
    detector = _detector(count)
    commanded = np.tile(FIRING, (count, 1))
    said = detector.update(commanded, measure(rng, np.tile(DELIVERED, (count, 1))), 1.0)
    assert detector.last is not None
    identified = compare(detector.last, said.thruster)
    kinds, sizes = np.array(identified.kind), identified.severity
    off = Rate.of(int((kinds == "stuck_off").sum()), count, CONFIDENCE)
    expected = [closed * (1.0 - loss) ** 2 for loss in LOSSES]
    table = Table.of(
        "Chi-squared of the models of thruster 1",
        [(*model, value) for model, value in values.items()],
        {"model": "{0}", "size": "{1:g}", "statistic": lambda _, __, value: finite(value, ".5g", "left out")},
    )
    return Finding(
        ours=f"stuck off has the smallest chi-squared, {values['stuck_off', 1.0]:.1g}; a loss of 80 % "
        f"{values['loss', 0.8]:.4g}, no fault {values['none', 0.0]:.4g}; with noise stuck off in "
        f"{off.value:.2%} of firings",
        checks={
            "stuck off is chosen": columns[1.0].kind == ("stuck_off",),
            "its statistic is zero": values["stuck_off", 1.0] < 1e-15,
            "those of losses are (1 - loss)^2 of that of no fault": bool(
                np.allclose([values["loss", loss] for loss in LOSSES], expected)
            ),
            "with scatter and sensor errors it is chosen in 85 % of firings, else a loss of 80 %": (
                off.low > 0.85 and set(zip(kinds, sizes, strict=True)) <= {("stuck_off", 1.0), ("loss", 0.8)}
            ),
        },
        data={"statistics": {f"{kind} {level:g}": value if np.isfinite(value) else None
                             for (kind, level), value in values.items()},
              "stuck on for 5 s": on, "stuck off chosen": (off.value, off.low, off.high)},
        note="In an interval of 1 s stuck on is the same as no fault for a thruster that fires all the time, "
        f"and is left out; the source's model, in which it fires for 5 s, has {on:.4g}. "
        f"{count:,} firings with noise. The caption of Fig. 32 is that of another figure.",
        tables=(table,),
    )  # fmt: skip
