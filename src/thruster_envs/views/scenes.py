"""From a world of a batch to a picture: the path so far, and the scene that the renderer draws.

A craft whose position is not finite is drawn where it was last, other numbers that are not finite as zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.faults import MODES
from thruster_envs.faults.encoding import FIELD_KIND, FIELD_THRUSTER, WHEEL_TORQUE_LOSS
from thruster_envs.physics import rows as at
from thruster_envs.physics.plasma_pulse import pulse_waveforms
from thruster_envs.rendering import CraftScene, Curve, Renderer, Scene
from thruster_envs.tasks.fault_diagnosis import DiagnosisState
from thruster_envs.tasks.formation_attitude import FormationAttitudeState, turn_of
from thruster_envs.tasks.formation_keeping import FormationState
from thruster_envs.tasks.mars_rendezvous import ApproachState, MarsRendezvous, corridor_half_width
from thruster_envs.tasks.pulse_diagnosis import CASES, PulseDiagnosis, PulseState, peak_current
from thruster_envs.tasks.thruster_mapping import MappingState
from thruster_envs.views.worlds import Worlds

#: Modes that every environment can be rendered in.
RENDER_MODES = ("rgb_array", "human")
#: Dots of a curve at most; a second in the first column.
_MOST_DOTS, _SECOND = 150, np.array([[0.0] * 4, [1.0, 0.0, 0.0, 0.0]])
#: Lengths and other numbers that are drawn are within this of zero; an attitude shorter than that is none.
_FARTHEST, _SHORTEST, _LEVEL = 1e9, 1e-9, np.array([1.0, 0.0, 0.0, 0.0])


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
        self._turn: list[tuple[float, ...]] = []
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
        self._turn.clear()
        self.follow()

    def follow(self) -> None:
        """Add where the craft are now to the path, and how far the first agent's has turned."""
        self._path.append(self._places())
        if isinstance(self.worlds.state, FormationAttitudeState):
            time = float(self.worlds.steps[self.world]) * self.worlds.task.vehicle.control_period
            first = self.worlds.task.first_commanded
            with np.errstate(all="ignore"):  # of a state that is beyond all numbers
                turn = turn_of(self.worlds.state, self.world, first)
            self._turn.append((time, *_drawable(np.array(turn)).tolist()))

    def _places(self) -> NDArray[np.float64]:
        """(craft, 3) m, where the craft are, or were last."""
        last = self._path[-1] if self._path else 0.0
        return _drawable(self.worlds.fleet.read(at.POSITION, 3)[self.world], last)

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
        n, period = task.vehicle.number_of_thrusters, task.vehicle.control_period
        info = worlds.info()
        rows = fleet.fault_rows()[world]
        times = worlds.steps * period
        active = fleet.struck(times)[world]
        places = self._places()
        path = np.array(self._path) if self._path else np.zeros((0, fleet.craft, 3))
        slots = (
            worlds.state.slots[world, :, :3]
            if isinstance(worlds.state, (FormationState, DiagnosisState))
            else np.zeros((fleet.craft, 3))
        )
        discharge = task.vehicle.discharge
        firing = period if discharge is None else discharge.firing_time
        own = task.first_commanded
        approach = worlds.state if isinstance(worlds.state, ApproachState) else None
        valves = fleet.read(fleet.rows.inhibited, n)[world] > 0.0 if approach is not None else None
        craft = tuple(
            CraftScene(
                position=places[c],
                attitude=_unit(fleet.read(at.ATTITUDE, 4)[world, c]),
                duties=np.clip(_drawable(fleet.read(fleet.rows.duties, n)[world, c]), 0.0, 1.0),
                thrust=np.clip(_drawable(fleet.read(fleet.rows.delivered, n)[world, c] / firing), 0.0, 1.0),
                faulty=np.isin(
                    np.arange(n),
                    rows[c, active[c] & (rows[c, :, FIELD_KIND] < WHEEL_TORQUE_LOSS), FIELD_THRUSTER],
                ),
                shut=np.zeros(n, np.bool_) if valves is None else valves[c],
                path=path[:, c],
                target=_drawable(slots[c]),
                name=f"craft {c + 1}" if fleet.craft > 1 else "",
            )
            for c in (*range(own, fleet.craft), *range(own))  # the first agent's is drawn large
        )
        readouts = [
            ("fuel", f"{info['fuel'][world].sum():.0f} thruster-s"),
            ("score", f"{info['score'][world].mean():.2f}"),
        ]
        bars: tuple[tuple[str, float, float], ...] = ()
        curves: tuple[Curve, ...] = ()
        curves_name = ""
        if isinstance(worlds.state, MappingState):
            bars = _rate_bars(worlds.state, world)
        elif isinstance(worlds.state, FormationAttitudeState):
            curves, curves_name = _turn_curves(np.array(self._turn)), f"{craft[0].name}, from the leader"
            angle = np.degrees(info["attitude"]["error"][world, 0])
            readouts.insert(0, ("error", f"{angle:.2f}°"))
        elif isinstance(worlds.state, PulseState):
            assert isinstance(task, PulseDiagnosis)  # whose state it is
            curves, curves_name = _pulse_curves(task, worlds.state, world), "last pulse"
            truth = CASES[worlds.state.case[world]].replace("_", " ")
            declared = CASES[worlds.state.declared[world]].replace("_", " ")
            thrust = f"{100.0 * info['diagnosis']['thrust'][world, 0]:.0f} %"
            readouts[0] = ("thrust", thrust)
            readouts += [("last pulse", truth), ("declared before", declared)]
        else:
            distance = float(np.linalg.norm(fleet.read(at.POSITION, 3)[world, own] - slots[own]))
            readouts.insert(0, ("distance", f"{distance:.{1 if distance >= 1.0 else 2}f} m"))
        corridor = np.zeros((0, 2))
        if approach is not None:
            assert isinstance(task, MarsRendezvous)  # whose state it is
            branches = task.inhibit and task.vehicle.spare_branch
            readouts[1:1] = _approach_readouts(info, world, branches=branches)
            corridor = np.array(
                [(along, corridor_half_width(along)) for along in (-2.0 * task.distance, 0.0)]
            )
        if isinstance(worlds.state, DiagnosisState):
            readouts.append(("declared", _declaration(worlds.state, world)))
        return Scene(
            spacecraft=task.vehicle,
            craft=craft,
            time=float(times[world]),
            title=self.title,
            readouts=tuple(readouts),
            bars=bars,
            curves=curves,
            curves_name=curves_name,
            corridor=corridor,
        )


