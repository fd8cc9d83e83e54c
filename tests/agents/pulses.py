"""Pulses for the tests of the fault networks, by SciPy: the corrected circuit of Valdes 2008, eq. 3.31."""

import numpy as np
from scipy.integrate import solve_ivp

CAPACITANCE, INDUCTANCE, RESISTANCE, GAP = 17.0e-6, 35.0e-9, 0.043, 0.0254
TIMES = np.arange(3001) * 1.0e-8


def pulse(charge=910.0, slug_mass=2.58e-8, width=0.0254, added_resistance=0.0):
    """Capacitor voltage (3001,) and discharge current (3001,), without noise."""
    gradient = 4.0e-7 * np.pi * GAP / width

    def rates(_, state):
        position, delivered, speed, current = state
        resistance = RESISTANCE + added_resistance + gradient * speed
        push = (charge - delivered / CAPACITANCE - resistance * current) / (INDUCTANCE + gradient * position)
        return speed, current, 0.5 * gradient / slug_mass * current**2, push

    flown = solve_ivp(rates, (0.0, TIMES[-1]), np.zeros(4), t_eval=TIMES, rtol=1e-7, atol=1e-12)
    return charge - flown.y[1] / CAPACITANCE, flown.y[3]


def pulses(charges, generator=None, **changes):
    """Voltages and currents (pulses, 3001); with the noise of the sensors (4 V, 60 A) where they have one."""
    voltage, current = (
        np.array(signal) for signal in zip(*(pulse(c, **changes) for c in charges), strict=True)
    )
    if generator is not None:
        voltage += generator.normal(0.0, 4.0, voltage.shape)
        current += generator.normal(0.0, 60.0, current.shape)
    return voltage, current
