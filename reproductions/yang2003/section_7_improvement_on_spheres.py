"""The "improvement of over 15 %" on SPHERES, of the source's conclusions.

It is Table 3 (E05) said again: the difference between the mean deviations of the crude map and of the linear
program from what was commanded. That is accuracy, not fuel. How the crude rule is read decides how large it
is, as in E05; its readings and commands are used here.
"""

from __future__ import annotations

from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.table_3_spheres_accuracy import CRUDE, accuracy, percent

REPORTED = 0.15


@reproduces(
    "E50",
    lines="L1578",
    reported="the mapper improved performance by over 15 %",
    criterion="as Table 3 (E05): over 15 % of the command with the crude map of the library",
)
def improvement(effort: Effort) -> Finding:
    """The improvement on SPHERES in the conclusions."""
    table = accuracy(effort)
    means: dict[str, dict[str, float]] = table.data["mean_deviation"]
    gains = {
        rule: {kind: means[rule][kind] - means["linear program"][kind] for kind in means[rule]}
        for rule in CRUDE
    }
    all_gains = [gain for line in gains.values() for gain in line.values()]
    beyond = sum(gain > REPORTED for gain in all_gains)
    by_rule = Table(
        "What the linear program gains on the crude map, % of the command",
        ("rule", *next(iter(gains.values()))),
        [(rule, *map(percent, line.values())) for rule, line in gains.items()],
    )
    return Finding(
        ours=f"{percent(min(all_gains))} to {percent(max(all_gains))} % of the command; more than "
        f"{100.0 * REPORTED:g} % in {beyond} of {len(all_gains)} readings and sets of commands",
        checks={
            "Table 3 comes out as far as it can": all(table.checks.values()),
            "for the library's crude map it is over 15 % on commands of every kind": (
                min(gains["crude, shared"].values()) > REPORTED
            ),
            "never does the crude map do better": min(all_gains) > -1e-9,
        },
        not_reproducible=table.not_reproducible,
        note="A difference of mean deviations, in points of the command's size. Nothing is said of fuel.",
        data={"gains": gains},
        tables=(by_rule,),
    )
