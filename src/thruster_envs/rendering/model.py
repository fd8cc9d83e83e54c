"""The solid that stands for a spacecraft: a box sized from the thruster positions, nozzles, struts.

Models: the places and directions of the thrusters, true to the description; everything else is decoration
(the descriptions hold no outline of the vehicle), so the box is a share of what the thrusters span, and along
an axis on which they do not spread as long as the inertia suggests beside the other sides.
Leaves out: misalignment of a faulty thruster; a nozzle always points where the description says.

All coordinates are in the body frame, from the centre of mass, in m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from thruster_envs.spacecraft import Spacecraft

FloatArray = npt.NDArray[np.float64]

NOZZLE_SIDES = 10

# Sizes as shares of the largest distance of a thruster from the centre of mass.
BOX_SHARE = 0.84  # of the span of the thruster positions, axis by axis
BOX_SHARE_BETWEEN_PLUMES = 0.62  # the same where a plume blows past the body
SMALLEST_BOX = 0.16
CLUSTER_SIZE = 0.045
THROAT_RADIUS = 0.028
EXIT_RADIUS = 0.066
NOZZLE_LENGTH = 0.17
PLUME_LENGTH = 0.75
PLUME_SPREAD = 2.3  # radius of the full plume at its end over that at the nozzle's exit


@dataclass(frozen=True, kw_only=True)
class Solids:
    """Convex solids with flat faces, all of them with equally many faces of equally many corners."""

    corners: FloatArray
    """(solids, faces, corners, 3) m."""
    normals: FloatArray
    """(solids, faces, 3) outward unit vectors."""


@dataclass(frozen=True, kw_only=True)
class SpacecraftModel:
    """What of a spacecraft's picture does not change from frame to frame."""

    size: float
    """Largest distance of a thruster from the centre of mass, m: the unit of the decoration."""
    box: Solids
    """The body, one solid; its faces in the order +x, -x, +y, -y, +z, -z."""
    positions: FloatArray
    """(n, 3) m, where the nozzles are drawn; a thruster inside the box is moved out along its plume."""
    plume_directions: FloatArray
    """(n, 3) unit vectors, opposite to the force on the craft."""
    nozzles: Solids
    """One frustum per thruster; its last face is the exit."""
    clusters: Solids
    """A small cube at every place that carries thrusters."""
    struts: FloatArray
    """(clusters, 2, 3) m, from the body box to the cluster."""
    exits: FloatArray
    """(n, 3) m, middle of each nozzle's exit, where its plume begins."""
    exit_radius: float
    """m, of every nozzle."""
    plume_length: float
    """m, length of the plume at full thrust."""
    reach: float
    """m, radius of the sphere that holds everything, full plumes included, whatever the attitude."""
    gravitational_parameter: float
    """m^3/s^2, of the planet below."""


def build_model(spacecraft: Spacecraft) -> SpacecraftModel:
    """Lay out the solids for ``spacecraft``.

    >>> from thruster_envs.spacecraft import load
    >>> build_model(load("orion")).positions.shape
    (12, 3)
    """
    mounted = np.array([thruster.position for thruster in spacecraft.thrusters], dtype=np.float64).reshape(
        -1, 3
    )
    forces = np.array([thruster.direction for thruster in spacecraft.thrusters], dtype=np.float64).reshape(
        -1, 3
    )
    plume_directions = -forces / np.linalg.norm(forces, axis=1, keepdims=True)
    size = float(np.linalg.norm(mounted, axis=1).max(initial=0.0)) or 1.0
    outwards = ((mounted * plume_directions).sum(axis=1) >= 0.0).all()
    share = BOX_SHARE if outwards else BOX_SHARE_BETWEEN_PLUMES
    half_extents = _body(share * np.abs(mounted).max(axis=0, initial=0.0), spacecraft, SMALLEST_BOX * size)
    pairs = list(zip(mounted, plume_directions, strict=True))
    positions = np.array([_outside(*pair, half_extents) for pair in pairs]).reshape(-1, 3)
    places = _gathered(positions, 1.5 * CLUSTER_SIZE * size)
    exits = positions + NOZZLE_LENGTH * size * plume_directions
    plume_length = PLUME_LENGTH * size
    extremes = np.vstack([positions, exits + plume_length * plume_directions, half_extents])
    return SpacecraftModel(
        size=size,
        box=_boxes(np.zeros((1, 3)), half_extents),
        positions=positions,
        plume_directions=plume_directions,
        nozzles=_nozzles(positions, plume_directions, size),
        clusters=_boxes(places, np.full(3, CLUSTER_SIZE * size)),
        struts=np.stack([places.clip(-half_extents, half_extents), places], axis=1),
        exits=exits,
        exit_radius=EXIT_RADIUS * size,
        plume_length=plume_length,
        reach=float(np.linalg.norm(extremes, axis=1).max()) + 0.5 * EXIT_RADIUS * size,
        gravitational_parameter=spacecraft.gravitational_parameter,
    )


