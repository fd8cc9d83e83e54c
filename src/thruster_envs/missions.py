"""Missions of a formation on plasma thrusters, flown whole: followers turn to their attitudes and keep them.

A mission is what Valdes 2008, chapters 5 and 6, flies: a leader that holds its attitude and followers that
turn from it by given angles, all under the law of :mod:`thruster_envs.pilots.attitude`, in the physics
of :mod:`thruster_envs.physics.pulsed_flight`, faults included. It runs compiled from its start to its end,
many missions at once, and is to the last bit what ``formation_attitude_v1`` gives where that law flies it.

Left out: targets that change, and any controller but that law.

>>> missions = fly_missions([20.0, 30.0, 40.0], degrees=True)
>>> bool(missions.meets_requirements()[0, 1:].all())
True
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.faults import FaultDistribution, as_faults
from thruster_envs.faults.encoding import FAULT_FIELDS, FIELD_SENSOR
from thruster_envs.physics.attitude import conjugate, quaternion_product
from thruster_envs.physics.fleet import Fleet, check_flyable
from thruster_envs.physics.pulsed_craft import BIAS_TORQUE, PulsedFlight, discharge_of
from thruster_envs.pilots.attitude import AttitudePilot, turned
from thruster_envs.spacecraft import Sensors, Spacecraft, load
from thruster_envs.spacecraft.description import Vector
from thruster_envs.tasks.attitude_flight import fly_whole, shares_of_firings
from thruster_envs.tasks.contract import check_whole
from thruster_envs.tasks.formation_attitude import ATTITUDE_TOLERANCE, RATE_TOLERANCE, SETTLING_LIMIT
from thruster_envs.threads import run_shared
from thruster_envs.views.inputs import checked_seed

FloatArray = NDArray[np.float64]

#: The kernels' arithmetic on arrays.
_product: Callable[[Any, Any], tuple[FloatArray, ...]] = quaternion_product.py_func
_turned: Callable[[FloatArray, FloatArray], tuple[FloatArray, ...]] = turned.py_func
_conjugate: Callable[[FloatArray], tuple[FloatArray, ...]] = conjugate.py_func
#: Missions that one call of the compiled loop flies together.
_TOGETHER = 64


def attitude_of(roll_pitch_yaw: ArrayLike, *, degrees: bool = False) -> FloatArray:
    """Attitude after turns by yaw about z, then pitch about y, then roll about x.

    Args:
        roll_pitch_yaw: (..., 3), rad.
        degrees: Whether they are in degrees instead.

    Returns:
        (..., 4), body-from-reference, scalar first and not negative. Valdes 2008, Table 5.II, prints the
        conjugate.

    >>> attitude_of([20.0, 30.0, 40.0], degrees=True).round(4).tolist()
    [0.9093, -0.0704, -0.2969, -0.2831]
    """
    angles = np.asarray(roll_pitch_yaw, dtype=np.float64)
    half = np.moveaxis(0.5 * (np.radians(angles) if degrees else angles), -1, 0)
    q = np.stack(_turned(np.cos(half), np.sin(half)), axis=-1)
    return np.asarray(np.where(q[..., :1] < 0.0, -q, q))


class Discharges(NamedTuple):
    """The firings of one craft in a mission, one entry of each array for each.

    Attributes:
        step: Control period, from 0, at whose start it fired.
        thruster: Number, from 1.
        thrust: Share of the nominal impulse that it gave.
        slug_mass: kg.
        electrode_width: m.
        added_resistance: ohm.
    """

    step: NDArray[np.int64]
    thruster: NDArray[np.int64]
    thrust: FloatArray
    slug_mass: FloatArray
    electrode_width: FloatArray
    added_resistance: FloatArray

    def parameters(self, which: Any = slice(None)) -> dict[str, FloatArray]:
        """The arguments of :func:`~thruster_envs.physics.plasma_pulse.pulse_waveforms`, of some firings."""
        return {
            name: getattr(self, name)[which] for name in ("slug_mass", "electrode_width", "added_resistance")
        }


@dataclass(frozen=True, eq=False)
class Missions:
    """What became of a batch of missions; the first craft is the leader.

    What is relative is so to the leader; the leader's own is relative to the frame it started in. Quaternions
    are body-from-reference; those of Valdes 2008 are their conjugates.

    Attributes:
        spacecraft: What every craft is.
        targets: (missions, craft, 4), relative attitudes asked for.
        attitude: (missions, steps + 1, craft, 4), true relative attitude at the start of each control period
            and at the end of the last.
        measured_attitude: The same as measured.
        rate: (missions, steps + 1, craft, 3), rad/s, true relative rate in body axes.
        measured_rate: The same as measured.
        pulses: (missions, steps, craft, 3), int8: 1 for a pulse commanded about the axis in its period, -1
            for one against it, 0 for none.
        thrust: (missions, steps, craft, n), share of the nominal impulse that each thruster gave; 0 where it
            did not fire.
        faults: (missions, craft, slots, fields), as :data:`thruster_envs.faults.encoding.FAULT_FIELDS` has
            them.
    """

    spacecraft: Spacecraft
    targets: FloatArray
    attitude: FloatArray
    measured_attitude: FloatArray
    rate: FloatArray
    measured_rate: FloatArray
    pulses: NDArray[np.int8]
    thrust: FloatArray
    faults: FloatArray

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.spacecraft.control_period

    @cached_property
    def time(self) -> FloatArray:
        """(steps + 1,), s since the start."""
        return self.period * np.arange(self.attitude.shape[1], dtype=np.float64)

    def errors(self) -> FloatArray:
        """(missions, steps + 1, craft, 6): vector part of the true error quaternion; true rate, rad/s."""
        target = _conjugate(np.moveaxis(self.targets, -1, 0)[:, :, np.newaxis])
        error = np.stack(_product(np.moveaxis(self.attitude, -1, 0), target), axis=-1)
        sign = np.where(error[..., :1] < 0.0, -1.0, 1.0)
        return np.concatenate([sign * error[..., 1:], self.rate], axis=-1)

    def settling_times(self) -> FloatArray:
        """(missions, craft, 6), s: from when on each error stays within its tolerance; infinite for never."""
        outside = np.abs(self.errors()) >= _TOLERANCES
        last = outside.shape[1] - 1 - np.argmax(outside[:, ::-1], axis=1)
        times = np.where(outside.any(axis=1), (last + 1) * self.period, 0.0)
        return np.asarray(np.where(outside[:, -1], math.inf, times), np.float64)

    def final_errors(self) -> FloatArray:
        """(missions, craft, 6): size of each error at the end."""
        return np.abs(self.errors()[:, -1])

    def meets_requirements(self) -> NDArray[np.bool_]:
        """(missions, craft): whether the attitude settled in time and all errors are within it at the end."""
        settled = (self.settling_times()[..., :3] < SETTLING_LIMIT).all(axis=-1)
        return np.asarray(settled & (self.final_errors() < _TOLERANCES).all(axis=-1))

    def firings(self) -> NDArray[np.int64]:
        """(missions, craft, n): how often each thruster fired."""
        return np.asarray(np.count_nonzero(self.thrust, axis=1))

    def discharges(self, mission: int, craft: int) -> Discharges:
        """Every firing of one craft (from 0) in the order of time, with what its discharge was.

        The waveforms of some of them, on demand:
        ``pulse_waveforms(spacecraft.discharge, **discharges.parameters(which))``.
        """
        discharge = discharge_of(self.spacecraft)
        step, thruster = np.nonzero(self.thrust[mission, :, craft])
        capacitors = np.array([one.capacitor for one in self.spacecraft.thrusters])
        shares = np.empty((step.size, 3))
        rows = self.faults[mission, craft]
        of_thrusters = np.where(rows[:, FIELD_SENSOR, np.newaxis] > 0.0, 0.0, rows)
        shares_of_firings(of_thrusters, step, thruster, capacitors, self.period, shares)
        return Discharges(
            step, thruster + 1, self.thrust[mission, step, craft, thruster],
            discharge.slug_mass * shares[:, 0], discharge.electrode_width * shares[:, 1], shares[:, 2],
        )  # fmt: skip


_TOLERANCES = np.array([ATTITUDE_TOLERANCE] * 3 + [RATE_TOLERANCE] * 3)


def fly_missions(
    targets: ArrayLike,
    *,
    degrees: bool = False,
    spacecraft: Any = "ppt_cubesat",
    craft: int = 3,
    steps: int = 3000,
    faults: Any = None,
    seeds: int | Sequence[int] = 0,
    noise: bool = True,
    gravity_gradient: bool = True,
    bias_torque: Vector = BIAS_TORQUE,
    fault_bias: tuple[float, float] = (0.0, 0.0),
    fault_slots: int = 4,
    threads: int | None = None,
) -> Missions:
    """Fly missions under the leader and follower law. Each argument is a user's option of its own.

    Args:
        targets: Where the followers turn to, from the leader: roll, pitch and yaw in rad, (3,) for all,
            (followers, 3) or (missions, followers, 3); or quaternions, with 4 in place of 3.
        degrees: Whether angles are in degrees instead.
        spacecraft: Name in the catalogue, path, mapping or :class:`~thruster_envs.spacecraft.Spacecraft`; it
            must have a discharge.
        craft: Craft in a formation, at least 2.
        steps: Control periods of a mission.
        faults: For all missions, as :func:`thruster_envs.faults.as_faults` takes them; or a list with one
            entry for each mission, each of them a list of faults, a distribution or None.
        seeds: One for each mission; of a number, mission k takes seed + k.
        noise: Whether sensors are noisy.
        gravity_gradient: Whether the gravity gradient acts.
        bias_torque: A constant torque on every craft, N m, body axes.
        fault_bias: As of :class:`~thruster_envs.physics.pulsed_craft.PulsedFlight`.
        fault_slots: Faults that one craft can have.
        threads: That share the missions; None takes one per core where there are many.

    Raises:
        ValueError: Numbers of missions that do not agree, or what the physics refuses.
    """
    vehicle = load(spacecraft)
    discharge_of(vehicle)
    check_flyable(vehicle)
    check_whole("craft", craft, 2, 2**20)
    check_whole("steps", steps, 1, 2**31)
    check_whole("fault_slots", fault_slots, 1, 64)
    if not noise:
        vehicle = vehicle.replace(sensors=Sensors())
    sources = _faults_by_mission(faults)
    aims = _aims(targets, degrees, craft)
    counts = {
        "targets": len(aims),
        "faults": len(sources),
        "seeds": 1 if isinstance(seeds, (int, np.integer)) else len(seeds),
    }
    number = max(counts.values())
    for name, count in counts.items():
        if count not in (1, number):
            raise ValueError(
                f"{name} has {count} entries; one for each of the {number} missions would be right"
            )
    keys = [seeds + k for k in range(number)] if isinstance(seeds, (int, np.integer)) else list(seeds)
    keys = keys * number if len(keys) < number else keys
    aims = np.ascontiguousarray(np.broadcast_to(aims, (number, craft, 4)))
    gains, n = AttitudePilot.of(vehicle).gains, vehicle.number_of_thrusters
    attitude, measured_attitude, rate, measured_rate = (
        np.zeros((number, steps + 1, craft, size)) for size in (4, 4, 3, 3)
    )
    pulses = np.zeros((number, steps, craft, 3), np.int8)
    thrust = np.zeros((number, steps, craft, n))
    rows = np.zeros((number, craft, fault_slots, len(FAULT_FIELDS)))

    pulsed = PulsedFlight(gravity_gradient=gravity_gradient, bias_torque=bias_torque, fault_bias=fault_bias)

    def fly(first: int, last: int) -> None:
        for start in range(first, last, _TOGETHER):
            which = slice(start, min(start + _TOGETHER, last))
            fleet = Fleet(vehicle, which.stop - start, craft, slots=fault_slots, threads=1, pulsed=pulsed)
            _begin(fleet, keys[which], sources[which] if len(sources) > 1 else sources)
            rows[which] = fleet.fault_rows()
            fly_whole(
                fleet.arrays, fleet.sensor_faults, fleet.sensors_fail, fleet.vehicle, aims[which], gains,
                tuple(
                    one[which] for one in (attitude, measured_attitude, rate, measured_rate, pulses, thrust)
                ),
            )  # fmt: skip

    cores = threads if threads is not None else (os.cpu_count() or 1)
    shares = min(cores, -(-number // _TOGETHER))
    run_shared(fly, list(pairwise(np.linspace(0, number, shares + 1).astype(int).tolist())))
    return Missions(
        vehicle, aims, attitude, measured_attitude, rate, measured_rate, pulses, thrust, rows
    )  # fmt: skip


def _begin(fleet: Fleet, seeds: Sequence[int], faults: Sequence[Any]) -> None:
    """Put every world of a fleet to the start of its mission."""
    keys = np.zeros((fleet.worlds, 2), np.uint64)
    for world, seed in enumerate(seeds):
        high, low = divmod(checked_seed(seed), 2**64)
        keys[world] = low, high
    for k, source in enumerate(faults):
        which = fleet.everyone if len(faults) == 1 else np.array([k])
        fleet.begin(which, keys, np.zeros(fleet.worlds, np.uint64), fleet.plan(as_faults(source)))
    fleet.look(fleet.everyone)


def _faults_by_mission(faults: Any) -> Sequence[Any]:
    """What each mission has, or one entry for all of them."""
    several = isinstance(faults, Sequence) and any(
        one is None or isinstance(one, (Sequence, FaultDistribution)) for one in faults
    )
    return faults if several else [faults]


def _aims(targets: ArrayLike, degrees: bool, craft: int) -> FloatArray:
    """(1 or missions, craft, 4): the leader's first."""
    given = np.asarray(targets, dtype=np.float64)
    followers = (craft - 1,)
    if given.ndim not in (1, 2, 3) or given.shape[-1] not in (3, 4) or given.shape[-2:-1] not in (
        (), (1,), followers,
    ):  # fmt: skip
        raise ValueError(
            f"targets have the shape {given.shape}; (3,), ({craft - 1}, 3) or (missions, {craft - 1}, 3), or "
            "the same with 4, would be right"
        )
    if not np.isfinite(given).all():
        raise ValueError(
            "targets hold a number that is not finite; angles or unit quaternions would be right"
        )
    if given.shape[-1] == 4:
        length = np.linalg.norm(given, axis=-1, keepdims=True)
        if np.abs(length - 1.0).max() > 1e-3:
            raise ValueError(f"a target has the length {length.max():g}; unit quaternions would be right")
        attitudes = np.where(np.abs(length - 1.0) < 1e-12, given, given / length)
    else:
        attitudes = attitude_of(given, degrees=degrees)
    while attitudes.ndim < 3:
        attitudes = attitudes[np.newaxis]
    aims = np.zeros((len(attitudes), craft, 4))
    aims[:, 0, 0], aims[:, 1:] = 1.0, attitudes
    return aims
