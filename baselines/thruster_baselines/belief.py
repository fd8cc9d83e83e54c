"""What is believed of thrusters: one form for detectors, mappers and pilots.

What a thruster delivers is taken as a function of its commanded duty u that needs no time, floor + slope (u -
lost): stuck at c it is c, leaking c + (1 - c) u, a weak one gives a share of u, a late one loses the
beginning of each pulse, a closed one gives nothing. A share of effectiveness and a valve that is stuck open,
as a linear mapper takes them, are `share` and `stuck_on`. What faults make of an actuator is said by
`thruster_envs.physics.health`.

Left out: how sure a belief is; a slow valve, which is taken to deliver all that is commanded.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.physics.health import effect_of
from thruster_envs.protocols import BoolArray, FloatArray

__all__ = ["ActuatorBelief"]

_BELIEVED = ("stuck_on", "stuck_off", "leak", "loss", "late_opening", "slow_opening")
_ROUND_OFF = 1e-9  # duties over a bound by less than this are within it


class ActuatorBelief(NamedTuple):
    """What thrusters deliver when they are commanded a duty, of one vehicle (n,) or of several (vehicles, n).

    Attributes:
        floor: (..., n), what is delivered whatever is commanded, as a duty of a healthy thruster.
        slope: (..., n), what is delivered more for each unit that is commanded.
        lost: (..., n), duty that a late thruster loses of each pulse.
        hold: (..., n), what a thruster that does not follow is commanded all the same; NaN for others.

    >>> belief = ActuatorBelief.healthy(3).changed(2, share=0.5)
    >>> belief.share, belief.effectiveness([[1.0, 2.0, 4.0]])
    (array([1. , 0.5, 1. ]), array([[1., 1., 4.]]))
    """

    floor: FloatArray
    slope: FloatArray
    lost: FloatArray
    hold: FloatArray

    @classmethod
    def healthy(cls, *shape: int) -> ActuatorBelief:
        """Full thrust from each: of so many thrusters, or of (vehicles, thrusters)."""
        return cls(np.zeros(shape), np.ones(shape), np.zeros(shape), np.full(shape, np.nan))

    @classmethod
    def sound(cls, vehicles: int, thrusters: int) -> ActuatorBelief:
        """The name of before of `healthy`; to go after one version."""
        return cls.healthy(vehicles, thrusters)

    @classmethod
    def of_shares(cls, share: ArrayLike, stuck_on: ArrayLike = False) -> ActuatorBelief:
        """From shares of nominal thrust (..., n), delivered all the time where the valve is stuck open.

        Raises:
            ValueError: A valve that is stuck open and delivers nothing.
        """
        given = np.array(share, np.float64)
        stuck = np.broadcast_to(np.asarray(stuck_on, np.bool_), given.shape)
        if (stuck & ~(given > 0.0)).any():
            raise ValueError("share of a thruster that is stuck on must be above 0, got 0")
        healthy = cls.healthy(*given.shape)
        return healthy._replace(floor=np.where(stuck, given, 0.0), slope=np.where(stuck, 0.0, given))

    @property
    def share(self) -> FloatArray:
        """(..., n), of its nominal thrust that a thruster gives while its valve is open; 0 for a dead one."""
        return self.floor + self.slope

    @property
    def stuck_on(self) -> BoolArray:
        """(..., n), whether it delivers the same, and not nothing, whatever is commanded."""
        return np.asarray((self.slope == 0.0) & (self.floor > 0.0))

    def effectiveness(self, nominal: ArrayLike) -> FloatArray:
        """(..., m, n) of open valves, for a nominal one (m, n), m/s^2 then rad/s^2."""
        return np.asarray(nominal, np.float64) * self.share[..., np.newaxis, :]

    def changed(self, thruster: int, *, share: float, stuck_on: bool = False) -> ActuatorBelief:
        """The same with another belief about one thruster, numbered from 1."""
        shares, stuck = self.share.copy(), self.stuck_on.copy()
        shares[..., thruster - 1], stuck[..., thruster - 1] = share, stuck_on
        return ActuatorBelief.of_shares(shares, stuck)

    @property
    def lower(self) -> FloatArray:
        """(vehicles, n), the least that a thruster delivers."""
        return self.floor

    @property
    def upper(self) -> FloatArray:
        """(vehicles, n), the most."""
        return self.floor + self.slope * (1.0 - self.lost)

    def trust(self, mask: BoolArray | int) -> None:
        """Believe that all is well on the vehicles of a mask (vehicles,) or of an index."""
        self.floor[mask], self.slope[mask] = 0.0, 1.0
        self.lost[mask], self.hold[mask] = 0.0, np.nan

    def take(self, other: ActuatorBelief, vehicle: int) -> None:
        """Believe of a vehicle what another one does."""
        for mine, theirs in zip(self, other, strict=True):
            mine[vehicle] = theirs[vehicle]

    def blame(
        self, vehicle: int, thruster: int, kind: str, severity: float, *, period: float, idle: float = 0.1
    ) -> None:
        """Believe in one fault of a vehicle, and that all else on it is well.

        A thruster that does not follow goes on being told what it was told before, first the idle rate: if it
        follows after all, what comes is still a constant.

        Args:
            vehicle: Its index.
            thruster: Its number, from 1.
            kind: As in `thruster_envs.faults`; a slow thruster delivers all that it is told.
            severity: Of that kind.
            period: s, of control: an opening that is as late loses the pulse.
            idle: Open rate.

        Raises:
            ValueError: A kind that is none of these.

        >>> belief = ActuatorBelief.healthy(1, 2)
        >>> belief.blame(0, 2, "leak", 0.3, period=0.1)
        >>> belief.delivered([[0.1, 0.1]])
        array([[0.1 , 0.37]])
        """
        at = vehicle, thruster - 1
        held = float(self.hold[at])
        self.trust(vehicle)
        if kind not in _BELIEVED:
            raise ValueError(
                f"kind is {kind!r}; stuck_on, stuck_off, leak, loss, late_opening or slow_opening would be "
                "right"
            )
        effect = effect_of(kind, 1.0 if kind == "stuck_off" else severity)
        self.floor[at], self.slope[at] = effect.floor, effect.slope * effect.gain
        self.lost[at] = min(effect.delay / period, 1.0)
        if self.slope[at] == 0.0 and kind in ("stuck_on", "stuck_off"):
            self.hold[at] = held if held > 0.0 else idle

    def together(self, vehicle: int, thruster: int, kind: str, severity: float) -> tuple[str, float]:
        """Kind and severity of a fault and what is believed of a thruster, from 1, already.

        >>> belief = ActuatorBelief.healthy(1, 2)
        >>> belief.blame(0, 2, "loss", 0.5, period=0.1)
        >>> belief.together(0, 2, "loss", 0.5)
        ('loss', 0.75)
        """
        at = vehicle, thruster - 1
        if self.hold[at] > 0.0:  # it is told one and the same, and whatever comes is a constant
            now = float(self.floor[at])
            if kind not in _BELIEVED:
                return "stuck_on", now
            effect = effect_of(kind, 1.0 if kind == "stuck_off" else severity, (now, 0.0, 1.0))
            return "stuck_on", effect.gain * effect.floor
        if kind == "leak" or (kind == "loss" and self.floor[at] == 0.0):
            return kind, 1.0 - float(self.slope[at]) * (1.0 - severity)
        return kind, severity

    def close(self, vehicle: int, thruster: int) -> None:
        """The isolation valve of a thruster, from 1, is closed: it delivers nothing and is told nothing."""
        at = vehicle, thruster - 1
        self.floor[at] = self.slope[at] = self.lost[at] = self.hold[at] = 0.0

    def commands(self, delivered: FloatArray) -> FloatArray:
        """(vehicles, n) open rates to tell for those to be delivered."""
        over = delivered - self.floor
        told = np.divide(over, self.slope, out=np.zeros_like(over), where=self.slope > 0.0)
        told = np.where(over > _ROUND_OFF, told + self.lost, 0.0)
        return np.asarray(np.clip(np.where(np.isnan(self.hold), told, self.hold), 0.0, 1.0))

    def delivered(self, commands: ArrayLike) -> FloatArray:
        """(vehicles, n) open rates of sound thrusters that commands (vehicles, n) come to."""
        told = np.asarray(commands, np.float64)
        return np.asarray(self.floor + self.slope * np.maximum(told - self.lost, 0.0))
