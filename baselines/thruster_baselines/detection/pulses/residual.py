"""How far a pulse is from a nominal one at its own charge voltage: the plainest test of a plasma thruster.

The residual is the mean of the absolute difference between the measured current and that of a nominal
circuit, over the nominal peak: the measure of Valdes 2008, section 4.4, with the physical model in the place
of the network. The model's charge voltage is the one at which a nominal pulse fits voltage and current best.

It sees whatever changes the current, and by how much, but not what that means for the thrust: propellant loss
that takes 15 % of the thrust moves the current ten times as far as electrode sediment that adds as much.
`thruster_baselines.detection.pulses.fit` estimates the thrust.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.detection.pulses.fit import PulseFit
from thruster_envs.physics.plasma_pulse import pulse_waveforms
from thruster_envs.protocols import BoolArray, FloatArray

__all__ = ["PulseResidual"]


class PulseResidual:
    """Declares a pulse faulty whose current is too far from the nominal one.

    Args:
        fit: Finds the charge voltage.
        threshold: Of the residual, as a share of the nominal peak; a healthy pulse has that of the errors of
            its samples, 0.8 of their standard deviation over the peak.

    Raises:
        ValueError: A threshold that is not positive.
    """

    def __init__(self, fit: PulseFit, threshold: float) -> None:
        if not threshold > 0.0:
            raise ValueError(f"threshold is {threshold}; a positive share would be right")
        self.threshold = threshold
        self._fit = fit
        self._discharge = fit.library.discharge
        self._peak = float(pulse_waveforms(self._discharge).current.max())

    def residual(self, voltage: ArrayLike, current: ArrayLike) -> FloatArray:
        """(pulses,), as a share of the nominal peak, of waveforms (pulses, samples) in V and A.

        Raises:
            ValueError: Waveforms that are not of the samples of the circuit.
        """
        charge = self._fit.charge_voltage(voltage, current)
        nominal = pulse_waveforms(self._discharge, voltage=charge).current
        return np.asarray(np.abs(np.asarray(current) - nominal).mean(axis=-1) / self._peak)

    def __call__(self, voltage: ArrayLike, current: ArrayLike) -> BoolArray:
        """(pulses,): whether each is declared faulty."""
        return np.asarray(self.residual(voltage, current) > self.threshold)
