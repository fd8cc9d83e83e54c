"""Relative translation about an orbit: frame motion, free acceleration, and the transition matrix.

Frame: LVLH, x radial (outward), y along-track, z cross-track, origin at the point that moves on the orbit;
positions in m, accelerations in m/s^2. An orbit is one of five kinds, a NamedTuple each, and what is asked
of it is chosen by its kind when a kernel is compiled:

- :class:`Hill`: circular, linear (Clohessy and Wiltshire 1960);
- :class:`Circular`: circular, two bodies;
- :class:`LinearElliptic`: elliptic, linear and time-varying (Tschauner and Hempel 1965, over time);
- :class:`Elliptic`: elliptic, two bodies;
- :class:`Oblate`: origin and craft both under the planet's J2, without linearisation (Xu and Wang 2008).

The *reference* of a craft says where the origin stands: nothing on a circular orbit, the time since perigee
in s on an elliptic one, six numbers of its motion about an oblate planet (:class:`Oblate`).

Leaves out other harmonics, drag, solar pressure, third bodies, and hyperbolas.

Sources: Alfriend et al. 2010, "Spacecraft Formation Flying", eqs. 4.14-4.16; Yamanaka and Ankersen 2002, "New
state transition matrix for relative motion on an arbitrary elliptical orbit"; Xu and Wang 2008, "Nonlinear
dynamic equations of satellite relative motion around an oblate Earth"; Danby 1987, "The solution of Kepler's
equation III".
"""

from thruster_envs.physics.orbits.elements import (
    Elements,
    anomaly_at_start,
    open_elements,
    since_perigee,
    true_anomaly_at,
)
from thruster_envs.physics.orbits.kinds import (
    REFERENCE_SIZES,
    Circular,
    Ellipse,
    Elliptic,
    Hill,
    LinearElliptic,
    Motion,
    Oblate,
    OblateMotion,
    ellipse_of,
    kind_of,
    open_orbit,
    orbit_radius,
    pack_orbit,
)
from thruster_envs.physics.orbits.motion import (
    cos_sin,
    eccentric_anomaly,
    elliptic_acceleration,
    frame_motion,
    hill_acceleration,
    linear_acceleration,
    mean_anomaly,
    nearness,
    oblate_acceleration,
    oblate_attitude,
    oblate_motion,
    oblate_rates,
    oblate_step,
    turn_frame,
    two_body_acceleration,
)
from thruster_envs.physics.orbits.operations import (
    chosen_by_kind,
    follow_frame,
    frame_rate,
    free_acceleration,
    free_velocity,
    open_ellipse,
    osculating,
    read_reference,
    reference_after,
    reference_at,
    reference_of,
    step_frames,
    translation_step,
    write_reference,
)
from thruster_envs.physics.orbits.transition import (
    angle_minus_sine,
    free_motion,
    transition_matrix,
)

__all__ = [
    "REFERENCE_SIZES",
    "Circular",
    "Elements",
    "Ellipse",
    "Elliptic",
    "Hill",
    "LinearElliptic",
    "Motion",
    "Oblate",
    "OblateMotion",
    "angle_minus_sine",
    "anomaly_at_start",
    "chosen_by_kind",
    "cos_sin",
    "eccentric_anomaly",
    "ellipse_of",
    "elliptic_acceleration",
    "follow_frame",
    "frame_motion",
    "frame_rate",
    "free_acceleration",
    "free_motion",
    "free_velocity",
    "hill_acceleration",
    "kind_of",
    "linear_acceleration",
    "mean_anomaly",
    "nearness",
    "oblate_acceleration",
    "oblate_attitude",
    "oblate_motion",
    "oblate_rates",
    "oblate_step",
    "open_elements",
    "open_ellipse",
    "open_orbit",
    "orbit_radius",
    "osculating",
    "pack_orbit",
    "read_reference",
    "reference_after",
    "reference_at",
    "reference_of",
    "since_perigee",
    "step_frames",
    "transition_matrix",
    "translation_step",
    "true_anomaly_at",
    "turn_frame",
    "two_body_acceleration",
    "write_reference",
]
