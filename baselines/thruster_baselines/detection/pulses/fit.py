"""What a pulse's waveforms say of its thruster (charge voltage, kick, resistance), and what they leave open.

A healthy thruster at whatever charge voltage, and one whose kick and resistance have changed besides, are
fitted to the measured voltage and current by least squares, in the directions of the library
(`thruster_baselines.detection.pulses.library`). Twice the logarithm of the likelihood ratio of the two is the
statistic; on healthy pulses, with errors as stated, it is chi-squared of two degrees of freedom.

Propellant loss (less mass) and electrode sediment (less width) have the same waveforms and different thrust.
So the thrust is given for either, and whoever knows the cause from elsewhere takes the one that holds.
Without it a pulse is declared faulty if either of them would take its thrust out of the band.

Left out: whatever else can be wrong with a circuit; errors of samples that are not white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.pulses.library import PulseLibrary
from thruster_envs.physics.plasma_pulse import PulseMap
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Discharge

__all__ = ["BAND", "PulseEstimate", "PulseFit", "pulse_arrays"]

BAND = 0.15
"""How far off nominal the thrust of a healthy pulse may be, as a share (Valdes 2008, eq. 4.1)."""

_ITERATIONS = 6
_LARGEST_STEP = 0.5  # of the logarithms, in one iteration
_LEAST_SCALE = 0.1  # of the voltage, at the beginning
_STARTS = 3  # every so many nodes of the library's grid are tried as a beginning
_HEALTHY, _CHANGED = slice(0, 1), slice(0, 3)  # which of voltage, kick and resistance are free


@dataclass(frozen=True, slots=True)
class PulseEstimate:
    """What is estimated of each pulse.

    Attributes:
        statistic: (pulses,): twice the log-likelihood ratio of a changed thruster against a healthy one.
        parameters: (pulses, 3): logarithms of the voltage, of the kick at that voltage and of the resistance,
            each over its nominal value.
        deviation: (pulses, 3): standard deviations of their errors.
        thrust_if_mass: (pulses,): thrust over nominal thrust if it is the slug's mass that changed the kick.
        thrust_if_width: (pulses,): the same if it is the width of the electrodes.
    """

    statistic: FloatArray
    parameters: FloatArray
    deviation: FloatArray
    thrust_if_mass: FloatArray
    thrust_if_width: FloatArray

    @property
    def impulse_changed(self) -> BoolArray:
        """(pulses,): whether the impulse stands out more than the resistance, in its standard deviations."""
        apart = np.abs(self.parameters) / self.deviation
        return np.asarray(apart[:, 1] > apart[:, 2])

    @property
    def kick_changed(self) -> BoolArray:
        """The name of before of `impulse_changed`; to go after one version."""
        return self.impulse_changed

    def faulty(self, width: ArrayLike | None = None, band: float = BAND) -> BoolArray:
        """(pulses,): whether the thrust is out of the band.

        Args:
            width: (pulses,) or one for all: whether a change of the kick is known to be one of the width, or
                known to be one of the mass; None if neither is known.
            band: Allowed share off nominal.
        """
        by_mass = np.abs(self.thrust_if_mass - 1.0) > band
        by_width = np.abs(self.thrust_if_width - 1.0) > band
        return np.asarray(by_mass | by_width if width is None else np.where(width, by_width, by_mass))


class PulseFit:
    """Fits the circuit to measured pulses.

    Args:
        discharge: The circuit when all is well.
        voltage_error: Standard deviation of a voltage sample, V.
        current_error: Of a current sample, A.

    Attributes:
        library: Of waveforms.

    Raises:
        ValueError: An error that is not positive.

    A slug that has lost a quarter of its mass pushes all but as before; electrodes with the same waveforms
    push 15 % too strong:

    >>> from thruster_envs.physics.plasma_pulse import pulse_waveforms
    >>> from thruster_envs.spacecraft import load
    >>> discharge = load("ppt_cubesat").discharge
    >>> wave = pulse_waveforms(discharge, slug_mass=[0.7468 * discharge.slug_mass])
    >>> estimate = PulseFit(discharge)(wave.voltage, wave.current)
    >>> estimate.thrust_if_mass.round(3), estimate.thrust_if_width.round(3)
    (array([0.991]), array([1.147]))
    """

    def __init__(self, discharge: Discharge, voltage_error: float = 4.0, current_error: float = 60.0) -> None:
        self.library = PulseLibrary(discharge, voltage_error, current_error)
        self._map = PulseMap.of(discharge)
        self._nodes = self.library.nodes(_STARTS)
        self._at_nodes = self.library.predict(self._nodes)[0]

    def __call__(self, voltage: ArrayLike, current: ArrayLike) -> PulseEstimate:
        """Fit.

        Args:
            voltage: (pulses, samples), V, as measured.
            current: (pulses, samples), A, as measured.

        Raises:
            ValueError: Waveforms that are not of the samples of the circuit.
        """
        return self.of_projections(
            self.library.project(*pulse_arrays(self.library.discharge, voltage, current))
        )

    def of_projections(self, seen: FloatArray) -> PulseEstimate:
        """Fit to pulses that are given by their coordinates (pulses, k) in the library's directions."""
        _, misfit_healthy, _ = self._descend(seen, np.zeros((len(seen), 3)), _HEALTHY)
        found, misfit, deviation = self._descend(seen, self._start(seen), _CHANGED)
        ratio, nominal = np.exp(found[:, 1]), np.ones(len(found))
        rest = {
            "added_resistance": self.library.discharge.resistance * np.expm1(found[:, 2]),
            "voltage_share": np.exp(found[:, 0]),
        }
        return PulseEstimate(
            statistic=np.asarray(misfit_healthy - misfit),
            parameters=found,
            deviation=deviation,
            thrust_if_mass=self._map.ratio(mass_share=1.0 / ratio, width_share=nominal, **rest),
            thrust_if_width=self._map.ratio(mass_share=nominal, width_share=1.0 / np.sqrt(ratio), **rest),
        )

    def charge_voltage(self, voltage: ArrayLike, current: ArrayLike) -> FloatArray:
        """(pulses,), V: the charge voltage at which a nominal pulse fits waveforms (pulses, samples) best.

        Raises:
            ValueError: Waveforms that are not of the samples of the circuit.
        """
        seen = self.library.project(*pulse_arrays(self.library.discharge, voltage, current))
        found, _, _ = self._descend(seen, np.zeros((len(seen), 3)), _HEALTHY)
        return np.asarray(self.library.discharge.voltage * np.exp(found[:, 0]))

    def _start(self, seen: FloatArray) -> FloatArray:
        """(pulses, 3): the node that fits best, at the voltage at which it does."""
        power = (self._at_nodes**2).sum(axis=-1)
        best = np.argmax(np.maximum(seen @ self._at_nodes.T, 0.0) ** 2 / power, axis=-1)
        log_scale = np.log(np.maximum((seen * self._at_nodes[best]).sum(axis=-1) / power[best], _LEAST_SCALE))
        return np.asarray(self._nodes[best] + log_scale[:, np.newaxis] * np.array([1.0, -2.0, 0.0]))

    def _descend(
        self, seen: FloatArray, start: FloatArray, free: slice
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gauss and Newton's least squares in those parameters that are free.

        Returns:
            Parameters (pulses, 3), the sum of squares (pulses,), standard deviations (pulses, free).
        """
        found = start.copy()
        for _ in range(_ITERATIONS):
            wave, slope = self.library.predict(found)
            slope = slope[..., free]
            normal = np.swapaxes(slope, -1, -2) @ slope
            pull = np.einsum("pki,pk->pi", slope, seen - wave)
            step = np.linalg.solve(normal, pull[..., np.newaxis])[..., 0]
            found[:, free] += np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        wave, slope = self.library.predict(found)
        slope = slope[..., free]
        covariance = np.linalg.inv(np.swapaxes(slope, -1, -2) @ slope)
        deviation = np.asarray(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)), dtype=np.float64)
        return found, ((seen - wave) ** 2).sum(axis=-1), deviation


def pulse_arrays(
    discharge: Discharge, voltage: ArrayLike, current: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Waveforms (pulses, samples) as arrays.

    Raises:
        ValueError: Waveforms that are not of the samples of the circuit.
    """
    waves = np.asarray(voltage, dtype=np.float64), np.asarray(current, dtype=np.float64)
    samples = discharge.number_of_samples
    for name, wave in zip(("voltage", "current"), waves, strict=True):
        if wave.ndim != 2 or wave.shape != (len(waves[0]), samples):
            raise ValueError(f"{name} has the shape {wave.shape}; (pulses, {samples}) would be right")
    return waves
