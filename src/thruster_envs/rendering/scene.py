"""What a picture is made of: plain values that a view collects from its batch and hands to the renderer.

Models: one moment of an episode, of one craft or of a formation whose craft share one description.
Leaves out: everything that moves; a scene knows no history but the path that it is given.
Thrusters are numbered from 1 in the picture and from 0 in the arrays here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from thruster_envs.spacecraft import Spacecraft

__all__ = ["CraftScene", "Curve", "Scene"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def _origin() -> FloatArray:
    return np.zeros(3)


def _no_path() -> FloatArray:
    return np.zeros((0, 3))


def _no_valves() -> BoolArray:
    return np.zeros(0, np.bool_)


def _no_corridor() -> FloatArray:
    return np.zeros((0, 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class CraftScene:
    """One craft at one moment; array-likes are accepted and kept as arrays of their own.

    Raises ``ValueError`` for a wrong shape, a value that is not finite, or a quaternion of length zero.
    """

    attitude: FloatArray
    """(4,) unit quaternion, scalar first, body from LVLH: ``v_body = q v_lvlh q*``."""
    duties: FloatArray
    """(n,) commanded share of the control period, 0..1; drawn as an outline."""
    thrust: FloatArray
    """(n,) delivered share of the nominal thrust, its mean over the period, 0..1; drawn as a plume."""
    faulty: BoolArray
    """(n,) whether the thruster is marked as failed."""
    shut: BoolArray = field(default_factory=_no_valves)
    """(n,) whether its isolation valve is closed; left out, none is."""
    position: FloatArray = field(default_factory=_origin)
    """(3,) m, LVLH: x radial, y along-track, z cross-track."""
    path: FloatArray = field(default_factory=_no_path)
    """(k, 3) m, LVLH, oldest first; k may be 0."""
    target: FloatArray = field(default_factory=_origin)
    """(3,) m, LVLH: where the craft should be."""
    name: str = ""
    """What the legend calls the craft."""

    def __post_init__(self) -> None:
        """Keep the arrays as float64 and bool, or say in one line which of them does not fit."""
        thrusters = np.size(self.duties)
        shapes: dict[str, tuple[int, ...]] = {
            "attitude": (4,),
            "duties": (thrusters,),
            "thrust": (thrusters,),
            "position": (3,),
            "target": (3,),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, _finite(name, getattr(self, name), shape))
        path = np.asarray(self.path, dtype=np.float64)
        object.__setattr__(self, "path", _finite("path", path, (len(path) if path.ndim else 0, 3)))
        shut = self.shut if np.size(self.shut) else np.zeros(thrusters)
        for name, value in (("faulty", self.faulty), ("shut", shut)):
            marks = np.array(value, dtype=np.bool_)
            if marks.shape != (thrusters,):
                raise ValueError(
                    f"CraftScene.{name} has shape {marks.shape}, it must be {(thrusters,)} like duties"
                )
            object.__setattr__(self, name, marks)
        if not np.any(self.attitude):
            raise ValueError(
                "CraftScene.attitude is [0, 0, 0, 0], it must be a quaternion, (1, 0, 0, 0) for none"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Something measured over time, beside what was expected.

    Raises ``ValueError`` for a wrong shape or a value that is not finite.
    """

    label: str
    """What it is, and its unit."""
    time_label: str
    """What the time is, and its unit."""
    time: FloatArray
    """(k,) rising, at least two."""
    expected: FloatArray
    """(k,) drawn as a line."""
    measured: FloatArray
    """(k,) drawn as dots."""

    def __post_init__(self) -> None:
        """Keep the arrays as float64, or say in one line which of them does not fit."""
        for name in ("time", "expected", "measured"):
            shape = (max(2, np.size(self.time)),)
            object.__setattr__(self, name, _finite(name, getattr(self, name), shape, "Curve"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """One moment of an episode, ready to be drawn.

    Raises ``ValueError`` if there is no craft, if a craft's arrays do not have one entry per thruster of the
    spacecraft, or if a bar or the corridor is not finite.
    """

    spacecraft: Spacecraft
    """The description that every craft of the scene shares."""
    craft: tuple[CraftScene, ...]
    """At least one; the first is the one that is drawn large."""
    time: float
    """Time since the start of the episode, s."""
    title: str
    """What the header says."""
    readouts: tuple[tuple[str, str], ...] = ()
    """(label, value) pairs for the header, the most important first: what does not fit is left out."""
    bars: tuple[tuple[str, float, float], ...] = ()
    """(label, commanded, delivered) in shares of the vehicle's authority, -1..1; if given, they stand in
    place of the path."""
    curves: tuple[Curve, ...] = ()
    """If given, and no bars, they stand in place of the path."""
    curves_name: str = ""
    """What the curves are of."""
    corridor: FloatArray = field(default_factory=_no_corridor)
    """(k, 2) m: along-track position and half-width of the corridor that the path should stay in."""

    def __post_init__(self) -> None:
        """Check that the craft belong to the spacecraft."""
        if not self.craft:
            raise ValueError("Scene.craft is empty, it must hold at least one CraftScene")
        thrusters = len(self.spacecraft.thrusters)
        for number, craft in enumerate(self.craft, start=1):
            if craft.duties.shape != (thrusters,):
                raise ValueError(
                    f"Scene.craft number {number} has {craft.duties.size} duties, "
                    f"it must have {thrusters}: one per thruster of {self.spacecraft.name!r}"
                )
        corridor = np.asarray(self.corridor, dtype=np.float64)
        shape = (len(corridor) if corridor.ndim else 0, 2)
        object.__setattr__(self, "corridor", _finite("corridor", corridor, shape, "Scene"))
        if not np.isfinite(self.time):
            raise ValueError(f"Scene.time is {self.time}, it must be a finite number of seconds")
        for label, commanded, delivered in self.bars:
            if not (np.isfinite(commanded) and np.isfinite(delivered)):
                raise ValueError(
                    f"Scene.bars has ({commanded}, {delivered}) for {label!r}, both must be finite"
                )


def _finite(name: str, value: Any, shape: tuple[int, ...], owner: str = "CraftScene") -> FloatArray:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{owner}.{name} has shape {array.shape}, it must be {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{owner}.{name} is {array.tolist()}, every entry must be finite")
    return array
