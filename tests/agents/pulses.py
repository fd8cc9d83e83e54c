"""Pulses as the sensors of a flight have them, for the tests of the fault networks."""

from thruster_envs.physics.plasma_pulse import pulse_waveforms
from thruster_envs.spacecraft import load

#: Standard deviations of voltage, V, and current, A (0.5 % of full scale).
NOISE = 4.0, 60.0


def pulses(charges, generator, **changes):
    """Measured voltages and currents (pulses, 3001) at these charge voltages, V."""
    followed = pulse_waveforms(load("ppt_cubesat").discharge, voltage=charges, **changes)
    return tuple(
        clean + generator.normal(0.0, sigma, clean.shape)
        for clean, sigma in zip((followed.voltage, followed.current), NOISE, strict=True)
    )
