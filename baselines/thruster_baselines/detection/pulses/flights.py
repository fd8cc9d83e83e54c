"""Missions of pulsed plasma craft as flights on which detectors are measured.

What `thruster_envs.missions.fly_missions` flew, of one craft, and the waveforms of its pulses with the errors
of their samples, drawn from the seed of the mission when they are asked for.

Left out: several faults of the craft.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thruster_baselines.detection.contract import Telemetry
from thruster_baselines.detection.flights import truth_of
from thruster_envs.missions import Discharges, Missions
from thruster_envs.physics.plasma_pulse import pulse_waveforms
from thruster_envs.physics.pulsed_craft import discharge_of
from thruster_envs.protocols import FloatArray, IntArray
from thruster_envs.spacecraft import Spacecraft

__all__ = ["PulseFlights"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PulseFlights:
    """Missions of one craft of each formation; see `of`.

    An interval more than there are control periods ends them, with the last measurement and without pulses.

    Attributes:
        spacecraft: What flies.
        pulses: (missions, intervals, pairs): 1, -1 or 0, in the period that begins with the measurement.
        attitude: (missions, intervals, 4), measured at the beginning of the period, from the leader's axes.
        rate: (missions, intervals, 3), rad/s, likewise, relative to the leader.
        target: (missions, 4), attitude that is asked for.
        discharges: Of each mission, every firing in the order of time.
        seeds: One for each mission: of the errors of waveforms.
        errors: Standard deviations of a voltage sample, V, and of a current sample, A; None for no waveforms.
        thruster: (missions,), the one that fails, from 1; 0 in a healthy mission.
        kind: (missions,), of the fault, or `none`.
        severity: (missions,); 0 in a healthy mission.
        onset: (missions,), s since the start; infinite in a healthy mission.
    """

    spacecraft: Spacecraft
    pulses: FloatArray
    attitude: FloatArray
    rate: FloatArray
    target: FloatArray
    discharges: tuple[Discharges, ...]
    seeds: tuple[int, ...]
    errors: tuple[float, float] | None
    thruster: IntArray
    kind: tuple[str, ...]
    severity: FloatArray
    onset: FloatArray

    @classmethod
    def of(
        cls,
        missions: Missions,
        seeds: Sequence[int],
        *,
        craft: int = 1,
        errors: tuple[float, float] | None = None,
    ) -> PulseFlights:
        """Those of one craft, from 0 for the leader, that has one fault at most."""
        pulses = np.pad(missions.pulses[:, :, craft].astype(np.float64), ((0, 0), (0, 1), (0, 0)))
        return cls(
            spacecraft=missions.spacecraft, pulses=pulses, attitude=missions.measured_attitude[:, :, craft],
            rate=missions.measured_rate[:, :, craft], target=missions.targets[:, craft],
            discharges=tuple(missions.discharges(k, craft) for k in range(len(pulses))), seeds=tuple(seeds),
            errors=errors, **truth_of(missions.faults[:, craft, 0]),
        )  # fmt: skip

    @property
    def on_times(self) -> FloatArray:
        """(missions, intervals, n), s: how long a pulse counts as full thrust."""
        first, second = np.maximum(self.pulses, 0.0), np.maximum(-self.pulses, 0.0)
        times = np.stack((first, second), axis=-1).reshape(*self.pulses.shape[:2], -1)
        return np.asarray(discharge_of(self.spacecraft).firing_time * times)

    @property
    def duration(self) -> float:
        """Of a control period, s."""
        return self.spacecraft.control_period

    @property
    def first_answer(self) -> float:
        """s; the pulses of the first period have been measured at its end."""
        return self.duration

    def telemetry(self, flights: slice, interval: int) -> Telemetry:
        """What a detector is given of one interval of some of them."""
        at = (flights, interval)
        seen = Telemetry(
            self.duration, pulses=self.pulses[at], attitude=self.attitude[at], rate=self.rate[at],
            target=self.target[flights],
        )  # fmt: skip
        if self.errors is None:
            return seen
        count, pairs = self.pulses[at].shape
        discharge = discharge_of(self.spacecraft)
        voltage, current = np.full((2, count, pairs, discharge.number_of_samples), np.nan)
        for row, mission in enumerate(range(len(self.pulses))[flights]):
            fired = self.discharges[mission]
            which = np.flatnonzero(fired.step == interval)
            if which.size == 0:
                continue
            waves = pulse_waveforms(discharge, **fired.parameters(which))
            axes = (fired.thruster[which] - 1) // 2
            noise = np.random.default_rng((self.seeds[mission], interval)).normal(
                size=(2, which.size, discharge.number_of_samples)
            )
            voltage[row, axes] = waves.voltage + self.errors[0] * noise[0]
            current[row, axes] = waves.current + self.errors[1] * noise[1]
        return seen._replace(voltage=voltage, current=current)