def _approach_readouts(info: dict[str, Any], world: int, *, branches: bool) -> list[tuple[str, str]]:
    """Which set of thrusters is in use, where there are two, and how the approach has ended, if it has."""
    approach = info["approach"]
    readouts = [("branch", "AB"[int(approach["branch"][world, 0])])] if branches else []
    for end, reached in (
        ("captured", info["success"]),
        ("retreated", approach["retreated"]),
        ("missed or lost", ~approach["safe"]),
    ):
        if reached[world, 0]:
            readouts.append(("end", end))
    return readouts


def _declaration(state: DiagnosisState, world: int) -> str:
    """What was declared last, in words."""
    thruster, mode = state.declared[world]
    return f"thruster {thruster} {MODES[mode]}" if thruster > 0 else "no fault"


def _pulse_curves(task: PulseDiagnosis, state: PulseState, world: int) -> tuple[Curve, ...]:
    """Voltage and current of the last pulse beside those of a nominal one."""
    discharge, numbers, samples = task.discharge, task.sample_numbers, task.samples
    nominal, measured = pulse_waveforms(discharge), _drawable(state.measured[world])
    time, volts, amperes = 1e6 * nominal.time[numbers], discharge.voltage, peak_current(discharge)
    current = amperes * measured[samples : 2 * samples]
    return tuple(
        Curve(label=label, time_label="time, µs", time=time, expected=expected, measured=found)
        for label, expected, found in (
            ("voltage, V", nominal.voltage[numbers], volts * measured[:samples]),
            ("current, kA", 1e-3 * nominal.current[numbers], 1e-3 * current),
        )
    )


def _turn_curves(turn: NDArray[np.float64]) -> tuple[Curve, ...]:
    """Angle and rate of the first agent's craft from the leader since the start, and what they should be."""
    few = turn[:: -(-len(turn) // _MOST_DOTS)] if len(turn) > 1 else np.tile(turn, (2, 1)) + _SECOND
    time, angle, target, rate = few.T
    return (
        Curve(
            label="turned, deg", time_label="time, s", time=time, expected=np.degrees(target),
            measured=np.degrees(angle),
        ),
        Curve(
            label="rate, mrad/s", time_label="time, s", time=time, expected=0.0 * rate, measured=1e3 * rate
        ),
    )  # fmt: skip


def _rate_bars(state: MappingState, world: int) -> tuple[tuple[str, float, float], ...]:
    """Commanded and delivered rate change of the last command, in shares of the authority per axis."""
    authority = state.model.authority
    commanded, delivered = (
        _drawable(change[world] / authority) for change in (state.answered, state.delivered)
    )
    names = ("x", "y", "z", "rot x", "rot y", "rot z")
    return tuple((name, float(c), float(d)) for name, c, d in zip(names, commanded, delivered, strict=True))


def _drawable(values: NDArray[np.float64], otherwise: ArrayLike = 0.0) -> NDArray[np.float64]:
    """The values where they are finite, within reach of a picture; something else where they are not."""
    return np.where(np.isfinite(values), values, otherwise).clip(-_FARTHEST, _FARTHEST)


def _unit(attitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """An attitude that can be drawn: as it is if it is a quaternion, else level."""
    length = np.linalg.norm(attitude)
    return attitude if _SHORTEST < length < _FARTHEST else _LEVEL
