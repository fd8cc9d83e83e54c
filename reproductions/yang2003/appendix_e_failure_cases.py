"""Appendix E of the source: two more failures in flight, each not noticed, planned anew, and diagnosed.

Case one: thruster 1 gives half of its thrust from the first period on. Case two: thrusters 1 and 2 are dead
from then on. The source draws the flights and gives no figures, but for when each failure of the second case
was found. Thruster 2 is in no firing of the plan as built: that it is dead shows only once it is commanded,
which depends on which of several equally good firings the mapper takes, and on whether the rotation that the
first period left is taken back at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from reproductions.record import Effort, Finding, Table
from reproductions.yang2003 import reproduces
from reproductions.yang2003.fault_mission import DEGRADED, LOST, TWO_LOST, Failure, Flight, fly
from reproductions.yang2003.fault_mission_report import COLUMNS, beside_earlier, draw_flights, kept, table
from reproductions.yang2003.section_6_4_3_failures_in_flight import ARRIVED, DEVIATION

NOT_NOTICED, ANEW, DIAGNOSED, KNOWN = "not noticed", "planned anew at 25 m", "diagnosed", "told as it happens"
STEADIED = "diagnosed, rotation taken back"


@reproduces(
    "E47",
    lines="L2052-2078",
    reported="drawn, without figures: not noticed, with feedback, with diagnosis, and the fuel of each",
    criterion="diagnosed it arrives with less commanded delta-v than with feedback, which comes close",
)
def degraded(effort: Effort) -> Finding:
    """A thruster at half of its thrust (appendix E, case one)."""
    flights = _fly(DEGRADED)
    found = [(one.thruster, one.kind, one.share) for one in flights[DIAGNOSED].found]
    earlier = beside_earlier(
        {
            "not noticed: final miss, m": (flights[NOT_NOTICED].miss, 278.0),
            "planned anew: plans anew": (flights[ANEW].replans, 2),
            "planned anew: final miss, m": (flights[ANEW].miss, 16.0),
            "planned anew: commanded delta-v, m/s": (flights[ANEW].delta_v, 1.22),
            "told: commanded delta-v, m/s": (flights[KNOWN].delta_v, 1.0684),
            "told: commanded firing, thruster-s": (flights[KNOWN].firing_time, 419.7),
        }
    )
    return Finding(
        ours=_in_a_line(flights),
        checks={"thruster 1 is named and its half found": found == [(1, "loss", 0.5)], **_checks(flights)},
        note="The models compared are losses of a quarter, a half and three quarters, dead, open, and leaks. "
        "Without feedback the failure of E39, though it comes later, takes the craft "
        f"{fly(LOST).miss / flights[NOT_NOTICED].miss:.2f} times as far off.",
        data={name: _kept(one) for name, one in flights.items()},
        tables=(_table(flights), earlier),
        figure=partial(draw_flights, _drawn(flights)),
    )


@reproduces(
    "E48",
    lines="L2080-2106",
    reported="the first failure found and corrected after the first step, the second after the second",
    criterion="one found per period, each as soon as it should have fired; arrives, with less delta-v",
)
def two_dead(effort: Effort) -> Finding:
    """Two thrusters dead at once (appendix E, case two)."""
    flights = _fly(TWO_LOST)
    steadied = flights[STEADIED] = fly(TWO_LOST, diagnosis=True, taken_back=1.0)
    first, second = steadied.found[0], steadied.found[-1]
    later = flights[DIAGNOSED].found[-1]
    earlier = beside_earlier(
        {
            "told: commanded delta-v, m/s": (flights[KNOWN].delta_v, 1.1014),
            "told: commanded firing, thruster-s": (flights[KNOWN].firing_time, 643.4),
        }
    )
    return Finding(
        ours=f"{_in_a_line(flights)}; thruster {first.thruster} found in period {first.period}, "
        f"{second.thruster} in period {second.period}, or in period {later.period} if the rotation that "
        "is left is not taken back",
        checks={
            "the first failure is found in the first period, the second in the second": (
                [(one.thruster, one.kind, one.period) for one in steadied.found]
                == [(1, "stuck_off", 1), (2, "stuck_off", 2)]
            ),
            "each after the first second in which it should have fired": all(
                one.since == 1 for one in (*steadied.found, *flights[DIAGNOSED].found)
            ),
            "the same two and no others without taking rotation back": (
                [(one.thruster, one.kind) for one in flights[DIAGNOSED].found]
                == [(1, "stuck_off"), (2, "stuck_off")]
            ),
            **_checks(flights),
            "and with rotation taken back": steadied.miss < ARRIVED,
        },
        correction=(
            "the second failure is found after the second step if the rotation that the first step left is "
            "taken back, which the source leaves out"
            if later.period != 2
            else ""
        ),
        note="The source finds the second failure after the second step. Nothing in its plan fires thruster "
        "2 as long as rotation is not controlled; here it fires in the second period to take back the "
        "rotation that thruster 1 left, and is found then. A second failure can only be found once it is "
        "told to fire.",
        data={name: _kept(one) for name, one in flights.items()},
        tables=(_table(flights), earlier),
        figure=partial(draw_flights, _drawn(flights)),
    )


def _fly(failures: tuple[Failure, ...]) -> dict[str, Flight]:
    return {
        NOT_NOTICED: fly(failures),
        ANEW: fly(failures, deviation=DEVIATION),
        DIAGNOSED: fly(failures, diagnosis=True),
        KNOWN: fly(failures, known=True),
    }


def _drawn(flights: Mapping[str, Flight]) -> dict[str, Flight]:
    return {name: flights[name] for name in (NOT_NOTICED, ANEW, DIAGNOSED)}


def _checks(flights: Mapping[str, Flight]) -> dict[str, bool]:
    blind, anew, knowing = flights[NOT_NOTICED], flights[ANEW], flights[DIAGNOSED]
    return {
        "diagnosed, it arrives": knowing.miss < ARRIVED,
        f"planned anew, it ends within {DEVIATION:g} m": anew.miss < DEVIATION,
        "not noticed, it ends ten times as far off as that": blind.miss > 10.0 * anew.miss,
        "diagnosis saves commanded delta-v": knowing.delta_v < anew.delta_v,
    }


def _in_a_line(flights: Mapping[str, Flight]) -> str:
    blind, anew, knowing = flights[NOT_NOTICED], flights[ANEW], flights[DIAGNOSED]
    return (
        f"not noticed {blind.miss:.0f} m off; planned anew {anew.replans} times, {anew.miss:.1f} m off with "
        f"{anew.delta_v:.2f} m/s; diagnosed on target with {knowing.delta_v:.3f} m/s"
    )


def _kept(flight: Flight) -> dict[str, object]:
    return {name: value for name, value in kept(flight).items() if name != "speed"}


def _table(flights: Mapping[str, Flight]) -> Table:
    found = {
        "pilot": "{0}",
        "found in period": lambda _, one: (
            ", ".join(f"{found.period} (thruster {found.thruster})" for found in one.found) or "-"
        ),
    }
    return table(
        flights,
        found | {name: cell for name, cell in COLUMNS.items() if name not in ("pilot", "final speed, m/s")},
    )
