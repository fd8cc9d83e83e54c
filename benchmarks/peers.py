"""How fast others step, in the same run: the same physics in NumPy, Gymnasium, VMAS, Basilisk.

The environments of the peers are other tasks (a pole on a cart, four planar agents), so their figures
place ours, they do not rank anybody. Two comparisons are of like with like: the NumPy flight does the
work of the kernel on a healthy craft, sub-step for sub-step (``tests/benchmarks`` holds the two equal
to rounding); and the copies of our own single environment under Gymnasium's vector environments do the
work of a batch. A peer that is not installed is named as such.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.cartpole import cart_pole, cart_poles
from benchmarks.environments import ONE_DEAD, TASK, BatchFlight, calm_flight
from benchmarks.numpy_flight import NumpyFlight
from benchmarks.report import Row, Section, number, version
from benchmarks.timing import Effort, race
from thruster_envs.faults import as_faults
from thruster_envs.physics.fleet import Fleet
from thruster_envs.spacecraft import load

ABOUT = """\
One thread each, but for `AsyncVectorEnv`, which has a process for every copy. *Flight alone* is a
control period of a healthy Orion without a task around it: firing, flight, sensors, once by the kernels
and once by `benchmarks/numpy_flight.py`, with the same duties and both in sub-steps of at most 1 s (the
environments let the kernel choose). Basilisk flies one hub with Orion's mass properties and twelve
thrusters about the Earth in steps of 1 s, five of which make the control period after which Python sets
the on-times anew. VMAS steps `navigation` with four agents."""


@dataclass(frozen=True)
class Contestant:
    """One who steps.

    Attributes:
        work: One step of everything.
        amount: Environment steps in it.
        note: What a reader has to know.
        own: Whether it is of this package.
    """

    work: Callable[[], object]
    amount: int = 1
    note: str = ""
    own: bool = False


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    worlds = 64 if effort.quick else 1024
    rows = _compare("OrionRendezvous-v1, one world, `gym.make`", _one_by_one(), effort)
    rows += _compare(f"OrionRendezvous-v1, {worlds:,} worlds, all kinds of fault", _batches(worlds), effort)
    rows += _compare("flight alone, one craft, kernel", _flights(1), effort)
    rows += _compare(f"flight alone, {worlds:,} craft, kernel", _flights(worlds), effort)
    rows += _copies(2 if effort.quick else 8, effort)
    missing = [
        Row(f"{name}", None, "steps/s", note="not installed (extra `bench`)")
        for module, name in (("vmas", "VMAS navigation"), ("Basilisk", "Basilisk"))
        if importlib.util.find_spec(module) is None
    ]
    return Section("Peers", ABOUT, rows + missing)


def _compare(
    ours: str, contestants: dict[str, Contestant], effort: Effort, *, threaded: bool = False
) -> list[Row]:
    """Rows of all of them, ours first; beside the others how many times as fast as ours they are."""
    times = race({name: one.work for name, one in contestants.items()}, effort, threaded=threaded)
    rows = []
    for name, one in contestants.items():
        gain = times[name].times_faster_than(times[ours], one.amount, contestants[ours].amount)
        ratio = "what follows is compared with this"
        if name != ours:
            ratio = f"{number(gain)} times" if gain > 1.0 else f"1/{number(1.0 / gain)}"
        rate = times[name].per_second(one.amount)
        rows.append(Row(name, rate, "steps/s", ratio=ratio, note=one.note, charted=True, own=one.own))
    return rows


def _one_by_one() -> dict[str, Contestant]:
    contestants = {
        "OrionRendezvous-v1, one world, `gym.make`": Contestant(
            calm_flight(gym.make(TASK, faults=ONE_DEAD)), own=True
        ),
        "CartPole-v1, `gym.make`": Contestant(cart_pole()),
    }
    if importlib.util.find_spec("Basilisk") is not None:
        note = f"bsk {version('bsk')}, a step is a control period of 5 s"
        contestants["Basilisk, one craft with 12 thrusters"] = Contestant(_basilisk(), 1, note)
    return contestants


def _batches(worlds: int) -> dict[str, Contestant]:
    contestants = {
        f"OrionRendezvous-v1, {worlds:,} worlds, all kinds of fault": Contestant(
            BatchFlight(worlds), worlds, own=True
        ),
        f"CartPole-v1, vector form, {worlds:,} worlds": Contestant(cart_poles(worlds), worlds),
    }
    if importlib.util.find_spec("vmas") is not None:
        note = f"vmas {version('vmas')}, four agents a world"
        contestants[f"VMAS navigation, {worlds:,} worlds"] = Contestant(_vmas(worlds), worlds, note)
    return contestants


def _flights(craft: int) -> dict[str, Contestant]:
    """The kernel and the NumPy loop under the same duties: random ones, then what they leave of a period."""
    orion = load("orion")
    drawn = np.random.default_rng(0).random((craft, 12))
    duties = (drawn, 1.0 - drawn)
    fleet = Fleet(orion, craft, max_substep=1.0, threads=1)
    keys = np.zeros((craft, 2), np.uint64)
    keys[:, 0] = np.arange(craft)
    healthy = fleet.plan(as_faults(None))
    fleet.begin(fleet.everyone, keys, np.zeros(craft, np.uint64), healthy)
    rows = np.zeros((2, fleet.blocks * fleet.lanes, 12))
    rows[:, :craft] = duties
    commands = rows.reshape(2, fleet.blocks, fleet.lanes, 12).transpose(0, 1, 3, 2)
    first = fleet.rows.duties
    plain, rng = NumpyFlight(orion, craft), np.random.default_rng(0)

    def fly_kernel() -> None:
        for command in commands:
            fleet.data[:, first : first + 12] = command
            fleet.fly()

    def fly_numpy() -> None:
        for command in duties:
            plain.step(command, rng)

    many = "one craft" if craft == 1 else f"{craft:,} craft"
    return {
        f"flight alone, {many}, kernel": Contestant(fly_kernel, 2 * craft, own=True),
        f"flight alone, {many}, NumPy": Contestant(fly_numpy, 2 * craft),
    }


def _copies(copies: int, effort: Effort) -> list[Row]:
    """Our single environment under Gymnasium's own vector environments, and a native batch of as many."""
    envs: dict[str, Any] = {
        f"{copies} worlds, native batch": gym.make_vec(TASK, num_envs=copies, faults=ONE_DEAD),
        f"{copies} copies, `SyncVectorEnv`": gym.make_vec(
            TASK, num_envs=copies, vectorization_mode="sync", faults=ONE_DEAD
        ),
        f"{copies} copies, `AsyncVectorEnv`": gym.make_vec(
            TASK, num_envs=copies, vectorization_mode="async", vector_kwargs={"context": "spawn"},
            faults=ONE_DEAD,
        ),
    }  # fmt: skip
    actions = (0.02 * np.random.default_rng(0).random((copies, 12)) - 1.0).astype(np.float32)
    try:
        contestants = {
            name: Contestant(_stepper(env, actions), copies, own="native" in name)
            for name, env in envs.items()
        }
        return _compare(f"{copies} worlds, native batch", contestants, effort, threaded=True)
    finally:
        for env in envs.values():
            env.close()


