"""What the pilot that diagnoses its thrusters is set to, keeps and logs.

Left out: what is decided (`thruster_baselines.control.classical_pilot`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from thruster_baselines.control.observed import Measured
from thruster_baselines.control.rendezvous import RendezvousSettings
from thruster_baselines.detection.base import Interval
from thruster_envs.protocols import BoolArray, Diagnosis, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["Decision", "DiagnosisSettings", "DiagnosisState", "Event", "OpenInterval", "settings_for"]

Event = Literal[
    "suspected",
    "cleared",
    "named",
    "refined",
    "trusted again",
    "held against",
    "tested",
    "planned",
    "told",
    "refused",
    "started anew",
]


_USUAL_PERIOD = 5.0  # s, for which the controller's settings were tuned
_USUAL_BOX = (2.0, 0.02, math.radians(5.0))  # m, m/s and rad, likewise


@dataclass(frozen=True, slots=True)
class Decision:
    """One entry of the pilot's log.

    Attributes:
        time: s since the start of the episode, when it was decided.
        what: `suspected` (something is wrong, it is not sure who), `cleared` (the suspicion is dropped),
            `named`, `refined` (the level is another), `trusted again`, `held against` (its valve cannot be
            shut, and from now on the others cancel it), `tested` (fired for a moment, to hear of it),
            `planned` (the rest of the flight), `told` (by somebody who knows), `refused` (a measurement), or
            `started anew` (navigation, from a measurement that it did not expect at all).
        thruster: Its number, from 1; 0 where none is meant.
        kind: `stuck_off`, `loss`, `stuck_on` or `healthy`; for `refused` and `planned`, why.
        level: Believed share of its thrust, delivered while it is open; no number where nothing is believed.
        statistic: Of the likelihood ratio test; no number where it was not asked.

    >>> print(Decision(30.0, "named", 6, "loss", 0.47, 85.31))
        30.0 s  named: thruster 6, loss, 47 % of its thrust, likelihood ratio 85.3
    >>> print(Decision(150.0, "planned", 0, "due", math.nan, math.nan))
       150.0 s  planned: due
    """

    time: float
    what: Event
    thruster: int
    kind: str
    level: float
    statistic: float

    def __str__(self) -> str:
        """A line to read."""
        parts = (
            f"thruster {self.thruster}" if self.thruster else "",
            self.kind,
            "" if math.isnan(self.level) else f"{100.0 * self.level:.0f} % of its thrust",
            "" if math.isnan(self.statistic) else f"likelihood ratio {self.statistic:.1f}",
        )
        said = ", ".join(part for part in parts if part)
        return f"{self.time:8.1f} s  {self.what}{': ' if said else ''}{said}"


@dataclass(frozen=True, kw_only=True)
class DiagnosisSettings:
    """How the pilot diagnoses; the defaults were tuned on healthy and faulty validation flights of Orion.

    Attributes:
        false_alarm_rate: Of a healthy craft, at most so many alarms per interval.
        threshold: Of the likelihood ratio, instead of the one that follows from that rate.
        lead: By how much the ratio of one suspect has to exceed that of the next for it to be named; 12 is
            e^6 = 400 to one in likelihood.
        first_deviation: Standard deviation of the level seen in the interval in which a fault is first named,
            since it may have begun within.
        open_deviation: The same for a valve that is stuck open, which is taken as open all the way.
        dead_level: Shares below this are taken as none.
        healthy_level: Shares above this are taken as one.
        dead_deviation: A thruster is given up as dead only if its share is known as well as this.
        refining: The belief is changed if the share has moved by so much.
        initial_deviation: Of what each thruster does at the start, as a share of the strongest on each axis.
        drift: How much of that share is added per interval, as a standard deviation.
        pointing: Error of the attitude in which a thrust acted, rad, and its growth per rad turned meanwhile.
        longest_gap: Periods without a measurement that may be taken as one interval.
        probe_interval: A thruster that did not fire for as long as this is fired for a test, s.
        probe_pulse: Length of that, s; 0 for no tests.

    Raises:
        ValueError: A value that cannot be.
    """

    false_alarm_rate: float = 1e-4
    threshold: float | None = None
    lead: float = 12.0
    first_deviation: float = 0.25
    open_deviation: float = 0.03
    dead_level: float = 0.1
    healthy_level: float = 0.93
    dead_deviation: float = 0.15
    refining: float = 0.03
    initial_deviation: float = 0.01
    drift: float = 1e-4
    pointing: tuple[float, float] = (0.02, 0.2)
    longest_gap: int = 3
    probe_interval: float = 800.0
    probe_pulse: float = 0.3

    def __post_init__(self) -> None:
        if not 0.0 < self.false_alarm_rate < 1.0:
            raise ValueError(
                f"false_alarm_rate is {self.false_alarm_rate}; a rate above 0 and below 1 would be right"
            )
        for name in ("lead", "first_deviation", "open_deviation", "dead_deviation", "refining",
                     "initial_deviation", "drift", "probe_interval", "probe_pulse"):  # fmt: skip
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} is {value}; a finite number of 0 or more would be right")
        if not 0.0 <= self.dead_level < self.healthy_level <= 1.0:
            raise ValueError(
                f"dead_level is {self.dead_level} and healthy_level {self.healthy_level}; shares from 0 to "
                "1, the first below the second, would be right"
            )
        if not all(0.0 <= value < math.inf for value in self.pointing):
            raise ValueError(f"pointing is {self.pointing}; two finite numbers of 0 or more would be right")
        if self.longest_gap < 1:
            raise ValueError(f"longest_gap is {self.longest_gap}; one or more would be right")


def settings_for(
    spacecraft: Spacecraft,
    position_tolerance: float = _USUAL_BOX[0],
    velocity_tolerance: float = _USUAL_BOX[1],
    attitude_tolerance: float = _USUAL_BOX[2],
) -> RendezvousSettings:
    """The controller's settings, whose periods are those of 5 s, for the spacecraft's own period.

    Args:
        spacecraft: That is flown.
        position_tolerance: Half-size of the box to arrive in, m.
        velocity_tolerance: Likewise, m/s.
        attitude_tolerance: Likewise, rad.
    """
    usual = RendezvousSettings()
    scale = _USUAL_PERIOD / spacecraft.control_period

    def periods(count: int) -> int:
        return max(1, round(count * scale))

    return RendezvousSettings(
        detailed_steps=min(periods(usual.detailed_steps), _MOST_DETAILED),
        group=periods(usual.group),
        replan_coasting=periods(usual.replan_coasting),
        replan_burning=periods(usual.replan_burning),
        settling=periods(usual.settling),
        quiet=periods(usual.quiet),
        position_tolerance=usual.position_tolerance * min(position_tolerance / _USUAL_BOX[0], 1.0),
        velocity_tolerance=usual.velocity_tolerance * min(velocity_tolerance / _USUAL_BOX[1], 1.0),
        dead_band=usual.dead_band * min(attitude_tolerance / _USUAL_BOX[2], 1.0),
        final_dead_band=usual.final_dead_band * min(attitude_tolerance / _USUAL_BOX[2], 1.0),
    )


_MOST_DETAILED = 60  # periods planned one by one, to keep plans of short periods small


@dataclass(slots=True)
class OpenInterval:
    """What has happened since the last measurement that could be used.

    Attributes:
        before: That measurement, or None.
        periods: Since then.
        fired: (n,), s, in these, the coupling loss taken off.
        longest: Of their on-times, s.
    """

    before: Measured | None
    periods: int
    fired: FloatArray
    longest: float

    @classmethod
    def after(cls, measured: Measured | None, thrusters: int) -> OpenInterval:
        """A new one, which begins with a measurement."""
        return cls(measured, 0, np.zeros(thrusters), 0.0)

    def add(self, delivered: FloatArray, acting: FloatArray) -> None:
        """One more period, with what was delivered and how long valves were open, both (n,), s."""
        self.fired = self.fired + delivered
        self.longest = max(self.longest, float(acting.max()))
        self.periods += 1


@dataclass(slots=True)
class DiagnosisState:
    """How far a diagnosis has come; thrusters from 1, 0 for none.

    Attributes:
        variance: (n,), of the believed shares.
        isolated: (n,), thrusters whose share later firings correct.
        evidence: (2, n), likelihood ratios of a loss, and of thrust without command.
        suspicious: The last interval with an alarm that is not yet cleared, and its diagnosis.
        suspect: Whom the log last said to be suspected.
        heard: (n,), step in which each thruster last fired long enough to be judged.
    """

    variance: FloatArray
    isolated: BoolArray
    evidence: FloatArray
    suspicious: tuple[Interval, Diagnosis] | None
    suspect: int
    heard: FloatArray

    @classmethod
    def of(cls, thrusters: int) -> DiagnosisState:
        """Before an episode."""
        n = thrusters
        return cls(np.zeros(n), np.zeros(n, np.bool_), np.zeros((2, n)), None, 0, np.zeros(n))

    def clear(self) -> None:
        """Drop the evidence and the interval that was suspicious."""
        self.evidence, self.suspicious = np.zeros_like(self.evidence), None


def kind_of(share: float, stuck_on: bool) -> str:
    """The kind of fault that a believed share of thrust stands for."""
    if stuck_on:
        return "stuck_on"
    return "stuck_off" if share == 0.0 else "healthy" if share == 1.0 else "loss"
