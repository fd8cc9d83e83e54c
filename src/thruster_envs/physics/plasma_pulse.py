"""One pulse of a plasma thruster: the current of a capacitor throws a slug of plasma out between electrodes.

Models the electromechanical slug of Valdes 2008 (eqs. 3.31-3.33) as corrected here: the slug is driven by the
square of the *current* (the printed equation has the velocity), the capacitor's voltage is what is left of
its charge, and the plasma's resistance stays as it is when the electrodes' width changes. With the charge
``q`` that has left the capacitor, the current ``i`` and the slug's position ``x`` and velocity ``u``::

    q' = i,  x' = u,  u' = L' i^2 / (2 m),  i' = (V - q / C - (L' u + R) i) / (L + L' x)

with the gradient of the inductance ``L' = mu_0 gap / width``.

Leaves out the ablation and its resistance, the end of the channel, wear by use, and how the capacitor is
charged.

In units of the circuit (time ``sqrt(L C)``, charge ``C V``, length ``L / L'``) a pulse depends on two numbers
only: its *kick* ``(L' C V)^2 / (2 m L)`` and its *damping* ``R sqrt(C / L)``. So the thrust of a pulse of any
slug mass, width, resistance and voltage stands in one table over these two, the :class:`PulseMap` of a
discharge. In flight a firing gives the nominal impulse of its thruster times :func:`pulse_ratio`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.configuration import require
from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.spacecraft import Discharge

FloatArray = NDArray[np.float64]

#: Magnetic permeability of the vacuum, H/m.
MU_0 = 4e-7 * math.pi
#: Largest kick and damping of a pulse: an integration step of one sample follows no wilder ones.
MOST_KICK, MOST_DAMPING = 1500.0, 30.0
#: Pulses that the kernel follows side by side.
_LANES = 16
#: Distance of the nodes of a map in the logarithms of kick and damping, and how many of them lie below and
#: above the nominal pulse: from a fifth of its kick to 5,000 times, from its damping to 25 times.
_KICK_STEP, _KICKS_BELOW, _KICKS_ABOVE = 0.125, 14, 70
_DAMPING_STEP, _DAMPINGS_BELOW, _DAMPINGS_ABOVE = 0.1, 1, 34
#: Largest kick of a node, and largest product of its damping and a step: a map ends where either is reached.
_LAST_KICK, _LAST_DAMPING_STEPS = 1e4, 1.0


class Waveforms(NamedTuple):
    """Pulses followed in time.

    Attributes:
        time: (samples,), s from the beginning of a pulse.
        voltage: (..., samples), of the capacitor, V.
        current: (..., samples), A.
        position: (..., samples), of the slug, m.
        velocity: (..., samples), of the slug, m/s.
    """

    time: FloatArray
    voltage: FloatArray
    current: FloatArray
    position: FloatArray
    velocity: FloatArray


def pulse_waveforms(
    discharge: Discharge,
    *,
    slug_mass: ArrayLike | None = None,
    electrode_width: ArrayLike | None = None,
    added_resistance: ArrayLike = 0.0,
    voltage: ArrayLike | None = None,
) -> Waveforms:
    """Pulses of a discharge some of whose values are others, sample by sample.

    Args:
        discharge: The circuit.
        slug_mass: kg; None for that of the discharge. The arguments are broadcast against each other; each
            combination is one pulse.
        electrode_width: m; None for that of the discharge.
        added_resistance: Beside that of the discharge, ohm.
        voltage: At the beginning, V; None for that of the discharge.

    Raises:
        ValueError: A value that no pulse can have; one line says which and what would be right.

    >>> from thruster_envs.spacecraft import load
    >>> pulse = pulse_waveforms(load("ppt_cubesat").discharge, added_resistance=[0.0, 0.008])
    >>> pulse.current.shape, pulse.current.max(axis=-1).round()
    ((2, 3001), array([11094., 10246.]))
    """
    pulses = _Pulses.of(discharge, slug_mass, electrode_width, added_resistance, voltage)
    paths = _follow(discharge, pulses.kick, pulses.damping, np.arange(discharge.number_of_samples))
    x, q, u, i = paths.reshape((4, *pulses.kick.shape, -1))
    volts, length = pulses.voltage[..., np.newaxis], pulses.length[..., np.newaxis]
    x *= length
    u *= length / _unit_time(discharge)
    i *= volts * math.sqrt(discharge.capacitance / discharge.inductance)
    np.subtract(1.0, q, out=q)
    q *= volts
    time = np.arange(discharge.number_of_samples, dtype=np.float64) * discharge.sample_time
    return Waveforms(time=time, voltage=q, current=i, position=x, velocity=u)


def pulse_thrust(
    discharge: Discharge,
    *,
    slug_mass: ArrayLike | None = None,
    electrode_width: ArrayLike | None = None,
    added_resistance: ArrayLike = 0.0,
    voltage: ArrayLike | None = None,
) -> FloatArray:
    """Mean thrust of pulses at one a second, N: in numbers the impulse bit in N s.

    Args:
        discharge: The circuit.
        slug_mass: As for :func:`pulse_waveforms`; so are the other arguments.
        electrode_width: m.
        added_resistance: ohm.
        voltage: V.

    Returns:
        The broadcast shape of the arguments.

    Raises:
        ValueError: As :func:`pulse_waveforms`.

    >>> from thruster_envs.spacecraft import load
    >>> float(pulse_thrust(load("ppt_cubesat").discharge, slug_mass=3e-9).round(8))
    8.513e-05
    """
    pulses = _Pulses.of(discharge, slug_mass, electrode_width, added_resistance, voltage)
    end = _follow(discharge, pulses.kick, pulses.damping, np.array([discharge.number_of_samples - 1]))
    velocity = pulses.length / _unit_time(discharge) * end[2, :, 0].reshape(pulses.kick.shape)
    return np.asarray(pulses.slug_mass * velocity)


@dataclass(frozen=True)
class _Pulses:
    """What tells pulses apart, as arrays of one shape: kg, V, unit of length in m, kick, damping."""

    slug_mass: FloatArray
    voltage: FloatArray
    length: FloatArray
    kick: FloatArray
    damping: FloatArray

    @classmethod
    def of(
        cls,
        discharge: Discharge,
        slug_mass: ArrayLike | None,
        electrode_width: ArrayLike | None,
        added_resistance: ArrayLike,
        voltage: ArrayLike | None,
    ) -> _Pulses:
        """Check the values and broadcast them."""
        mass = _values("slug_mass", slug_mass, discharge.slug_mass, "kg")
        width = _values("electrode_width", electrode_width, discharge.electrode_width, "m")
        added = _values("added_resistance", added_resistance, 0.0, "ohm", least=0.0)
        volts = _values("voltage", voltage, discharge.voltage, "V")
        try:
            mass, width, added, volts = np.broadcast_arrays(mass, width, added, volts)
        except ValueError:
            shapes = ", ".join(str(one.shape) for one in (mass, width, added, volts))
            raise ValueError(
                "slug_mass, electrode_width, added_resistance and voltage have the shapes "
                f"{shapes}; shapes that broadcast would be right"
            ) from None
        gradient = MU_0 * discharge.electrode_gap / width  # of the inductance, H/m
        kick = (gradient * discharge.capacitance * volts) ** 2 / (2.0 * mass * discharge.inductance)
        damping = (discharge.resistance + added) * math.sqrt(discharge.capacitance / discharge.inductance)
        for name, values, most in (("kick", kick, MOST_KICK), ("damping", damping, MOST_DAMPING)):
            require(
                bool(np.all(values <= most)),
                f"{name} of a pulse",
                float(np.max(values, initial=0.0)),
                f"at most {most:g}, a heavier slug, more width or less resistance,",
            )
        return cls(mass, volts, discharge.inductance / gradient, kick, damping)


def _values(
    name: str, given: ArrayLike | None, nominal: float, unit: str, least: float | None = None
) -> FloatArray:
    values = np.asarray(nominal if given is None else given, dtype=np.float64)
    fine = np.isfinite(values) & (values > 0.0 if least is None else values >= least)
    if not np.all(fine):
        right = f"a positive number of {unit}" if least is None else f"a number of {unit} from {least:g} up"
        require(False, name, float(values[~fine][0]), right)
    return values


def _unit_time(discharge: Discharge) -> float:
    return math.sqrt(discharge.inductance * discharge.capacitance)


def _follow(
    discharge: Discharge, kick: FloatArray, damping: FloatArray, samples: NDArray[np.int64]
) -> FloatArray:
    """(4, pulses, samples): position, charge, velocity and current in units of the circuit."""
    paths = np.empty((4, kick.size, samples.size))
    step = discharge.sample_time / _unit_time(discharge)
    _follow_pulses(kick.ravel(), damping.ravel(), step, samples, paths)
    return paths


@kernel(nogil=True)
def _follow_pulses(kick, damping, step, samples, paths):
    """Integrate pulses from rest; keep the rising sample numbers ``samples`` in ``paths``."""
    state, forcing = np.zeros((4, _LANES)), np.ones((2, _LANES))
    for first in range(0, kick.shape[0], _LANES):
        count = min(_LANES, kick.shape[0] - first)
        for w in range(_LANES):
            for row in range(4):
                state[row, w] = 0.0
            forcing[0, w] = kick[first + min(w, count - 1)]
            forcing[1, w] = damping[first + min(w, count - 1)]
        done = 0
        for k in range(samples.shape[0]):
            for _ in range(samples[k] - done):
                for w in range(_LANES):
                    state[0, w], state[1, w], state[2, w], state[3, w] = _step(
                        state[0, w], state[1, w], state[2, w], state[3, w], forcing[0, w], forcing[1, w], step
                    )
            done = samples[k]
            for w in range(count):
                for row in range(4):
                    paths[row, first + w, k] = state[row, w]


@njit(forceinline=True)
def _acceleration(x, q, u, i, damping):
    """Rate of change of the current."""
    return (1.0 - q - (u + damping) * i) / (1.0 + x)


@njit(forceinline=True)
def _step(x, q, u, i, kick, damping, h):
    """One step of the fifth-order method of Dormand and Prince 1980, at a fixed length.

    The rates of position and charge are velocity and current, so that only those of velocity (``a``) and
    current (``b``) need names of their own.
    """
    u1, i1 = u, i
    a1, b1 = kick * i1 * i1, _acceleration(x, q, u1, i1, damping)
    k = h * (1 / 5)
    u2, i2 = u + k * a1, i + k * b1
    a2, b2 = kick * i2 * i2, _acceleration(x + k * u1, q + k * i1, u2, i2, damping)
    c1, c2 = h * (3 / 40), h * (9 / 40)
    u3, i3 = u + c1 * a1 + c2 * a2, i + c1 * b1 + c2 * b2
    a3, b3 = kick * i3 * i3, _acceleration(x + c1 * u1 + c2 * u2, q + c1 * i1 + c2 * i2, u3, i3, damping)
    c1, c2, c3 = h * (44 / 45), h * (-56 / 15), h * (32 / 9)
    u4, i4 = u + c1 * a1 + c2 * a2 + c3 * a3, i + c1 * b1 + c2 * b2 + c3 * b3
    a4 = kick * i4 * i4
    b4 = _acceleration(x + c1 * u1 + c2 * u2 + c3 * u3, q + c1 * i1 + c2 * i2 + c3 * i3, u4, i4, damping)
    c1, c2, c3, c4 = h * (19372 / 6561), h * (-25360 / 2187), h * (64448 / 6561), h * (-212 / 729)
    u5 = u + c1 * a1 + c2 * a2 + c3 * a3 + c4 * a4
    i5 = i + c1 * b1 + c2 * b2 + c3 * b3 + c4 * b4
    a5 = kick * i5 * i5
    b5 = _acceleration(
        x + c1 * u1 + c2 * u2 + c3 * u3 + c4 * u4, q + c1 * i1 + c2 * i2 + c3 * i3 + c4 * i4, u5, i5, damping
    )
    c1, c2, c3 = h * (9017 / 3168), h * (-355 / 33), h * (46732 / 5247)
    c4, c5 = h * (49 / 176), h * (-5103 / 18656)
    u6 = u + c1 * a1 + c2 * a2 + c3 * a3 + c4 * a4 + c5 * a5
    i6 = i + c1 * b1 + c2 * b2 + c3 * b3 + c4 * b4 + c5 * b5
    a6 = kick * i6 * i6
    b6 = _acceleration(
        x + c1 * u1 + c2 * u2 + c3 * u3 + c4 * u4 + c5 * u5,
        q + c1 * i1 + c2 * i2 + c3 * i3 + c4 * i4 + c5 * i5,
        u6, i6, damping,
    )  # fmt: skip
    d1, d3, d4, d5, d6 = h * (35 / 384), h * (500 / 1113), h * (125 / 192), h * (-2187 / 6784), h * (11 / 84)
    return (
        x + d1 * u1 + d3 * u3 + d4 * u4 + d5 * u5 + d6 * u6,
        q + d1 * i1 + d3 * i3 + d4 * i4 + d5 * i5 + d6 * i6,
        u + d1 * a1 + d3 * a3 + d4 * a4 + d5 * a5 + d6 * a6,
        i + d1 * b1 + d3 * b3 + d4 * b4 + d5 * b5 + d6 * b6,
    )


@dataclass(frozen=True)
class PulseMap:
    """The thrust of all pulses of a discharge, as a table over kick and damping.

    Attributes:
        logarithms: (kicks, dampings), natural logarithm of the squared current's integral over that of the
            nominal pulse.
        resistance: Of the nominal circuit, ohm.
    """

    logarithms: FloatArray
    resistance: float

    @staticmethod
    @cache
    def of(discharge: Discharge) -> PulseMap:
        """The map of a discharge; built once for each."""
        ends = tabulate_pulses(discharge, np.array([discharge.number_of_samples - 1]))
        integrals = ends[2, :, :, 0] / _nodes(discharge)[0][:, np.newaxis]
        logarithms = np.log(integrals / integrals[_KICKS_BELOW, _DAMPINGS_BELOW])
        logarithms.setflags(write=False)
        return PulseMap(logarithms, discharge.resistance)

    def ratio(
        self,
        *,
        mass_share: ArrayLike = 1.0,
        width_share: ArrayLike = 1.0,
        added_resistance: ArrayLike = 0.0,
        voltage_share: ArrayLike = 1.0,
    ) -> FloatArray:
        """:func:`pulse_ratio` of broadcast arrays."""
        mass, width, added, voltage = np.broadcast_arrays(
            np.asarray(mass_share, dtype=np.float64), np.asarray(width_share, dtype=np.float64),
            np.asarray(added_resistance, dtype=np.float64), np.asarray(voltage_share, dtype=np.float64),
        )  # fmt: skip
        ratios = np.empty(mass.size)
        _ratios(
            mass.ravel(), width.ravel(), added.ravel(), voltage.ravel(), self.logarithms, self.resistance,
            ratios,
        )  # fmt: skip
        return ratios.reshape(mass.shape)


def tabulate_pulses(discharge: Discharge, samples: NDArray[np.int64]) -> FloatArray:
    """(4, kicks, dampings, samples): pulses at the nodes of a map, in units of the circuit.

    Position, charge over that of the full capacitor, velocity and current, at the numbers ``samples``.
    """
    kicks, dampings = _nodes(discharge)
    grid = np.meshgrid(kicks, dampings, indexing="ij")
    return _follow(discharge, grid[0], grid[1], samples).reshape(4, kicks.size, dampings.size, samples.size)


def _nodes(discharge: Discharge) -> tuple[FloatArray, FloatArray]:
    """Kicks and dampings of a map."""
    nominal = _Pulses.of(discharge, None, None, 0.0, None)
    kicks = nominal.kick * np.exp(_KICK_STEP * np.arange(-_KICKS_BELOW, _KICKS_ABOVE + 1))
    dampings = nominal.damping * np.exp(_DAMPING_STEP * np.arange(-_DAMPINGS_BELOW, _DAMPINGS_ABOVE + 1))
    stiffest = _LAST_DAMPING_STEPS * _unit_time(discharge) / discharge.sample_time
    return np.minimum(kicks, _LAST_KICK), np.minimum(dampings, stiffest)


@kernel(nogil=True)
def _ratios(mass, width, added, voltage, logarithms, resistance, ratios):
    for k in range(ratios.shape[0]):
        ratios[k] = pulse_ratio(mass[k], width[k], added[k], voltage[k], logarithms, resistance)


@njit(forceinline=True)
def pulse_ratio(mass_share, width_share, added_resistance, voltage_share, logarithms, resistance):
    """Thrust of a pulse over that of the nominal one.

    Slug mass, electrode width and voltage are shares of the nominal ones, the added resistance is in ohm;
    ``logarithms`` and ``resistance`` are those of the :class:`PulseMap`. It is one, exactly, for the nominal
    pulse. Beyond its table the integral of the squared current stays as it is at the edge.
    """
    row, column, a, b = map_place(mass_share, width_share, added_resistance, voltage_share, resistance)
    logarithm = 0.0
    for j in range(4):
        for k in range(4):
            logarithm += a[j] * b[k] * logarithms[row + j, column + k]
    return voltage_share * voltage_share / width_share * math.exp(logarithm)


@njit(forceinline=True)
def map_place(mass_share, width_share, added_resistance, voltage_share, resistance):
    """Where a pulse stands in a map: first row and column of its 4 x 4 nodes, and their weights."""
    kick = 2.0 * math.log(voltage_share / width_share) - math.log(mass_share)
    damping = math.log(1.0 + added_resistance / resistance)
    row, a = _weights(kick / _KICK_STEP + _KICKS_BELOW, _KICKS_BELOW + _KICKS_ABOVE)
    column, b = _weights(damping / _DAMPING_STEP + _DAMPINGS_BELOW, _DAMPINGS_BELOW + _DAMPINGS_ABOVE)
    return row, column, a, b


@njit(forceinline=True)
def _weights(at, last):
    """First of the four nodes about ``at``, on a grid from 0 to ``last``, and Lagrange's weights of them."""
    at = min(max(at, 0.0), float(last))
    first = int(min(max(math.floor(at) - 1.0, 0.0), last - 3.0))
    t = at - first
    return first, (
        (t - 1.0) * (t - 2.0) * (t - 3.0) / -6.0,
        t * (t - 2.0) * (t - 3.0) / 2.0,
        t * (t - 1.0) * (t - 3.0) / -2.0,
        t * (t - 1.0) * (t - 2.0) / 6.0,
    )
