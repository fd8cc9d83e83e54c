"""From a world of a batch to a picture: the path so far, and the scene that the renderer draws.

What is common to all tasks is drawn here; what a task adds is its :meth:`~thruster_envs.tasks.Task.picture`.
A craft whose position is not finite is drawn where it was last, other numbers that are not finite as zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from thruster_envs.faults.encoding import FIELD_KIND, FIELD_THRUSTER, WHEEL_TORQUE_LOSS
from thruster_envs.physics import rows as at
from thruster_envs.rendering import CraftScene, Curve, Renderer, Scene
from thruster_envs.tasks.pictures import FARTHEST, Frame, drawable
from thruster_envs.views.worlds import Worlds

#: Modes that every environment can be rendered in.
RENDER_MODES = ("rgb_array", "human")
#: An attitude that is shorter than that is none.
_SHORTEST, _LEVEL = 1e-9, np.array([1.0, 0.0, 0.0, 0.0])


class Camera:
    """Watches one world: keeps its path and draws it.

    A copy, by ``copy`` or ``pickle``, has the path and draws with a renderer of its own.

    Args:
        worlds: The batch.
        world: Which one.
        title: Put above the picture.
    """

    def __init__(self, worlds: Worlds, world: int, title: str) -> None:
        self.worlds, self.world, self.title = worlds, world, title
        self._path: list[NDArray[np.float64]] = []
        self._samples: list[NDArray[np.float64]] = []
        self._renderer: Renderer | None = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderer": None}

    def watch(self, *, begins: bool, mode: str | None) -> None:
        """Keep up with the world after a reset or a step, in the render mode of its environment."""
        if mode is None:
            return
        if begins:
            self.begin()
        else:
            self.follow()
        if mode == "human":
            self.show()

    def begin(self) -> None:
        """A new episode: forget the path."""
        self._path.clear()
        self._samples.clear()
        self.follow()

    def follow(self) -> None:
        """Add where the craft are now to the path, and what the task wants to be kept of this moment."""
        self._path.append(self._places())
        task, time = self.worlds.task, float(self._time())
        with np.errstate(all="ignore"):  # of a state that is beyond all numbers
            self._samples.append(drawable(task.sample(self.worlds.state, self.world, time)))

    def _time(self) -> np.float64:
        """Since the start of the episode, s."""
        return np.float64(self.worlds.steps[self.world] * self.worlds.task.vehicle.control_period)

    def _places(self) -> NDArray[np.float64]:
        """(craft, 3) m, where the craft are, or were last."""
        last = self._path[-1] if self._path else 0.0
        return drawable(self.worlds.fleet.read(at.POSITION, 3)[self.world], last)

    def frame(self) -> NDArray[np.uint8]:
        """(height, width, 3) picture of the world now."""
        return self._draws().frame(self.scene())

    def show(self) -> None:
        """Show the world now in a window."""
        self._draws().show(self.scene())

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _draws(self) -> Renderer:
        if self._renderer is None:
            self._renderer = Renderer()
        return self._renderer

    def scene(self) -> Scene:
        """The world now, whatever has become of it."""
        with np.errstate(all="ignore"):
            return self._scene()

    def _scene(self) -> Scene:
        worlds, world, fleet, task = self.worlds, self.world, self.worlds.fleet, self.worlds.task
        n, discharge = task.vehicle.number_of_thrusters, task.vehicle.discharge
        picture = task.picture(Frame(worlds.state, world, worlds.info(), np.array(self._samples)))
        rows = fleet.fault_rows()[world]
        active = fleet.struck(worlds.steps * task.vehicle.control_period)[world]
        places = self._places()
        path = np.array(self._path) if self._path else np.zeros((0, fleet.craft, 3))
        firing = task.vehicle.control_period if discharge is None else discharge.firing_time
        own = task.first_commanded
        craft = tuple(
            CraftScene(
                position=places[c],
                attitude=_unit(fleet.read(at.ATTITUDE, 4)[world, c]),
                duties=np.clip(drawable(fleet.read(fleet.rows.duties, n)[world, c]), 0.0, 1.0),
                thrust=np.clip(drawable(fleet.read(fleet.rows.delivered, n)[world, c] / firing), 0.0, 1.0),
                faulty=np.isin(
                    np.arange(n),
                    rows[c, active[c] & (rows[c, :, FIELD_KIND] < WHEEL_TORQUE_LOSS), FIELD_THRUSTER],
                ),
                shut=picture.closed[c] if len(picture.closed) else np.zeros(n, np.bool_),
                path=path[:, c],
                target=drawable(picture.targets[c] if len(picture.targets) else np.zeros(3)),
                name=f"craft {c + 1}" if fleet.craft > 1 else "",
            )
            for c in (*range(own, fleet.craft), *range(own))  # the first agent's is drawn large
        )
        return Scene(
            spacecraft=task.vehicle,
            craft=craft,
            time=float(self._time()),
            title=self.title,
            readouts=picture.readouts,
            bars=picture.bars,
            curves=tuple(Curve(**trace._asdict()) for trace in picture.traces),
            curves_name=picture.traces_name,
            corridor=picture.corridor,
        )


def _unit(attitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """An attitude that can be drawn: as it is if it is a quaternion, else level."""
    length = np.linalg.norm(attitude)
    return attitude if _SHORTEST < length < FARTHEST else _LEVEL
