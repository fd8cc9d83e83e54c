"""Fig. 9: how many rounds methods I and II take (E09, E10, E13)."""

from __future__ import annotations

import numpy as np

from reproductions.figures import BLUE, ORANGE, Figure, annotate, bars, panels
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.coupling_study import CONDITIONS, SHARE, Trial, commands, trial
from thruster_baselines.mapping import AdditiveCompensationMapper, LPMapper
from thruster_baselines.mapping.compensation import SHORT

SATURATING = 0.4  # share of the authority: a third of such commands on six axes meets a bound


@reproduces(
    "E13",
    lines="Fig. 9, L602-604",
    reported="method I takes fewer, at a higher cost each; four on average (values not readable)",
    criterion="method I takes fewer with rotation or translation alone; three to six on average",
)
def iterations(effort: Effort) -> Finding:
    """Rounds that methods I and II take."""
    trials = {(m, c): trial(m, c, effort.samples) for m in ("method I", "method II") for c in CONDITIONS}

    def mean(method: str, condition: str) -> float:
        one = trials[method, condition]
        return float(one.iterations[~one.failed].mean())

    pure = ("rotation", "translation")
    rows = tuple(
        (c, *(f"{mean(m, c):.2f}" for m in ("method I", "method II")),
         f"{trials['method I', c].failed.mean():.1%}") for c in CONDITIONS
    )  # fmt: skip
    overall = np.mean([mean(m, c) for m in ("method I", "method II") for c in CONDITIONS])
    table = Table("Rounds on average", ("condition", "method I", "method II", "method I cycles"), rows)
    return Finding(
        ours=f"method I {mean('method I', 'translation'):.1f} to {mean('method I', 'six axes'):.1f} rounds "
        "where it "
        f"converges, method II {mean('method II', 'rotation'):.1f} to {mean('method II', 'six axes'):.1f}",
        checks={
            "method I takes fewer rounds than method II with rotation or translation alone": all(
                mean("method I", c) < mean("method II", c) for c in pure
            ),
            "three to six rounds on average": 3.0 <= overall <= 6.0,
            "method II always converges": all(not trials["method II", c].failed.any() for c in CONDITIONS),
        },
        data={f"{c}, {m}": np.bincount(trials[m, c].iterations) for m, c in trials},
        note=f"Rounds until 0.1 % is missing at most, {effort.samples:,} commands in each condition, uniform "
        f"in {SHARE:.0%} of the authority. Averages are over the commands on which a method converges.",
        tables=(table,),
        figure=lambda: _draw(trials),
    )  # fmt: skip


def _draw(trials: dict[tuple[str, str], Trial]) -> Figure:
    figure, axes = panels(3, height=3.6)
    most = 12
    for axis, condition in zip(axes, CONDITIONS, strict=True):
        shares = {}
        for method in ("method I", "method II"):
            one = trials[method, condition]
            good = one.iterations[~one.failed]
            counts = np.bincount(np.minimum(good, most), minlength=most + 1)[1:]
            shares[f"{method}: {good.mean():.1f} on average"] = 100.0 * counts / len(one.iterations)
        bars(axis, shares, (ORANGE, BLUE))
        axis.set_xticks(
            range(1, most, 2), [str(k) if k < most else f"{most}+" for k in range(2, most + 1, 2)]
        )
        axis.set(ylim=(0.0, 112.0), xlabel="rounds", title=f"{condition} commanded")
        axis.legend(loc="upper right", fontsize=8.5)
        cycles = trials["method I", condition].failed.mean()
        if cycles > 0.0:
            corner = {"xycoords": "axes fraction", "ha": "right", "fontsize": 9, "color": ORANGE}
            annotate(axis, f"method I cycles on {cycles:.0%}", (0.98, 0.7), **corner)
        axis.grid(axis="x", visible=False)
    axes[0].set_ylabel("share of commands, %")
    figure.suptitle("Method I takes fewer rounds, but not always to the end", x=0.01, ha="left")
    return figure


