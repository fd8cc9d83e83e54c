"""On-times for thrusters of which some are weak, dead, or fire whatever they are told.

Of a belief (`thruster_baselines.belief`), the shares and what is stuck on count. A valve that is stuck open
is not closed, since Orion has no second valve before each thruster: its thrust a_i e_i is there in every
period, and the others have to solve A U = T - a_i e_i for a commanded rate change T (after Yang 2003, section
5.3.1, which assumes that it can be shut off). It also takes its part of the feed, so that every other
thruster is one of at least two, and how much it delivers itself depends on how long the others are open: a
fixed point, found in a few linear programs.

Left out: closing `Spacecraft.isolation_valves` where there are some; whoever does, as the action of
`MarsRendezvous-v1` with `inhibit=True` can, believes that thruster dead (share 0, not stuck on) from then on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.belief import ActuatorBelief
from thruster_baselines.mapping import (
    AdditiveCompensationMapper,
    ExactCompensationMapper,
    LPMapper,
    delivered_on_times,
)
from thruster_envs.configuration import require
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["FaultAllocation", "ThrusterBelief"]

_SINGLE = 1.2e-7  # by so large a share single precision may round a command down
_AGREED = 2e-5  # of the period: so well is known what a stuck thruster delivers when on-times are taken
_MOST_PROGRAMS = 20
_HOLDING = 3  # open for a whole period, at a first guess
_RELAXATION = 0.7  # the longer a stuck thruster delivers, the longer the others fire, and the less it does


class ThrusterBelief(ActuatorBelief):
    """The name of before of `thruster_baselines.belief.ActuatorBelief`; to go after one version."""

    def __new__(cls, share: ArrayLike, stuck_on: ArrayLike) -> ActuatorBelief:  # type: ignore[misc]
        """See `ActuatorBelief.of_shares`."""
        return ActuatorBelief.of_shares(share, stuck_on)

    @classmethod
    def healthy(cls, *shape: int) -> ActuatorBelief:
        """See `ActuatorBelief.healthy`."""
        return ActuatorBelief.healthy(*shape)


class FaultAllocation:
    """Maps commanded rate changes to on-times as far as faulty thrusters allow, feed coupling included.

    What a valve that is stuck open gives is cancelled by the others, also where an isolation valve could end
    it.

    Args:
        spacecraft: Nominal.
        compensation: The mapper that makes up for the coupling loss: exactly, or by method II.
        rotation_priority: How much dearer a missed rotation is than in the mapper's own objective.

    Raises:
        ValueError: A compensation that is neither of the two classes.

    >>> allocation = FaultAllocation("orion")
    >>> stuck = ActuatorBelief.healthy(12).changed(1, share=1.0, stuck_on=True)
    >>> on_times = allocation(np.zeros(6), stuck)  # nothing is wanted, so the others hold against it
    >>> bool(abs(allocation.rate_change(on_times, stuck)).max() < 1e-5)
    True
    """

    def __init__(
        self,
        spacecraft: Spacecraft | str,
        compensation: type[ExactCompensationMapper]
        | type[AdditiveCompensationMapper] = ExactCompensationMapper,
        rotation_priority: float = 1.0,
    ) -> None:
        require(
            compensation in (ExactCompensationMapper, AdditiveCompensationMapper),
            "compensation",
            compensation,
            "the class ExactCompensationMapper or AdditiveCompensationMapper",
        )
        if isinstance(spacecraft, str):
            from thruster_envs.spacecraft import load

            spacecraft = load(spacecraft)
        self.spacecraft, self._compensation = spacecraft, compensation
        self.nominal = spacecraft.effectiveness()
        self._thrusters = self.nominal.shape[1]
        self._minimum = np.array([one.minimum_pulse for one in spacecraft.thrusters])
        plain = LPMapper(spacecraft)
        self._slack_cost = plain.slack_cost * np.repeat([1.0, rotation_priority], 3)
        self._fuel_cost = plain.fuel_cost
        self._mappers: dict[float, ExactCompensationMapper | AdditiveCompensationMapper] = {}

    def effectiveness(self, belief: ActuatorBelief) -> FloatArray:
        """(m, n), m/s^2 then rad/s^2: of an open valve, as believed."""
        return belief.effectiveness(self.nominal)

    def acting(self, on_times: ArrayLike, belief: ActuatorBelief) -> FloatArray:
        """(n,), s: for how long valves are open that were commanded to be open for `on_times` (n,).

        A command below the minimum pulse opens none.
        """
        told = np.asarray(on_times, np.float64)
        opened = np.where(told >= self._minimum * (1.0 - _SINGLE), told, 0.0)
        return np.where(belief.stuck_on, self.spacecraft.control_period, opened)

    def delivered(self, on_times: ArrayLike, belief: ActuatorBelief) -> FloatArray:
        """(n,), s: firing alone that would give the same as `on_times` (n,) give in company.

        A valve that is stuck half open takes half of the others' loss.
        """
        coupling, stuck = self.spacecraft.feed.coupling, belief.stuck_on
        whole: FloatArray = delivered_on_times(self.acting(on_times, belief), coupling)
        if not stuck.any():
            return whole
        without = delivered_on_times(np.where(stuck, 0.0, self.acting(on_times, belief)), coupling)
        opening = float(belief.share[stuck].mean())
        return np.where(stuck, whole, opening * whole + (1.0 - opening) * without)

    def rate_change(self, on_times: ArrayLike, belief: ActuatorBelief) -> FloatArray:
        """(m,), m/s then rad/s: what commanded on-times (n,) are expected to give."""
        change: FloatArray = self.effectiveness(belief) @ self.delivered(on_times, belief)
        return change

    def __call__(self, command: ArrayLike, belief: ActuatorBelief) -> FloatArray:
        """On-times (n,), s, to command for a rate change (m,), m/s then rad/s; none to who is stuck on."""
        wanted, stuck = np.asarray(command, dtype=np.float64), belief.stuck_on
        effectiveness = self.effectiveness(belief)
        load = round(float(belief.share[stuck].sum()), 2)
        mapper = self._mapper(load)
        if not stuck.any():
            return self._possible(mapper(wanted, effectiveness=effectiveness).on_times)
        period = self.spacecraft.control_period
        bounds = np.where(stuck, 0.0, period)
        others = np.where(stuck, 0.0, effectiveness)
        holding = np.where(stuck, period, 0.0)
        holding[np.flatnonzero(~stuck)[:_HOLDING]] = period
        constant = delivered_on_times(holding, self.spacecraft.feed.coupling) * stuck
        for _ in range(_MOST_PROGRAMS):
            against = wanted - effectiveness @ constant
            on_times = mapper(against, effectiveness=others, max_on_time=bounds).on_times
            wrong = self.delivered(on_times, belief) * stuck - constant
            if float(np.abs(wrong).max()) <= _AGREED * period:
                break
            constant += wrong * _RELAXATION
        return self._possible(on_times)

    def _possible(self, on_times: FloatArray) -> FloatArray:
        """On-times (n,), s, of which none is below a minimum pulse: rounded to it or to none."""
        short = on_times < self._minimum
        return np.where(short, np.where(on_times >= 0.5 * self._minimum, self._minimum, 0.0), on_times)

    def _mapper(self, load: float) -> ExactCompensationMapper | AdditiveCompensationMapper:
        """For so many valves stuck open, or openings together, which take their part of the feed."""
        if load not in self._mappers:
            loss = self.spacecraft.feed.coupling * (np.arange(self._thrusters) + load)
            self._mappers[load] = self._compensation(
                self.spacecraft,
                fuel_cost=self._fuel_cost,
                slack_cost=self._slack_cost,
                coupling=np.minimum(loss, 1.0),
            )
        return self._mappers[load]
