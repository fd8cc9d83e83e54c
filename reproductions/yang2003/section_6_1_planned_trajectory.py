"""The planned trajectory of the source's chapter 6: from 300 m above the target to it, in half an orbit.

The source gives no formulas of its planner, only that it minimises fuel by linear programming and that burns
lie at the beginning and at the end. Here it is `thruster_baselines.guidance.RendezvousPlanner`, directly in
on-times, with at most 90 % of a period in use and no rotation commanded: what the source prints of the first
period follows from that. Beside it stands what two impulses would take, in closed form.
"""

from __future__ import annotations

import numpy as np

from reproductions.figures import BLUE, INK, ORANGE, Figure, panels
from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.fault_mission import fly
from reproductions.yang2003.fault_mission_report import beside_earlier
from reproductions.yang2003.section_6_3_coupling_in_flight import ORION, PERIOD, SHARE, START, STEPS, path
from thruster_baselines.guidance import transition_matrix
from thruster_envs.protocols import FloatArray

PRINTED_CHANGE = np.array([-0.027, -0.027, 0.0, 0.0, 0.0, 0.0])  # m/s and rad/s, L1353
PRINTED_THRUSTERS = (1, 6, 10, 12)
PRINTED_ON_TIME = 4.5  # s
FULL_POWER = (10, 15)  # periods, L1438
AXES = ("radial", "along-track", "cross-track")
REACHED = 1e-3  # m and mm/s


@reproduces(
    "E30",
    lines="L1288-1293, L1349-1353, L1438",
    reported="least fuel, bang-off-bang; first rate change (-0.027, -0.027) m/s by 4.5 s of thrusters 1, 6, "
    "10, 12; full power on both axes for 10 to 15 periods",
    criterion="all of that, at rest on the target, within 2 % of the delta-v of two impulses",
)
def planned(effort: Effort) -> Finding:
    """The planned rendezvous (Fig. 20)."""
    flight = fly()
    (_, plan) = flight.plans[0]
    first = flight.on_times[0]
    fired = tuple(int(i) + 1 for i in np.flatnonzero(first))
    by_axis = np.abs(plan.rate_changes[:, :3]).sum(axis=0)
    burns = {name: _burns(plan.rate_changes[:, axis]) for axis, name in enumerate(AXES)}
    both = int(np.argmin((np.abs(plan.rate_changes[:, :2]) > 0.99 * abs(PRINTED_CHANGE[0])).all(axis=1)))
    impulses = two_impulses()
    least = float(np.abs(impulses).sum())
    table = Table(
        "Burns of the plan",
        ("axis", "periods", "rate change, m/s", "by two impulses, m/s"),
        [
            (name, f"{start + 1} to {end + 1}", f"{change:.4f}", f"{impulses[number, axis]:.4f}")
            for axis, name in enumerate(AXES)
            for number, (start, end, change) in enumerate(burns[name][:2])
        ],
    )
    earlier = beside_earlier(
        {
            "delta-v, m/s": (plan.delta_v, 1.0577),
            "radial, m/s": (by_axis[0], 0.3977),
            "along-track, m/s": (by_axis[1], 0.6600),
            "firing time, thruster-s": (plan.firing_time, 352.6),
            "delta-v of two impulses, m/s": (least, 1.0488),
        }
    )
    return Finding(
        ours=f"{plan.delta_v:.4f} m/s ({by_axis[0]:.4f} radial, {by_axis[1]:.4f} along-track), "
        f"{plan.firing_time:.1f} thruster-s; both axes at full power for {both} periods",
        checks={
            "it arrives at rest": np.abs(plan.miss).max() < REACHED,
            "burns on each axis of the plane at the beginning and at the end, none between": all(
                len(burns[name]) == 2 and burns[name][0][0] == 0 and burns[name][1][0] > STEPS // 2
                for name in AXES[:2]
            ),
            "the first rate change is the printed one": (
                np.abs(plan.rate_changes[0] - PRINTED_CHANGE).max() < 1e-9
            ),
            "and fires the printed thrusters for the printed time": (
                fired == PRINTED_THRUSTERS and np.abs(first[first > 0.0] - PRINTED_ON_TIME).max() < 1e-6
            ),
            "both axes are at full power for the first 10 to 15 periods": (
                FULL_POWER[0] <= both <= FULL_POWER[1]
            ),
            "it takes no less than, and at most 2 % more than, what two impulses take": (
                least <= plan.delta_v <= 1.02 * least
            ),
        },
        note=f"{STEPS} periods of {PERIOD:g} s, thrusters in use for at most {100.0 * SHARE:.0f} % of each. "
        "Delta-v is the sum over axes of absolute rate changes, as Orion's thrusters deliver them.",
        data={
            "delta_v": plan.delta_v,
            "delta_v_by_axis": by_axis,
            "firing_time": plan.firing_time,
            "burns": {
                name: [(start + 1, end + 1) for start, end, _ in of_axis] for name, of_axis in burns.items()
            },
            "two_impulses": impulses,
            "two_impulses_delta_v": least,
        },
        tables=(table, earlier),
        figure=_draw,
    )


def two_impulses() -> FloatArray:
    """(2, 3), m/s: the impulses at the start and at the end that do the same."""
    free = transition_matrix(ORION.mean_motion, STEPS * PERIOD)
    departure = np.linalg.solve(free[:3, 3:], -free[:3, :3] @ START[:3])
    arrival = free[3:, :3] @ START[:3] + free[3:, 3:] @ departure
    return np.array([departure - START[3:], -arrival])


def _burns(changes: FloatArray) -> list[tuple[int, int, float]]:
    """First and last period, from 0, and rate change, m/s, of each run of firing."""
    on = np.abs(changes) > 1e-9
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    return [
        (int(start), int(end) - 1, float(changes[start:end].sum())) for start, end in edges.reshape(-1, 2)
    ]


def _draw() -> Figure:
    """The path in the orbital plane, after Fig. 20, and the rate changes over time."""
    flight = fly()
    figure, (left, right) = panels(2, height=3.7)
    path(left, flight.states, color=BLUE)
    left.set(title="Planned path")
    minutes = PERIOD / 60.0 * np.arange(STEPS)
    for axis, colour in ((0, ORANGE), (1, BLUE)):
        right.step(minutes, 1e3 * flight.rate_changes[:, axis], where="post", color=colour, label=AXES[axis])
    printed = {"color": INK, "linestyle": "--", "linewidth": 1.0, "label": "printed for period 1"}
    right.axhline(1e3 * PRINTED_CHANGE[0], **printed)
    right.set(xlabel="time, min", ylabel="rate change per period, mm/s", title="Bang, off, bang")
    right.legend(loc="center", bbox_to_anchor=(0.38, 0.5), fontsize=8.5)
    return figure
