"""Shared by the physics tests: random vehicles, a fleet of one flown under given duties, and the scatter that it draws."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from thruster_envs.faults import Fault, encode
from thruster_envs.physics import layout as at
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import Feed, Sensors, Spacecraft, Thruster

Array = NDArray[np.float64]
SENSOR_WORDS = 6


def scatter_draws(seed: int, step: int, thrusters: int, craft: int = 0, episode: int = 0) -> Array:
    """(n,) the draws in [-1, 1] of one period, by NumPy's own Philox."""
    words = []
    for block in range(-(-(SENSOR_WORDS + (thrusters + 1) // 2) // 4)):
        generator = np.random.Philox(key=[seed, 0])
        state = generator.state
        # NumPy counts up before it gives a block.
        counter = [block, step, episode, craft]
        total = (sum(c << (64 * k) for k, c in enumerate(counter)) - 1) % 2**256
        state["state"]["counter"] = np.array(
            [(total >> (64 * k)) & (2**64 - 1) for k in range(4)], dtype=np.uint64
        )
        generator.state = state
        words += [int(word) for word in generator.random_raw(4)]
    halves = [half for word in words[SENSOR_WORDS:] for half in (word >> 32, word & 0xFFFFFFFF)]
    return 2.0 * (np.array(halves[:thrusters], dtype=np.float64) + 0.5) / 2.0**32 - 1.0


def random_vehicle(rng: np.random.Generator, *, valve_dynamics: bool, thrusters: int | None = None) -> Spacecraft:
    """A craft with random geometry, mass properties, feed and, on request, valves with delays and ramps."""
    n = int(rng.integers(1, 15)) if thrusters is None else thrusters
    root = rng.normal(size=(3, 3)) * 0.2 + np.diag(rng.uniform(0.6, 1.2, 3))
    inertia = root @ root.T
    return Spacecraft(
        name="random",
        mass=float(rng.uniform(5, 30)),
        inertia=tuple(tuple(float(x) for x in row) for row in 0.5 * (inertia + inertia.T)),
        thrusters=tuple(
            Thruster(
                name=f"T{i}",
                position=tuple(rng.uniform(-0.5, 0.5, 3).tolist()),
                direction=tuple(rng.normal(size=3).tolist()),
                thrust=float(rng.uniform(0.005, 0.02)),
                minimum_pulse=float(rng.choice([0.0, 0.3])),
                opening_delay=float(rng.uniform(0, 0.4)) * valve_dynamics,
                closing_delay=float(rng.uniform(0, 1.2)) * valve_dynamics,
                rise_time=float(rng.uniform(0, 2.0)) * valve_dynamics,
                fall_time=float(rng.uniform(0, 3.0)) * valve_dynamics,
                scatter=0.1,
                specific_impulse=float(rng.uniform(40, 200)),
            )
            for i in range(n)
        ),
        feed=Feed(coupling=0.04, propellant_mass=3.0),
        sensors=Sensors(position=0.02, velocity=5e-4, attitude=0.01, rate=5e-4),
        control_period=float(rng.choice([1.0, 5.0])),
        mean_motion=0.0011,
    )


def random_duties(rng: np.random.Generator, periods: int, thrusters: int) -> Array:
    """Duties with whole periods, pauses, short and ordinary pulses among them."""
    duties = rng.random((periods, thrusters))
    kind = rng.random((periods, thrusters))
    duties[kind < 0.25] = 0.0
    duties[kind > 0.7] = 1.0
    duties[(kind > 0.25) & (kind < 0.3)] *= 0.05
    return duties


def fly(
    spacecraft: Spacecraft,
    duties: Array,
    *,
    faults: list[Fault] | None = None,
    seed: int = 0,
    rate: tuple[float, float, float] = (0.0, 0.0, 0.0),
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    worlds: int = 1,
    **options: object,
) -> tuple[Fleet, Array, Array, Array]:
    """Fly through ``duties`` (periods, n). Returns the fleet and, of world 0: states (periods, 14), impulse and delivered on-times."""
    fleet = Fleet(spacecraft, worlds, **options)  # type: ignore[arg-type]
    keys = np.zeros((worlds, 2), np.uint64)
    keys[:, 0] = seed + np.arange(worlds)
    everyone = np.arange(worlds)
    rows = encode(faults or [], 1, spacecraft.number_of_thrusters, fleet.slots)
    fleet.begin(everyone, keys, np.zeros(worlds, np.uint64), rows)
    fleet.write(at.POSITION, np.array(position))
    fleet.write(at.VELOCITY, np.array(velocity))
    fleet.write(at.RATE, np.array(rate))
    fleet.look(everyone)
    states, impulses, delivered = [], [], []
    for row in duties:
        fleet.write(fleet.layout.duties, row)
        fleet.fly()
        states.append(fleet.read(0, 14)[0, 0])
        impulses.append(fleet.read(at.IMPULSE, 6)[0, 0])
        delivered.append(fleet.read(fleet.layout.delivered, fleet.layout.thrusters)[0, 0])
    return fleet, np.array(states), np.array(impulses), np.array(delivered)
