"""Referee for thrusters behind a modulator: pulses on one time line, fault by fault, by quadrature.

Written from the equations alone: the delays by NumPy's own Philox, the opening of each valve as a function of
time, the level of its thrust by variation of constants, its impulse by Gauss and Legendre's rule between all
corners. Times are s of the flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tests.physics.reference_flight import ActiveFault, fault_edges, is_active
from thruster_envs.faults import Fault
from thruster_envs.spacecraft import Spacecraft

Array = NDArray[np.float64]

PURPOSE = 4
"""Purpose of the draws for valves, the high half of the last word of the counter."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
PARTS = 4
"""Equal parts of a stretch between corners, each integrated with twelve nodes."""


def uniform(seed: int, step: int, block: int) -> Array:
    """Eight uniform numbers of craft 0 in episode 0, by NumPy's own Philox."""
    counter = [block, step, 0, PURPOSE << 32]
    before = (sum(word << (64 * k) for k, word in enumerate(counter)) - 1) % 2**256
    words = [int(word) for word in np.random.Philox(counter=before, key=seed).random_raw(4)]
    halves = [half for word in words for half in (word >> 32, word & 0xFFFFFFFF)]
    return (np.array(halves, dtype=np.float64) + 0.5) / 2.0**32


def delays(spacecraft: Spacecraft, seed: int, periods: int) -> Array:
    """(K, n) delay of the pulse of each period and thruster, s."""
    modulator, n = spacecraft.modulator, spacecraft.number_of_thrusters
    phase = 2.0 * math.pi * uniform(seed, 0, 2**32 - 1)[0]
    rows = []
    for step in range(periods):
        time = step * spacecraft.control_period
        sine = math.sin(2.0 * math.pi * time / modulator.variation_period + phase)
        draws = np.concatenate([uniform(seed, step, block) for block in range((n + 7) // 8)])[:n]
        rows.append(modulator.delay + modulator.variation * sine + modulator.jitter * (2.0 * draws - 1.0))
    return np.array(rows)


@dataclass
class Line:
    """The valve of one thruster on the time line of a flight.

    Attributes:
        pulses: When it is told to be open, (opens, closes), in order.
        faults: Of this thruster.
        time_constant: Of its lag, s, in each period.
        shut: Whether its isolation valve is closed in each period.
        period: s.
    """

    pulses: list[tuple[float, float]]
    faults: list[Fault]
    time_constant: Array
    shut: NDArray[np.bool_]
    period: float

    def _active(self, within: float) -> list[ActiveFault]:
        return [ActiveFault(fault, 0.0, within) for fault in self.faults if is_active(fault, within)]

    def opening(self, within: float, times: Array) -> Array:
        """Opening of the valve at some times of the stretch around ``within``."""
        g = np.full(times.shape, float(any(a <= within < z for a, z in self.pulses)))
        active = self._active(within)
        for fault in active:
            if fault.kind == "stuck_on":
                g = np.array([fault.severity(t) for t in times])
        for fault in active:
            if fault.kind == "leak":
                s = np.array([fault.severity(t) for t in times])
                g = g + s * (1.0 - g)
        for fault in active:
            if fault.kind in ("stuck_off", "intermittent"):
                g = g * (1.0 - np.array([fault.severity(t) for t in times]))
        return np.zeros(times.shape) if self.shut[int(within / self.period)] else g

    def gain(self, within: float, times: Array) -> Array:
        """Share of its thrust that it makes of its flow."""
        gain = np.ones(times.shape)
        for fault in self._active(within):
            if fault.kind == "loss":
                gain = gain * (1.0 - np.array([fault.severity(t) for t in times]))
            if fault.kind == "sign":
                gain = gain * (1.0 - 2.0 * np.array([fault.severity(t) for t in times]))
        return gain

    def corners(self, end: float) -> list[float]:
        """All moments up to ``end`` at which the opening or the gain has a corner, both ends included."""
        moments = {k * self.period for k in range(round(end / self.period) + 1)}
        moments |= {t for pulse in self.pulses for t in pulse}
        for fault in self.faults:
            moments |= set(fault_edges(fault, 0.0, end))
        return sorted(t for t in moments if 0.0 <= t <= end)

    def impulses(self, periods: int) -> Array:
        """(K,) impulse over nominal thrust in each period, s."""
        result, level = np.zeros(periods), 0.0
        corners = self.corners(periods * self.period)
        for begin, end in pairwise(corners):
            if end - begin < 1e-14:
                continue
            within = 0.5 * (begin + end)
            k = min(int(within / self.period), periods - 1)
            h = (end - begin) / PARTS
            for part in range(PARTS):
                left = begin + part * h
                times = left + 0.5 * h * (1.0 + NODES)
                levels = np.array([self._level(within, left, level, t, k) for t in times])
                result[k] += 0.5 * h * float(WEIGHTS @ (levels * self.gain(within, times)))
                level = self._level(within, left, level, left + h, k)
        return result

    def _level(self, within: float, left: float, level: float, t: float, k: int) -> float:
        """Level at ``t`` by variation of constants from ``left`` on."""
        tau, half = float(self.time_constant[k]), 0.5 * (t - left)
        times = left + half * (1.0 + NODES)
        fed = half * float(WEIGHTS @ (np.exp(-(t - times) / tau) * self.opening(within, times))) / tau
        return level * math.exp(-(t - left) / tau) + fed


def lines(
    spacecraft: Spacecraft,
    duties: Array,
    *,
    faults: Sequence[Fault] = (),
    seed: int = 0,
    shut: NDArray[np.bool_] | None = None,
) -> list[Line]:
    """The valves of one craft under ``duties`` (K, n); ``shut`` (K, n) says which are isolated."""
    periods = len(duties)
    period, late_by = spacecraft.control_period, delays(spacecraft, seed, periods)
    shut = np.zeros(duties.shape, np.bool_) if shut is None else shut
    result = []
    for i, thruster in enumerate(spacecraft.thrusters):
        own = [fault for fault in faults if fault.thruster == i + 1]
        pulses, lags = [], []
        for k in range(periods):
            start = k * period
            on_time = min(1.0, duties[k, i] + _severity(own, "bias", start)) * period
            on_time = on_time if on_time >= thruster.minimum_pulse else 0.0
            opens, closes = start + late_by[k, i], start + late_by[k, i] + on_time
            opens += thruster.opening_delay
            closes += thruster.closing_delay
            opens = min(opens + _severity(own, "late_opening", start), closes)
            if on_time > 0.0:
                pulses.append((opens, closes))
            lags.append(thruster.time_constant + _severity(own, "slow_opening", start))
        result.append(Line(pulses, own, np.array(lags), shut[:, i], period))
    return result


def _severity(faults: Sequence[Fault], kind: str, time: float) -> float:
    """Severity of the faults of that kind at a moment."""
    return sum(
        ActiveFault(fault, 0.0, time).severity(time)
        for fault in faults
        if fault.kind == kind and is_active(fault, time)
    )


def delivered(spacecraft: Spacecraft, duties: Array, only: Sequence[int] = (), **settings: object) -> Array:
    """(K, n) impulse of each thruster over its nominal thrust in each period, s; no scatter.

    ``only`` are indices of the thrusters to follow; by default all.
    """
    flown: Callable[..., list[Line]] = lines
    followed = flown(spacecraft, duties, **settings)
    return np.array([followed[i].impulses(len(duties)) for i in only or range(len(followed))]).T
