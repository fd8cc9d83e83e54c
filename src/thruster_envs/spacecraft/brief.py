"""What `repr` says of a spacecraft: a few lines that tell it from others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thruster_envs.spacecraft.description import Spacecraft


def brief(spacecraft: Spacecraft) -> str:
    """Mass properties, period, actuators and sensors of a spacecraft, in three lines."""
    inertia, sensors, thrusters = spacecraft.inertia, spacecraft.sensors, spacecraft.thrusters
    products = any(inertia[row][column] for row in range(3) for column in range(row))
    diagonal = ", ".join(f"{inertia[k][k]:.4g}" for k in range(3))
    devices = [f"{len(thrusters)} thrusters of {span(one.thrust for one in thrusters)} N"]
    if spacecraft.reaction_wheels:
        devices.append(f"{len(spacecraft.reaction_wheels)} reaction wheels")
    if spacecraft.control_moment_gyros:
        devices.append(f"{len(spacecraft.control_moment_gyros)} control-moment gyros")
    names = ("modulator", "isolation_valves", "spare_branch", "discharge", "orbit")
    devices += [name.replace("_", " ") for name in names if getattr(spacecraft, name)]
    return (
        f"Spacecraft(name={spacecraft.name!r}, mass={spacecraft.mass!r} kg, inertia=({diagonal}) kg m^2"
        f"{' and products' if products else ''}, control_period={spacecraft.control_period!r} s,\n"
        f"    {', '.join(devices)},\n"
        f"    sensors: {sensors.position:.3g} m, {sensors.velocity:.3g} m/s, {sensors.attitude:.3g} rad, "
        f"{sensors.rate:.3g} rad/s)"
    )


def span(values: Iterable[float]) -> str:
    """Numbers as one, or as the smallest to the largest.

    >>> span([0.1, 0.1]), span([0.1, 0.3])
    ('0.1', '0.1 to 0.3')
    """
    ordered = sorted(values)
    least, most = f"{ordered[0]:.4g}", f"{ordered[-1]:.4g}"
    return least if least == most else f"{least} to {most}"