def _stepper(env: Any, actions: Any) -> Callable[[], object]:
    env.reset(seed=0)
    return lambda: env.step(actions)


def _vmas(worlds: int) -> Callable[[], object]:
    import torch
    import vmas

    torch.set_num_threads(1)
    env = vmas.make_env("navigation", num_envs=worlds, device="cpu", continuous_actions=True, seed=0)
    env.reset()
    actions = [2.0 * torch.rand(worlds, 2) - 1.0 for _ in range(env.n_agents)]
    return lambda: env.step(actions)


def _basilisk() -> Callable[[], object]:
    """Orion as a Basilisk simulation, advanced by one control period at a call."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import spacecraft, thrusterDynamicEffector
    from Basilisk.utilities import SimulationBaseClass, macros, simIncludeGravBody, simIncludeThruster

    orion = load("orion")
    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", macros.sec2nano(1.0)))
    craft = spacecraft.Spacecraft()
    craft.hub.mHub, craft.hub.IHubPntBc_B = orion.mass, [list(row) for row in orion.inertia]
    bodies = simIncludeGravBody.gravBodyFactory()
    earth = bodies.createEarth()
    earth.isCentralBody = True
    bodies.addBodiesTo(craft)
    craft.hub.r_CN_NInit = [[6.9e6], [0.0], [0.0]]
    craft.hub.v_CN_NInit = [[0.0], [float(np.sqrt(earth.mu / 6.9e6))], [0.0]]
    thrusters, factory = (
        thrusterDynamicEffector.ThrusterDynamicEffector(),
        simIncludeThruster.thrusterFactory(),
    )
    for thruster in orion.thrusters:
        factory.create(
            "Blank_Thruster", list(thruster.position), list(thruster.direction), MaxThrust=thruster.thrust,
            steadyIsp=200.0, useMinPulseTime=False,
        )  # fmt: skip
    factory.addToSpacecraft("thrusters", thrusters, craft)
    simulation.AddModelToTask("task", craft, 2)
    simulation.AddModelToTask("task", thrusters, 1)
    command = messaging.THRArrayOnTimeCmdMsg()
    thrusters.cmdsInMsg.subscribeTo(command)
    simulation.InitializeSimulation()
    drawn = np.random.default_rng(0).random(12)
    pulses = [(orion.control_period * duties).tolist() for duties in (drawn, 1.0 - drawn)]
    periods = 0

    def step() -> object:
        nonlocal periods
        payload = messaging.THRArrayOnTimeCmdMsgPayload()
        payload.OnTimeRequest = pulses[periods % 2]
        command.write(payload, simulation.TotalSim.CurrentNanos)
        periods += 1
        simulation.ConfigureStopTime(macros.sec2nano(orion.control_period * periods))
        simulation.ExecuteSimulation()
        state = craft.scStateOutMsg.read()
        return state.r_BN_N, state.v_BN_N, state.sigma_BN, state.omega_BN_B

    # The messages live only as long as something in Python holds them.
    step.held = (bodies, factory, thrusters)  # type: ignore[attr-defined]
    return step
