"""The waveforms that a plasma thruster's pulse can have, in a few numbers each.

A pulse depends on two groups alone, its kick and its damping (`thruster_envs.physics.plasma_pulse`): voltage
and current are the charge voltage times functions of the two. Slug mass and electrode width are in the kick
only, so the circuit does not tell one from the other. A slug of u^2 of its mass has the very waveforms that
electrodes of u of their width have, and another thrust: who has to know needs to see how the craft moves.

`PulseLibrary` interpolates between the waveforms of a grid in both groups. It keeps them as coordinates in
the few directions of space that they span. Projected on these directions, a measured waveform of thousands of
samples becomes two dozen numbers, and nothing is lost that would tell pulses apart if its errors are white.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from thruster_envs.extras import extra
from thruster_envs.physics.plasma_pulse import pulse_waveforms
from thruster_envs.protocols import FloatArray
from thruster_envs.spacecraft import Discharge

with extra("baselines", __name__):
    from scipy.interpolate import NdBSpline, make_interp_spline

__all__ = ["PulseLibrary"]

_KICKS = np.linspace(math.log(0.5), math.log(250.0), 76)  # logarithm of the kick over the nominal one
_RESISTANCES = np.linspace(math.log(0.75), math.log(5.0), 26)  # likewise, of the whole circuit
_SPANNING = 5, 2  # every so many of the grid's kicks and resistances span the directions
_DIRECTIONS = 24


class PulseLibrary:
    """Waveforms as a function of charge voltage, kick and resistance.

    Args:
        discharge: The circuit when all is well.
        voltage_error: Standard deviation of a voltage sample, V.
        current_error: Of a current sample, A.

    Attributes:
        discharge: As given.
        directions: (k, 2 samples): orthonormal, of waveforms in units of their errors, voltage first.

    Raises:
        ValueError: An error that is not positive.
    """

    def __init__(self, discharge: Discharge, voltage_error: float = 4.0, current_error: float = 60.0) -> None:
        errors = (("voltage_error", voltage_error, "V"), ("current_error", current_error, "A"))
        for name, value, unit in errors:
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} is {value}; a positive number of {unit} would be right")
        self.discharge = discharge
        self._errors = (voltage_error, current_error)
        kicks, resistances = (slice(None, None, step) for step in _SPANNING)
        spanning = np.concatenate([self._whitened_row(one)[resistances] for one in _KICKS[kicks]])
        _, mixtures = np.linalg.eigh(spanning @ spanning.T)  # of the waveforms; by rising size
        self.directions: FloatArray = np.linalg.qr((mixtures[:, -_DIRECTIONS:].T @ spanning).T)[0].T.copy()
        rows = [self._whitened_row(one) @ self.directions.T for one in _KICKS]
        along = make_interp_spline(_KICKS, np.stack(rows) / discharge.voltage)
        across = make_interp_spline(_RESISTANCES, along.c, axis=1)
        self._spline = NdBSpline((along.t, across.t), np.moveaxis(across.c, 0, 1), k=3)

    def project(self, voltage: FloatArray, current: FloatArray) -> FloatArray:
        """(pulses, k): waveforms (pulses, samples) in V and A in the directions of the library."""
        samples = voltage.shape[-1]
        return np.asarray(
            voltage @ self.directions[:, :samples].T / self._errors[0]
            + current @ self.directions[:, samples:].T / self._errors[1]
        )

    def predict(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The projected waveforms, and how they change.

        Args:
            parameters: (pulses, 3): logarithms of the voltage, of the kick at that voltage and of the
                resistance, each over its nominal value.

        Returns:
            (pulses, k), and its derivatives (pulses, k, 3).
        """
        share, log_kick, log_resistance = np.asarray(parameters).T
        where = np.stack((log_kick + 2.0 * share, log_resistance), axis=-1)
        where = np.clip(where, (_KICKS[0], _RESISTANCES[0]), (_KICKS[-1], _RESISTANCES[-1]))
        voltage = self.discharge.voltage * np.exp(share)[:, np.newaxis]
        wave = voltage * self._spline(where)
        by_kick = voltage * self._spline(where, nu=(1, 0))
        by_resistance = voltage * self._spline(where, nu=(0, 1))
        return wave, np.stack((wave + 2.0 * by_kick, by_kick, by_resistance), axis=-1)

    def nodes(self, step: int) -> FloatArray:
        """(nodes, 3): parameters, as of `predict`, of every so many of the grid, at the nominal voltage."""
        kicks, resistances = np.meshgrid(_KICKS[::step], _RESISTANCES[::step], indexing="ij")
        return np.stack((np.zeros(kicks.size), kicks.ravel(), resistances.ravel()), axis=-1)

    def _whitened_row(self, log_kick: float) -> FloatArray:
        """(resistances, 2 samples): waveforms of one kick in units of the errors, voltage first."""
        least = math.exp(_RESISTANCES[0])
        circuit = dataclasses.replace(self.discharge, resistance=least * self.discharge.resistance)
        waves = pulse_waveforms(
            circuit,
            slug_mass=self.discharge.slug_mass * math.exp(-log_kick),
            added_resistance=self.discharge.resistance * (np.exp(_RESISTANCES) - least),
        )
        return np.concatenate((waves.voltage / self._errors[0], waves.current / self._errors[1]), axis=-1)
