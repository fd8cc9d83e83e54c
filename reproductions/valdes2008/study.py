"""What the source's experiments share: its faults, ramps and manoeuvres, and pulses as they are measured.

The source gives the circuit's constants nowhere, and no sensor errors. Those of the catalogue's `ppt_cubesat`
follow from ten of its figures; samples here have errors of 4 V and 60 A, which its tables' extremes suggest.
A pulse is faulty if its thrust, without errors, is off nominal by more than 15 % (eq. 4.1).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from thruster_baselines.detection.pulses import BAND
from thruster_envs.faults import Fault
from thruster_envs.physics.plasma_pulse import pulse_thrust, pulse_waveforms
from thruster_envs.protocols import BoolArray, FloatArray
from thruster_envs.spacecraft import Discharge, load

CUBESAT = load("ppt_cubesat")
assert CUBESAT.discharge is not None
CIRCUIT: Discharge = CUBESAT.discharge
NOMINAL_THRUST = float(pulse_thrust(CIRCUIT))
VOLTAGE_ERROR, CURRENT_ERROR = 4.0, 60.0  # V and A, of a sample
SEEDS = 10  # training runs of whatever learns

FAULT_CASES = {1: "propellant_loss", 2: "electrode_sediment", 3: "conductivity_loss"}
"""What the source calls fault case 1, 2 and 3."""

STEP_SEVERITY = {
    "propellant_loss": 1.0 - 3.00e-9 / CIRCUIT.slug_mass,
    "electrode_sediment": 1.0 - 0.02195 / CIRCUIT.electrode_width,
    "conductivity_loss": 0.008,
}
"""Of the faults of 15 % (m0 = 3.00e-9 kg, w = 0.02195 m, R_pe = 0.008 ohm)."""

_STEPS = {
    "propellant_loss": ("slug_mass", CIRCUIT.slug_mass, -0.04e-8, 64),
    "electrode_sediment": ("electrode_width", CIRCUIT.electrode_width, -0.0004, 41),
    "conductivity_loss": ("added_resistance", 0.0, 0.00015, 64),
}

RAMPS: dict[str, dict[str, FloatArray]] = {
    kind: {name: begin + step * np.arange(1, count + 1)}
    for kind, (name, begin, step, count) in _STEPS.items()
}
"""Arguments of `pulse_waveforms` for the pulses of eq. 4.4, 4.5, and 4.6 with a plus (printed: a minus)."""


def measured(
    rng: np.random.Generator, circuit: Discharge = CIRCUIT, **parameters: Any
) -> tuple[FloatArray, FloatArray]:
    """Voltage and current (pulses, samples) with errors; arguments as of `pulse_waveforms`."""
    waves = pulse_waveforms(circuit, **parameters)
    return (
        waves.voltage + VOLTAGE_ERROR * rng.standard_normal(waves.voltage.shape),
        waves.current + CURRENT_ERROR * rng.standard_normal(waves.current.shape),
    )


def thrust_of(**parameters: Any) -> FloatArray:
    """(pulses,): thrust over that of the nominal pulse; arguments as of `pulse_waveforms`."""
    return pulse_thrust(CIRCUIT, **parameters) / NOMINAL_THRUST


def out_of_band(thrust: FloatArray) -> BoolArray:
    """Whether thrust over nominal thrust is that of a faulty pulse."""
    return np.asarray(np.abs(thrust - 1.0) > BAND)


def step_fault(thruster: int, case: int, craft: int = 2, onset: float = 0.0) -> Fault:
    """A fault of 15 % of thrust of a thruster of a craft, both from 1; craft 2 is the first follower."""
    kind = FAULT_CASES[case]
    return Fault(thruster, kind, severity=STEP_SEVERITY[kind], craft=craft, onset=onset)
