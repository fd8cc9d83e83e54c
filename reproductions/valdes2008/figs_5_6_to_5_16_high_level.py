"""Fig. 5.6 to 5.16: the high-level networks, their thresholds, and three faulty missions (E5.5 to E5.11).

Ten networks for each axis; see `high_level_study`. A mission with a fault that acts on the firings of its
thruster is set beside its paired fault-free run, and beside the mission with the torque that the source's
pulse counts would need. The residual is the sum over 1000 to 3000 s of the absolute error of the predicted
rate, in units of 2.6 mrad/s; the source's unit is not known.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from reproductions.cells import spread
from reproductions.figures import BLUE, GREEN, INK, ORANGE, Figure, dots, panels, thin
from reproductions.record import Effort, Finding, Table
from reproductions.valdes2008 import Result, reproduces
from reproductions.valdes2008.high_level_study import (
    EXPERIMENTS,
    FOLLOWER,
    Flown,
    experiment_signals,
    flown,
    healthy_signals,
    high_level,
)
from reproductions.valdes2008.low_level_study import seeds_of
from thruster_agents.dynamic_neurons.high_level import AXES
from thruster_envs.protocols import BoolArray, FloatArray

WAYS: dict[Flown, str] = {
    "fault": "fault acts on the firings",
    "twin": "healthy twin",
    "torque": "with the torque of the printed counts",
}
PRINTED_THRESHOLDS = (135.0, 50.0, 76.0)
PRINTED = {
    "H-FS1": ((382.12, 41.53, 45.16), (10, 2890)),
    "H-FS2": ((100.21, 57.88, 39.75), (104, 577)),
    "H-FS3": ((132.84, 38.40, 279.98), (2523, 13)),
}
"""Residuals of roll, pitch and yaw; pulses of the pair that has the fault."""


@reproduces(
    "E5.5",
    lines="Figs. 5.6 and 5.7, L1592-1608",
    reported="the outputs overlay (plot)",
    criterion="80 % of the variance explained, by the median network",
)
def training(effort: Effort) -> Finding:
    """Training of the high-level networks."""
    runs = high_level(seeds_of(effort))
    errors = np.array([[record.error for record in one.records] for one in runs])
    power = (healthy_signals().rate[:3] / runs[0].classifier.settings.rate_scale).var(axis=(0, 1))
    share = errors / power
    return Finding(
        ours=f"mean square errors {_by_axis(errors, '.2g')}",
        checks={
            "the median network explains 80 % of the variance of the rate or more": (
                np.median(share, axis=0) <= 0.2
            ).all()
        },
        data={"mean square error": errors, "share of the variance": share},
        not_reproducible="the mean square error at which the source stops, which is not printed",
        note=f"{len(runs)} seeds, up to 150 iterations of L-BFGS, in units of 2.6 mrad/s.",
    )  # fmt: skip


@reproduces(
    "E5.6",
    lines="Figs. 5.9 and 5.10, L1610-1633",
    reported="the outputs overlay (plot)",
    criterion="no residual of missions 1 to 6 above its threshold",
)
def validation(effort: Effort) -> Finding:
    """Validation of the high-level networks."""
    runs = high_level(seeds_of(effort))
    over = [int((one.healthy > one.thresholds).sum()) for one in runs]
    apart = np.array([one.healthy[3:].mean(axis=0) / one.healthy[:3].mean(axis=0) for one in runs])
    return Finding(
        ours=f"no residual above its threshold in {sum(one == 0 for one in over)} of {len(runs)} seeds; on "
        "missions 4 to 6 they are "
        + _by_axis(apart, ".1f")
        + " times those of missions 1 to 3",
        checks={"no residual of missions 1 to 6 is above its threshold": max(over) == 0},
        data={"residuals": np.array([one.healthy for one in runs]), "validation over training": apart},
        note="The thresholds are made from these very missions with factors above 1, so that none can be "
        "above. What says more is how much larger the residuals are where the networks were not trained.",
        figure=partial(_draw_validation, seeds_of(effort)),
    )  # fmt: skip


def _draw_validation(count: int) -> Figure:
    runs, signals = high_level(count), healthy_signals()
    figure, axes = panels(3, height=3.6)
    for k, (axis, name) in enumerate(zip(axes, AXES, strict=True)):
        measured = 1e3 * signals.rate[4, 1:, k]
        axis.plot(measured, color=INK, linewidth=2.0, alpha=0.4, label="measured")
        said = 1e3 * np.array([one.classifier.predict(signals[[4]])[0, :, k] for one in runs])
        thin(axis, np.arange(said.shape[1]), said, BLUE, f"{count} networks", linewidth=0.6)
        axis.set(xlabel="time (s)", ylabel="rate (mrad/s)", ylim=(measured.min() - 0.6, measured.max() + 0.6))
        axis.set(title=f"mission 5, {name}")
    axes[0].legend(loc="upper right")
    return figure


@reproduces(
    "E5.7",
    lines="L1635-1651",
    reported="135.00, 50.00, 76.00",
    criterion="eq. 5.3; the printed values within the range of the seeds",
)
def thresholds(effort: Effort) -> Finding:
    """Thresholds of the high-level networks."""
    runs = high_level(seeds_of(effort))
    found = np.array([one.thresholds for one in runs])
    mean, largest = (
        np.array([getattr(one.healthy, what)(axis=0) for one in runs]) for what in ("mean", "max")
    )
    sigma = np.array(runs[0].classifier.settings.sensitivity)
    low, high = found.min(axis=0), found.max(axis=0)
    inside = (low <= PRINTED_THRESHOLDS) & (high >= PRINTED_THRESHOLDS)
    return Finding(
        ours=_by_axis(found, ".0f"),
        checks={
            "every threshold is mean + factor (largest - mean)": np.allclose(
                found, mean + sigma * (largest - mean)
            ),
            "the printed thresholds lie within the range of the seeds": inside.all() or len(runs) < 2,
        },
        data={"thresholds": found},
        not_reproducible="the values 135, 50 and 76: they go over a factor of "
        + ", ".join(f"{one:.0f}" for one in high / low)
        + " with the seed",
        note="Factors 1.208, 2.450 and 1.032 as in the source; their choice is not explained there.",
    )


def mission(name: str, effort: Effort) -> Finding:
    """E5.8 to E5.10."""
    count, axis = seeds_of(effort), EXPERIMENTS[name].axis
    ratio = {way: _ratios(name, way, count) for way in WAYS}
    right = {way: int((one[:, axis] > 1.0).sum()) for way, one in ratio.items()}
    only = {way: int(_only(one > 1.0, axis).sum()) for way, one in ratio.items()}
    alarms = int((ratio["twin"] > 1.0).any(axis=1).sum())
    against = ratio["fault"][:, axis] / ratio["twin"][:, axis]
    counts = {way: flown(name, way).firings()[0, FOLLOWER, 2 * axis : 2 * axis + 2].tolist() for way in WAYS}
    printed, pulses = PRINTED[name]
    table = Table(
        f"Residual over threshold, {count} networks, median and range; in the source "
        + ", ".join(f"{a / b:.2f}" for a, b in zip(printed, PRINTED_THRESHOLDS, strict=True))
        + f", pulses {pulses[0]} / {pulses[1]}",
        ("mission", "pulses of the pair", *AXES, "right pair flagged", "no other"),
        [
            (label, "{} / {}".format(*counts[way]), *(spread(one, ".2f") for one in ratio[way].T),
             f"{right[way]} of {count}", f"{only[way]} of {count}")
            for way, label in WAYS.items()
        ],
    )  # fmt: skip
    return Finding(
        ours=f"the right pair flagged by {right['fault']} of {count} networks, on the healthy twin by "
        f"{right['twin']}; with the torque of the printed counts by {right['torque']}",
        checks={
            "with the torque that the printed counts need, most networks flag the right pair": (
                right["torque"] > count / 2
            ),
        },
        data={"residual over threshold": ratio, "right pair": right, "only the right pair": only,
              "networks with an alarm on the healthy twin": alarms, "pulses": counts},
        not_reproducible=f"that only the {AXES[axis]} pair is flagged: with the fault acting on the firings "
        f"its residual is {spread(against, '.2f')} times that of the healthy twin, and {alarms} of {count} "
        "networks flag a pair of the healthy twin, whose attitude is new to them",
        tables=(table,),
        figure=partial(_draw_mission, name, count),
    )  # fmt: skip


def _ratios(name: str, way: Flown, count: int) -> FloatArray:
    """(networks, 3): residual over threshold."""
    signals = experiment_signals(name, way)
    return np.array([one.classifier.residuals(signals)[0] / one.thresholds for one in high_level(count)])


def _only(flagged: BoolArray, axis: int) -> BoolArray:
    """(networks,): whether the pair of an axis is flagged, and no other."""
    return np.asarray(flagged[:, axis] & (flagged.sum(axis=1) == 1))


def _draw_mission(name: str, count: int) -> Figure:
    figure, (axis,) = panels(height=3.8)
    for place, (way, label), colour in zip(
        (-0.25, 0.0, 0.25), WAYS.items(), (ORANGE, BLUE, GREEN), strict=True
    ):
        for k, ratio in enumerate(_ratios(name, way, count).T):
            dots(axis, k + place, ratio, colour, 0.08, markersize=4, label=None if k else label)
    axis.axhline(1.0, color=INK, linestyle="--", linewidth=1.0)
    axis.set(yscale="log", ylabel="residual over threshold", title=f"{name}, {count} networks")
    own = EXPERIMENTS[name].axis
    axis.set_xticks(range(3), [f"{one} (fault)" if k == own else one for k, one in enumerate(AXES)])
    axis.legend(loc="upper left")
    return figure


@reproduces(
    "E5.11",
    lines="L1728-1733",
    reported="a faulty thruster that fires more has lost thrust, one that fires less has gained some",
    criterion="the rule holds in the three missions with the torque that the printed counts need",
)
def rules(effort: Effort) -> Finding:
    """More pulses mean a weak thruster, fewer a strong one."""
    rows, holds = [], {way: 0 for way in WAYS if way != "twin"}
    for name in PRINTED:
        one = EXPERIMENTS[name]
        healthy = _pair(name, "twin")
        for way in holds:
            own, other = _pair(name, way)
            right = (own > other) != (one.case == 2)  # case 2 makes it stronger
            holds[way] += right
            pulses = f"{own} / {other}", f"{healthy[0]} / {healthy[1]}"
            rows.append((name, WAYS[way], *pulses, "right" if right else "wrong"))
    table = Table(
        "Whether the faulty thruster fires more than its opposite if weak, less if strong",
        ("mission", "", "pulses, faulty / opposite", "healthy twin", "rule"),
        rows,
    )
    return Finding(
        ours=f"right in {holds['fault']} of {len(PRINTED)} missions with the fault acting on the firings, in "
        f"{holds['torque']} with the torque of the printed counts",
        checks={"right in all with the torque of the printed counts": holds["torque"] == len(PRINTED)},
        data={"right": holds},
        not_reproducible="the rule for faults of 15 % that act on firings: a healthy pair is as unequal as "
        "the fault makes it",
        tables=(table,),
    )


def _pair(name: str, way: Flown) -> tuple[int, int]:
    """Pulses of the thruster with the fault, and of its opposite."""
    thruster = EXPERIMENTS[name].thruster - 1
    counts = flown(name, way).firings()[0, FOLLOWER]
    return int(counts[thruster]), int(counts[thruster ^ 1])


def _by_axis(values: FloatArray, form: str) -> str:
    """Median and range of columns (seeds, 3)."""
    return ", ".join(f"{name} {spread(values[:, k], form)}" for k, name in enumerate(AXES))


REPRODUCTIONS = tuple(
    Result(
        id=f"E5.{number}",
        title=f"Mission {name} judged by the high level",
        lines=lines,
        reported=f"residuals {', '.join(str(one) for one in PRINTED[name][0])}; only "
        f"{AXES[EXPERIMENTS[name].axis]} flagged; pulses {PRINTED[name][1][0]} / {PRINTED[name][1][1]}",
        criterion="the right pair flagged by most networks with the torque that the printed counts need",
        run=partial(mission, name),
    )
    for number, name, lines in (
        (8, "H-FS1", "L1664-1682"),
        (9, "H-FS2", "L1684-1704"),
        (10, "H-FS3", "L1706-1726"),
    )
)
