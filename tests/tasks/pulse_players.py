"""A classical player for the diagnosis of pulses: the pulse model fitted to what is seen of each pulse."""

import numpy as np

from thruster_envs.physics.plasma_pulse import PulseMap, pulse_waveforms
from thruster_envs.tasks.pulse_diagnosis import peak_current

HEALTHY, PROPELLANT_LOSS, ELECTRODE_SEDIMENT, CONDUCTIVITY_LOSS = range(4)


class WaveformPlayer:
    """Compares each pulse with those of a stronger kick and with those of more resistance, at any charge.

    It takes the likeliest and declares what its thrust says. A kick so strong that a lighter slug would be
    faulty is held for a lighter slug, a weaker one for narrower electrodes, though both give the same pulse.
    """

    def __init__(self, task):
        discharge, numbers = task.discharge, task.sample_numbers
        self.kick = np.linspace(-0.2, 5.0, 261)  # logarithms
        self.added = np.linspace(0.0, 0.06, 121)  # ohm
        pulses = pulse_waveforms(
            discharge,
            slug_mass=discharge.slug_mass * np.exp(-np.concatenate((self.kick, 0.0 * self.added))),
            added_resistance=np.concatenate((0.0 * self.kick, self.added)),
        )
        noise = np.repeat((task.voltage_noise, task.current_noise), task.samples)
        self.scale = np.repeat((discharge.voltage, peak_current(discharge)), task.samples) / noise
        self.templates = np.concatenate((pulses.voltage[:, numbers], pulses.current[:, numbers]), axis=1)
        self.templates /= noise
        self.powers = np.sum(self.templates**2, axis=1)
        self.map, self.band, self.columns = PulseMap.of(discharge), task.band, 2 * task.samples

    def fit(self, observations):
        """Likeliest kick (logarithm, over that at the same charge), added resistance in ohm, and charge."""
        along = (observations[:, : self.columns] * self.scale) @ self.templates.T
        best = np.argmax(along**2 / self.powers, axis=1)
        charge = along[np.arange(len(best)), best] / self.powers[best]
        kicks = np.concatenate((self.kick, 0.0 * self.added))[best]
        kicks = np.where(best < len(self.kick), kicks - 2.0 * np.log(charge), 0.0)
        return kicks, np.concatenate((0.0 * self.kick, self.added))[best], charge

    def __call__(self, observations):
        kick, added, charge = self.fit(observations)
        lighter = self.map.ratio(mass_share=np.exp(-kick), voltage_share=charge)
        narrower = self.map.ratio(width_share=np.exp(-0.5 * kick), voltage_share=charge)
        worse = self.map.ratio(added_resistance=added, voltage_share=charge)
        declared = np.where(worse < 1.0 - self.band, CONDUCTIVITY_LOSS, HEALTHY)
        declared = np.where(narrower > 1.0 + self.band, ELECTRODE_SEDIMENT, declared)
        declared = np.where(lighter < 1.0 - self.band, PROPELLANT_LOSS, declared)
        return declared[:, np.newaxis]


class ThrustPlayer(WaveformPlayer):
    """The same with the thrust measured, as the observation after the declarations: no pulse is ambiguous."""

    def __call__(self, observations):
        thrust, cause = observations[:, self.columns + 4], super().fit(observations)[1]
        weak = np.where(cause > 0.0, CONDUCTIVITY_LOSS, PROPELLANT_LOSS)
        declared = np.where(thrust < 1.0 - self.band, weak, HEALTHY)
        return np.where(thrust > 1.0 + self.band, ELECTRODE_SEDIMENT, declared)[:, np.newaxis]
