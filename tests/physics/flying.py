"""Shared by the physics tests: random vehicles and faults, a fleet flown under duties, its scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thruster_envs.faults import Fault, FaultDistribution
from thruster_envs.faults.record import GENERAL_KINDS, PROFILES
from thruster_envs.physics import rows as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.pulsed_craft import PulsedFlight
from thruster_envs.spacecraft import Feed, Sensors, Spacecraft, Thruster

Array = NDArray[np.float64]

SENSOR_WORDS = 6
"""Random words of a period that the sensors take before the thrusters take theirs."""
SCATTER = 0.1
"""Half-width of the firing-to-firing scatter of a random vehicle, share of its thrust."""


@dataclass(frozen=True)
class Flown:
    """What became of world 0 in K periods.

    Attributes:
        fleet: As it stands after the last one.
        states: (K, 14) position, velocity, attitude, rate and mass.
        impulses: (K, 6) N s and N m s, body axes.
        delivered: (K, n) s, delivered impulse over nominal thrust.
    """

    fleet: Fleet
    states: Array
    impulses: Array
    delivered: Array


def scatter_draws(seed: int, step: int, thrusters: int, craft: int = 0, episode: int = 0) -> Array:
    """(n,) the draws in [-1, 1] of one period, by NumPy's own Philox."""
    words: list[int] = []
    while len(words) < SENSOR_WORDS + (thrusters + 1) // 2:
        counter = [len(words) // 4, step, episode, craft]
        # NumPy counts up before it gives a block.
        before = (sum(word << (64 * k) for k, word in enumerate(counter)) - 1) % 2**256
        words += [int(word) for word in np.random.Philox(counter=before, key=seed).random_raw(4)]
    halves = [half for word in words[SENSOR_WORDS:] for half in (word >> 32, word & 0xFFFFFFFF)]
    return 2.0 * (np.array(halves[:thrusters], dtype=np.float64) + 0.5) / 2.0**32 - 1.0


def scatter_of_flight(spacecraft: Spacecraft, seed: int, periods: int) -> Array:
    """(K, n) relative error of each thruster's thrust in each period of world 0."""
    half_widths = np.array([thruster.scatter for thruster in spacecraft.thrusters])
    return half_widths * np.array(
        [scatter_draws(seed, step, spacecraft.number_of_thrusters) for step in range(periods)]
    )


def random_vehicle(
    rng: np.random.Generator,
    *,
    valve_dynamics: bool,
    thrusters: int | None = None,
    period: float | None = None,
    thrust: float = 0.02,
) -> Spacecraft:
    """A craft with random geometry, mass properties, feed and, on request, valves with delays and ramps.

    Args:
        rng: What chooses.
        valve_dynamics: Whether its valves have delays and ramps.
        thrusters: Their number; 1 to 14 by default.
        period: Control period, s; 1 or 5 by default.
        thrust: Of the strongest thruster that there can be, N.
    """
    n = int(rng.integers(1, 15)) if thrusters is None else thrusters
    root = rng.normal(size=(3, 3)) * 0.2 + np.diag(rng.uniform(0.6, 1.2, 3))
    spread = root @ root.T
    inertia = 0.5 * (np.trace(spread) * np.eye(3) - spread)  # of a body
    chosen_period = float(rng.choice([1.0, 5.0]))
    return Spacecraft(
        name="random",
        mass=float(rng.uniform(5, 30)),
        inertia=tuple(tuple(float(x) for x in row) for row in 0.5 * (inertia + inertia.T)),
        thrusters=tuple(
            Thruster(
                name=f"T{i}",
                position=tuple(rng.uniform(-0.5, 0.5, 3).tolist()),
                direction=tuple(rng.normal(size=3).tolist()),
                thrust=float(rng.uniform(0.25, 1.0)) * thrust,
                minimum_pulse=float(rng.choice([0.0, 0.3])),
                opening_delay=float(rng.uniform(0, 0.4)) * valve_dynamics,
                closing_delay=float(rng.uniform(0, 1.2)) * valve_dynamics,
                rise_time=float(rng.uniform(0, 2.0)) * valve_dynamics,
                fall_time=float(rng.uniform(0, 3.0)) * valve_dynamics,
                scatter=SCATTER,
                specific_impulse=float(rng.uniform(40, 200)),
            )
            for i in range(n)
        ),
        feed=Feed(coupling=0.04, propellant_mass=3.0),
        sensors=Sensors(position=0.02, velocity=5e-4, attitude=0.01, rate=5e-4),
        control_period=chosen_period if period is None else period,
        mean_motion=0.0011,
    )


def with_valves(spacecraft: Spacecraft, **changes: float) -> Spacecraft:
    """The craft with some fields of all its thrusters changed."""
    return spacecraft.replace(thrusters=tuple(replace(one, **changes) for one in spacecraft.thrusters))


def random_faults(
    rng: np.random.Generator,
    spacecraft: Spacecraft,
    *,
    number: int = 3,
    kinds: Sequence[str] = GENERAL_KINDS,
    profiles: Sequence[str] = PROFILES,
) -> list[Fault]:
    """Faults of distinct thrusters within the first periods of a flight, of every kind and profile.

    A late opening stays within its period: a pulse that would open after it is lost.
    """
    period = spacecraft.control_period
    faulty = rng.permutation(spacecraft.number_of_thrusters)[:number] + 1
    faults = []
    for thruster in faulty.tolist():
        kind = str(rng.choice(kinds))
        longest_delay = 0.5 * min(period, 2.0)
        faults.append(
            Fault(
                thruster,
                kind,
                severity=float(rng.uniform(0.1, 0.9)) * (longest_delay if kind == "late_opening" else 1.0),
                onset=float(rng.uniform(0.0, 4.0 * period)),
                duration=float(rng.choice([np.inf, rng.uniform(1.0, 20.0)])),
                profile="intermittent" if kind == "intermittent" else str(rng.choice(profiles)),
                profile_time=float(rng.uniform(1.0, 4.0)) * period,
                dwell=float(rng.uniform(0.2, 0.8)),
                azimuth=float(rng.uniform(0.0, 2.0 * np.pi)),
            )
        )
    return faults


def random_duties(rng: np.random.Generator, periods: int, thrusters: int) -> Array:
    """Duties with whole periods, pauses, short and ordinary pulses among them."""
    duties = rng.random((periods, thrusters))
    kind = rng.random((periods, thrusters))
    duties[kind < 0.25] = 0.0
    duties[kind > 0.7] = 1.0
    duties[(kind > 0.25) & (kind < 0.3)] *= 0.05
    return duties


def begin(
    fleet: Fleet, faults: Sequence[Fault] | FaultDistribution = (), *, seed: int = 0, episode: int = 0
) -> None:
    """Begin an episode in every world: world i under the seed ``seed + i``."""
    keys = np.zeros((fleet.worlds, 2), np.uint64)
    keys[:, 0] = seed + np.arange(fleet.worlds)
    episodes = np.full(fleet.worlds, episode, np.uint64)
    fleet.begin(fleet.everyone, keys, episodes, fleet.plan(faults))


def fly(
    spacecraft: Spacecraft,
    duties: Array,
    *,
    faults: Sequence[Fault] = (),
    seed: int = 0,
    position: ArrayLike = (0.0, 0.0, 0.0),
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    rate: ArrayLike = (0.0, 0.0, 0.0),
    nonlinear: bool = False,
    max_substep: float = 1.0,
) -> Flown:
    """Fly one craft through ``duties`` (K, n)."""
    fleet = Fleet(spacecraft, 1, nonlinear=nonlinear, max_substep=max_substep)
    begin(fleet, faults, seed=seed)
    for row, values in (
        (at.POSITION, position),
        (at.VELOCITY, velocity),
        (at.ATTITUDE, attitude),
        (at.RATE, rate),
    ):
        fleet.write(row, values)
    fleet.look(fleet.everyone)
    states, impulses, delivered = [], [], []
    for row in duties:
        fleet.write(fleet.rows.duties, row)
        fleet.fly()
        states.append(fleet.read(0, 14)[0, 0])
        impulses.append(fleet.read(at.IMPULSE, 6)[0, 0])
        delivered.append(fleet.read(fleet.rows.delivered, fleet.rows.thrusters)[0, 0])
    return Flown(fleet, np.array(states), np.array(impulses), np.array(delivered))


def pulsed_fleet(spacecraft, worlds, craft=1, *, slots=4, max_substep=None, threads=None, **torques):
    """Craft whose thrusters fire as pulsed plasma thrusters do."""
    return Fleet(
        spacecraft, worlds, craft, slots=slots, max_substep=max_substep, threads=threads,
        pulsed=PulsedFlight(**torques),
    )  # fmt: skip