@reproduces(
    "E09",
    lines="section 2.4.2, L553",
    reported="fewer than seven",
    criterion="fewer than seven for every command that can be met",
)
def within_one_percent(effort: Effort) -> Finding:
    """Rounds that method II takes to within 1 %."""
    mapper = AdditiveCompensationMapper("orion", tolerance=0.01)
    largest, data, rows = {}, {}, []
    for condition in CONDITIONS:
        for share in (SHARE, SATURATING):
            answer = mapper(commands(condition, effort.samples, share))
            reached = answer.status == 0
            largest[condition, share] = int(answer.iterations[reached].max())
            short = float((answer.status == SHORT).mean())
            data[f"{condition}, {share}"] = np.bincount(answer.iterations[reached])
            rows.append((
                condition, f"{share:.0%}", f"{answer.iterations[reached].mean():.2f}",
                str(largest[condition, share]), f"{short:.1%}",
            ))  # fmt: skip
    small = max(value for (_, share), value in largest.items() if share == SHARE)
    table = Table(
        "Rounds to within 1 %", ("condition", "share of authority", "mean", "largest", "short"), rows
    )
    return Finding(
        ours=f"at most {small} where every command can be met, at most {max(largest.values())} where a third "
        "meets a bound",
        checks={"fewer than seven linear programs for every command that can be met": small < 7},
        data=data,
        note="Counted for commands that the method brings to 1 %; *short* is the share that a bound keeps "
        "from it. Beyond the authority the rounds wander from thruster to thruster, and a few commands take "
        "more than seven.",
        tables=(table,),
    )


@reproduces(
    "E10",
    lines="section 2.4.2, L528; appendix B, L2003-2008",
    reported="a factor above 0.1 suffices to keep new thrusters from joining",
    criterion="with the rule on, no new thruster joins where that can be avoided",
)
def cost_rule(effort: Effort) -> Finding:
    """What a lower cost of used thrusters does."""
    plain, joined, rows = LPMapper("orion"), {}, []
    for condition in CONDITIONS:
        asked = commands(condition, effort.samples)
        first = plain(asked).on_times > 0.0
        for rule in ("none", "lower_used", "raise_unused"):
            for factor in (0.1, 0.2) if rule == "lower_used" else (0.1,):
                mapper = AdditiveCompensationMapper("orion", cost_rule=rule, cost_factor=factor)  # type: ignore[arg-type]
                answer = mapper(asked)
                name = rule if rule != "lower_used" else f"lower_used, factor {factor}"
                joined[condition, name] = float(((answer.on_times > 0.0) & ~first).any(axis=1).mean())
                rows.append(
                    (condition, name, f"{joined[condition, name]:.1%}", f"{answer.iterations.mean():.2f}")
                )
    most = {
        rule: max(value for (_, name), value in joined.items() if name.startswith(rule))
        for rule in ("lower_used", "raise_unused", "none")
    }
    table = Table(
        "Commands in which a later round opens a thruster that the first did not",
        ("condition", "rule", "commands", "rounds"),
        rows,
    )
    return Finding(
        ours=f"new thrusters join in up to {most['lower_used']:.0%} of the commands under the text's rule, "
        f"in {most['raise_unused']:.0%} under the appendix's, and in {most['none']:.0%} without any rule",
        checks={
            "under the appendix's rule no new thruster joins": all(
                value == 0.0 for (_, name), value in joined.items() if name == "raise_unused"
            ),
            "translation alone: none joins under the text's rule": (
                joined["translation", "lower_used, factor 0.1"] == 0.0
            ),
        },
        data={f"{c}, {name}": value for (c, name), value in joined.items()},
        correction="the rule of appendix B in place of the text's: lowering costs in proportion to on-times "
        "changes which thrusters go together best, and so invites new ones; where no bound is met none would "
        "join without any rule, since the thrusters of the first round stay the cheapest",
        tables=(table,),
    )  # fmt: skip