def rotation_from_quaternion(quaternion: FloatArray) -> FloatArray:
    """(3, 3) matrix C with ``v_body = C v_lvlh`` of a quaternion (w, x, y, z), body from LVLH.

    The Hamilton product ``q v q*`` written out; the quaternion is normalised first.

    >>> rotation_from_quaternion(np.array([1.0, 0.0, 0.0, 0.0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, x, y, z = (quaternion / np.linalg.norm(quaternion)).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def circle_across(direction: FloatArray, points: int) -> FloatArray:
    """(points, 3) evenly on the unit circle perpendicular to ``direction``."""
    axis = direction / np.linalg.norm(direction)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    angles = 2.0 * np.pi * np.arange(points) / points
    circle: FloatArray = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(axis, first))
    return circle


def _body(spread: FloatArray, spacecraft: Spacecraft, smallest: float) -> FloatArray:
    """(3,) m, half the sides of the box: those that thrusters span, and the others in proportion.

    Proportions are those of a uniform box with the inertia of the spacecraft, whose half sides a, b, c follow
    from I_xx = m (b^2 + c^2) / 3 and its like.
    """
    moments = np.diag(np.array(spacecraft.inertia))
    uniform = np.sqrt(np.maximum(1.5 * (moments.sum() - 2.0 * moments) / spacecraft.mass, 0.0))
    spanned = (spread >= smallest) & (uniform > 0.0)
    scale = float(np.mean(spread[spanned] / uniform[spanned])) if spanned.any() else 0.0
    return np.maximum(np.where(spread >= smallest, spread, scale * uniform), smallest)


def _outside(position: FloatArray, direction: FloatArray, half_extents: FloatArray) -> FloatArray:
    """Move a position inside the box along ``direction`` to where it leaves the box."""
    if (np.abs(position) >= half_extents).any():
        return position
    along = np.abs(direction) > 1e-9
    distances = (half_extents[along] - position[along] * np.sign(direction[along])) / np.abs(direction[along])
    moved: FloatArray = position + distances.min() * direction
    return moved


def _gathered(positions: FloatArray, distance: float) -> FloatArray:
    """(k, 3) the middles of groups of positions that lie within ``distance`` of the first of their group."""
    groups: list[list[FloatArray]] = []
    for position in positions:
        near = (group for group in groups if np.linalg.norm(group[0] - position) <= distance)
        group = next(near, None)
        if group is None:
            groups.append([position])
        else:
            group.append(position)
    return np.array([np.mean(group, axis=0) for group in groups]).reshape(-1, 3)


def _boxes(centres: FloatArray, half_extents: FloatArray) -> Solids:
    """Boxes of one size about ``centres`` (solids, 3)."""
    corners, normals = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            across, along = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            signs = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
            corners.append(
                [half_extents * (normal + first * across + second * along) for first, second in signs]
            )
            normals.append(normal)
    return Solids(
        corners=centres[:, None, None] + np.array(corners),
        normals=np.repeat(np.array(normals)[None], len(centres), axis=0),
    )


def _nozzles(positions: FloatArray, directions: FloatArray, size: float) -> Solids:
    """Frustums that open along ``directions``; of each its sides first, then its exit."""
    following = np.roll(np.arange(NOZZLE_SIDES), -1)
    slope = (EXIT_RADIUS - THROAT_RADIUS) / NOZZLE_LENGTH
    corners, normals = [], []
    for position, direction in zip(positions, directions, strict=True):
        circle = circle_across(direction, NOZZLE_SIDES)
        throat = position + THROAT_RADIUS * size * circle
        rim = position + NOZZLE_LENGTH * size * direction + EXIT_RADIUS * size * circle
        sides = np.stack([throat, throat[following], rim[following], rim], axis=1)
        # The exit has more corners than the sides; these repeat their last one, so that all fit one array.
        sides = np.concatenate([sides, np.repeat(sides[:, -1:], NOZZLE_SIDES - 4, axis=1)], axis=1)
        outward = circle + circle[following]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        corners.append(np.concatenate([sides, rim[None]]))
        normals.append(np.vstack([(outward - slope * direction) / np.hypot(1.0, slope), direction]))
    return Solids(corners=np.array(corners), normals=np.array(normals))
