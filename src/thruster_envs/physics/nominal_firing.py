"""What the nominal vehicle delivers for commanded duties, for flight software: `Expectation`.

Knows minimum pulses, valve delays, rise and fall, what is still open from the period before, the shared feed,
a modulator's nominal delay, propellant used, and the firings of plasma thrusters. It is the same valve as in
a flight (:mod:`.expectation`), with a memory of its own, and sees no fault. Leaves out scatter.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.physics.expectation import CARRIED_GROUPS, fire_valves
from thruster_envs.physics.firing import NO_TIME, STANDARD_GRAVITY, has_dynamics
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["Expectation", "NominalFiring"]

_SINGLE = 1.2e-7  # by so large a share a command that came in single precision may be below a minimum


class NominalFiring(NamedTuple):
    """What a period's commands give if all is nominal.

    Attributes:
        open_times: (vehicles, n), s, for which each valve is open; half open counts half.
        on_times: (vehicles, n), s, effective: for how long each thruster would have to fire alone.
        rate_change: (vehicles, 6), m/s then rad/s, body axes.
        mass_ratio: (vehicles,), mean mass in the period over the nominal one; 0 where the propellant is used
            up, and nothing fires.
        deviation: (vehicles, n), s: by how much an on-time changes if the modulator is as late as it can be;
            zeros without one.
    """

    open_times: FloatArray
    on_times: FloatArray
    rate_change: FloatArray
    mass_ratio: FloatArray
    deviation: FloatArray


class Expectation:
    """Follows the valves of nominal vehicles, period by period.

    Args:
        spacecraft: As the flight software believes it to be.
        vehicles: How many are followed.
        coupling: Share of thrust lost per further thruster open; by default the spacecraft's.
        plasma: Fire as pulsed plasma thrusters do: once for a duty above 0, for the discharge's firing time.

    Attributes:
        mass: (vehicles,), kg, after the last period.

    Raises:
        ValueError: A coupling that is no share, `plasma` without a discharge.

    >>> from thruster_envs.spacecraft import load
    >>> spheres = load("spheres")  # 1 s, minimum pulse 10 ms
    >>> expectation = Expectation(spheres)
    >>> expectation.update([0.5, 0.009] + 10 * [0.0]).on_times[0, :2].tolist()
    [0.5, 0.0]
    """

    def __init__(
        self,
        spacecraft: Spacecraft,
        vehicles: int = 1,
        *,
        coupling: float | None = None,
        plasma: bool = False,
    ) -> None:
        coupling = spacecraft.feed.coupling if coupling is None else float(coupling)
        if not 0.0 <= coupling <= 1.0:
            raise ValueError(f"coupling must be a share of the thrust from 0 to 1, got {coupling}")
        if plasma and spacecraft.discharge is None:
            raise ValueError(f"plasma must be False for {spacecraft.name!r}, without a discharge, got True")
        thrusters = spacecraft.thrusters
        self.spacecraft, self.vehicles, self._coupling, self._plasma = spacecraft, vehicles, coupling, plasma
        self._valves = (
            np.array([one.minimum_pulse * (1.0 - _SINGLE) for one in thrusters]),
            np.array([one.opening_delay for one in thrusters]),
            np.array([one.closing_delay for one in thrusters]),
            np.array([1.0 / max(one.rise_time, NO_TIME) for one in thrusters]),
            np.array([1.0 / max(one.fall_time, NO_TIME) for one in thrusters]),
        )
        self._capacitors = np.array([one.capacitor for one in thrusters])
        #: Whether what is open at the end of a period goes on in the next.
        self.carries = not plasma and (spacecraft.modulator is not None or has_dynamics(spacecraft))
        #: Whether no command is changed by the valves: all open at once, for as long as they are told.
        self.follows = not (plasma or self.carries or self._valves[0].any())
        self._effectiveness = spacecraft.effectiveness()
        self._flow = np.array([one.thrust / (one.specific_impulse * STANDARD_GRAVITY) for one in thrusters])
        self._dry = max(0.0, spacecraft.mass - spacecraft.feed.propellant_mass)
        #: Whether firing uses propellant, of which there may be an end.
        self.depletes = bool(self._flow.any()) or self._dry > 0.0
        self.reset()

    def reset(self, vehicles: ArrayLike | None = None) -> None:
        """All valves shut and the tanks full, in the vehicles of a mask (vehicles,) or in all of them."""
        n, count = self._capacitors.size, self.vehicles
        if vehicles is None:
            self.mass: FloatArray = np.full(count, self.spacecraft.mass)
            self._carried: FloatArray = np.zeros((CARRIED_GROUPS * n, count))
            self._past: list[FloatArray] = []
            return
        mask = np.asarray(vehicles, np.bool_)
        self.mass[mask] = self.spacecraft.mass
        self._carried[:, mask] = 0.0
        for earlier in self._past:
            earlier[mask] = 0.0

    def update(self, duties: ArrayLike, period: float | None = None) -> NominalFiring:
        """Fire for one period.

        Args:
            duties: (vehicles, n), or (n,) for all of them, 0..1.
            period: s; by default the spacecraft's.

        Raises:
            ValueError: A wrong shape.
        """
        n, count = self._capacitors.size, self.vehicles
        told = np.asarray(duties, np.float64)
        if told.shape not in ((n,), (count, n)):
            raise ValueError(f"duties must have the shape ({count}, {n}), got {told.shape}")
        told = np.broadcast_to(told, (count, n))
        period = self.spacecraft.control_period if period is None else float(period)
        deviation = np.zeros((count, n))
        if self._plasma:
            opened = given = self._discharge(told)
        elif self.spacecraft.modulator is not None:
            opened = given = self._modulate(told, period, deviation)
        else:
            answer = np.empty((2, n, count))
            fire_valves(
                np.ascontiguousarray(told.T), self._carried, self._valves, period, self._coupling,
                self.carries, answer,
            )  # fmt: skip
            opened, given = np.ascontiguousarray(answer[0].T), np.ascontiguousarray(answer[1].T)
        return self._use_propellant(opened, given, deviation)

    def _use_propellant(self, opened: FloatArray, given: FloatArray, deviation: FloatArray) -> NominalFiring:
        change: FloatArray = given @ self._effectiveness.T
        ratio = np.ones(self.vehicles)
        if self.depletes:
            used = given @ self._flow
            fires = self.mass > self._dry
            ratio = np.where(fires, self.mass - 0.5 * used, np.inf) / self.spacecraft.mass
            self.mass = np.where(fires, self.mass - used, self.mass)
            opened, given = opened * fires[:, np.newaxis], given * fires[:, np.newaxis]
            change[:, :3] /= ratio[:, np.newaxis]
            change[:, 3:] *= fires[:, np.newaxis]
            ratio = np.where(fires, ratio, 0.0)
        return NominalFiring(opened, given, change, ratio, deviation)

    def _discharge(self, told: FloatArray) -> FloatArray:
        """On-times (vehicles, n) of plasma thrusters: of those on one capacitor the largest duty fires."""
        assert self.spacecraft.discharge is not None
        fires: BoolArray = told > 0.0
        for i, own in enumerate(self._capacitors):
            for j in np.flatnonzero(self._capacitors == own):
                if j != i:
                    fires[:, i] &= (told[:, j] < told[:, i]) | ((told[:, j] == told[:, i]) & (j > i))
        return np.where(fires, self.spacecraft.discharge.firing_time, 0.0)

    def _modulate(self, told: FloatArray, period: float, deviation: FloatArray) -> FloatArray:
        """On-times (vehicles, n) behind the modulator, its lag taken for a delay; `deviation` is written."""
        modulator = self.spacecraft.modulator
        assert modulator is not None
        minimum, opening, closing = self._valves[:3]
        lag = np.array([one.time_constant for one in self.spacecraft.thrusters])
        on_time = np.where(told * period >= minimum, told * period, 0.0)
        self._past = [on_time, *self._past][: math.ceil((modulator.delay + closing.max()) / period) + 2]
        spread = np.hypot(modulator.variation + modulator.jitter, 0.5 * lag)
        total: FloatArray = np.zeros(told.shape)
        later, earlier = np.zeros((2, *told.shape))
        joints, newer = np.zeros(told.shape), np.zeros(told.shape)
        for age, pulse in enumerate(self._past):
            begin = modulator.delay + opening + lag - age * period
            end = begin + pulse + closing - opening
            # Pulses that jitter brings over each other are one, and shorter by what they have in common.
            meets = (begin + period > -spread) & (begin < spread)
            meets = meets & (end >= begin + period - 2.0 * modulator.jitter) & (pulse > 0.0) & (newer > 0.0)
            joints, newer = joints + meets, pulse
            for shift, into in ((0.0, total), (spread, later), (-spread, earlier)):
                first, last = np.maximum(begin + shift, 0.0), np.minimum(end + shift, period)
                into += np.maximum(np.where(pulse > 0.0, last - first, 0.0), 0.0)
        size = np.maximum(np.abs(later - total), np.abs(earlier - total))
        size = np.hypot(size, modulator.jitter * np.sqrt(joints))
        deviation[:] = np.copysign(size, later - earlier)
        return total
