"""The first firing of Orion's rendezvous: what the mapper fires, and what coupling makes of it.

The only command of the mission that the source prints (section 6.3), with its on-times and with the rate
change that is left of it when each further thruster costs every other 6 %.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from thruster_baselines.mapping import LPMapper, delivered_rate_change
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import load

ORION = load("orion")
COMMAND = np.array([-0.027, -0.027, 0.0, 0.0, 0.0, 0.0])
REPORTED_ON_TIMES = np.array([4.5, 0.0, 0.0, 0.0, 0.0, 4.5, 0.0, 0.0, 0.0, 4.5, 0.0, 4.5])
PRINTED_RATE_CHANGE = np.array([-0.002214, -0.02214, 0.0, 0.0, 0.0, 0.0])

ROUND_OFF = 1e-12


@reproduces(
    "E20",
    lines="L1347-1353",
    reported="4.5 s on thrusters 1, 6, 10, 12",
    criterion="the on-times reported, exactly; no other optimum; 18 thruster-seconds",
)
def on_times(effort: Effort) -> Finding:
    """On-times of the first rate change of Orion's rendezvous."""
    allocation = LPMapper(ORION)(COMMAND)
    fired, firing_time = allocation.on_times, float(allocation.on_times.sum())
    least, most = range_of_optima(firing_time)
    table = Table(
        "On-times, s",
        ("thruster", *(f"{i + 1}" for i in range(fired.size))),
        (
            ("reported", *(f"{one:g}" for one in REPORTED_ON_TIMES)),
            ("ours", *(f"{one:.6g}" for one in fired)),
        ),
    )
    return Finding(
        ours=f"{_named(fired)}; {firing_time:.6g} thruster-s",
        checks={
            "on-times are those reported": np.abs(fired - REPORTED_ON_TIMES).max() <= ROUND_OFF,
            "nothing is left of the command": np.abs(allocation.slack).max() <= ROUND_OFF,
            "no other on-times do it with as little firing": (most - least).max() <= 1e-6,
        },
        note="That the optimum is unique is asked of HiGHS: it looks for the least and the largest on-time "
        "of each thruster among all firings that meet the command in the same firing time.",
        data={"on_times": fired, "slack": allocation.slack, "firing_time": firing_time},
        tables=(table,),
    )


@reproduces(
    "E21",
    lines="L1355-1357",
    reported="18 % lost with four open; [-0.002214, -0.02214, 0, 0, 0, 0]",
    criterion="0.82 of the command on x and on y, nothing on the other axes",
)
def coupling_loss(effort: Effort) -> Finding:
    """What the coupling loss leaves of it."""
    fired = LPMapper(ORION)(COMMAND).on_times
    effectiveness = ORION.effectiveness()
    delivered = delivered_rate_change(effectiveness, fired, ORION.feed.coupling)
    loss = 1.0 - delivered[:2] / COMMAND[:2]
    agrees = np.abs(delivered - PRINTED_RATE_CHANGE) <= ROUND_OFF
    figures = ", ".join(f"{one:.5g}" for one in delivered.round(12) + 0.0)
    return Finding(
        ours=f"[{figures}]; {100.0 * loss[0]:.4g} % lost on x",
        checks={
            "18 % is lost on each of the two axes": np.abs(loss - 0.18).max() <= ROUND_OFF,
            "all but the first figure are those printed": agrees[1:].all(),
        },
        correction=(
            ""
            if agrees[0]
            else f"the first figure is printed as {PRINTED_RATE_CHANGE[0]:g}, a tenth of what 18 % leaves"
        ),
        data={"delivered": delivered, "loss": loss, "open_thrusters": int((fired > 0.0).sum())},
    )


def range_of_optima(firing_time: float) -> tuple[FloatArray, FloatArray]:
    """Least and largest on-time (n,) of each thruster over all optima, s."""
    effectiveness, count = ORION.effectiveness(), len(ORION.thrusters)
    scale = np.abs(effectiveness).max(axis=1)  # rows of order one: HiGHS allows fixed errors
    equations = np.vstack([effectiveness / scale[:, np.newaxis], np.ones(count)])
    values = np.append(COMMAND / scale, firing_time)
    extremes = [
        linprog(sign * np.eye(count)[i], A_eq=equations, b_eq=values, bounds=(0.0, ORION.control_period)).x[i]
        for i in range(count)
        for sign in (1.0, -1.0)
    ]
    least, most = np.array(extremes).reshape(count, 2).T
    return least, most


def _named(fired: FloatArray) -> str:
    """Such as "4.5 s on 1 and 6"."""
    times = dict.fromkeys(f"{one:.6g}" for one in fired if one > 0.0)
    groups = [
        f"{time} s on {', '.join(f'{i + 1}' for i, one in enumerate(fired) if f'{one:.6g}' == time)}"
        for time in times
    ]
    return "; ".join(groups)
