"""How fast a formation on plasma thrusters flies, its pulses are made, and its fault networks are trained.

Measured: whole steps of ``formation_attitude_v1`` (three craft, all of them flown) and ``PulseDiagnosis-v0``,
whole missions from start to end, waveforms and thrusts of pulses, the training of a low-level network to the
source's criterion (Valdes 2008, section 4.3), and its filter. Not measured: compilation and construction.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from itertools import cycle
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks.environments import profile
from benchmarks.numpy_formation import NumpyFormation
from benchmarks.report import AtLeast, AtMost, Row, Section, number, version
from benchmarks.timing import Effort, Timing, announce, race
from thruster_envs.missions import attitude_of, fly_missions
from thruster_envs.physics.plasma_pulse import MU_0, pulse_thrust, pulse_waveforms
from thruster_envs.registration import register_all
from thruster_envs.spacecraft import Discharge, load
from thruster_envs.tasks import FormationAttitude

register_all()

TASK = "thruster_envs/FormationAttitude-v1"
PULSE_TASK = "thruster_envs/PulseDiagnosis-v0"
CRAFT = 3
TARGET = (20.0, 30.0, 40.0)  # roll, pitch and yaw, degrees
#: Errors of the samples that a low-level network is trained on, V and A, as in the reproductions.
VOLTAGE_ERROR, CURRENT_ERROR = 4.0, 60.0

ABOUT = """\
Three craft in every world: one follower takes random pulses, the leader and the other follower fly by the
compiled law. A craft-step is one control period of one craft, whoever commands it; a step is complete, with
observation, reward, info and the resets that fall due. *NumPy* is `benchmarks/numpy_formation.py`: the same
periods in plain NumPy, without infos, faults and resets. *Through SuperSuit* are copies of the PettingZoo
environment, one world each with both followers as agents, concatenated in one process. Missions last 3,000
periods of 1 s under the source's law, sensor noise included. A waveform is 3,001 samples of voltage,
current, position and velocity; SciPy's `solve_ivp` follows the same circuit by DOP853 to a relative error
of 1e-9. A low-level network (2-10-1) is trained with L-BFGS on twelve healthy pulses until the mean square
error is below 1e-4. Its filter is timed forwards and backwards on as much as its hidden layer is trained
with, beside a loop over the samples in Python."""


def measure(effort: Effort) -> Section:
    """The figures of this section."""
    rows = _steps(effort) + _through_supersuit(effort) + _missions(effort)
    rows += _pulses(effort) + _diagnosis(effort) + _networks(effort)
    return Section("Formation on plasma thrusters", ABOUT, rows)


def random_steps(env: Any) -> Callable[[], None]:
    """A step of a native batch after another, with actions drawn beforehand."""
    actions = _drawn(env)

    def step() -> None:
        env.step(next(actions))

    return step


def _drawn(env: Any) -> Iterator[Any]:
    """Actions drawn beforehand, over and over, for an environment that begins."""
    env.action_space.seed(0)
    env.reset(seed=0)
    return cycle([env.action_space.sample() for _ in range(64)])


def numpy_steps(worlds: int) -> Callable[[], object]:
    """The same in plain NumPy: one period after another of a healthy batch with one follower commanded."""
    targets = np.tile([1.0, 0.0, 0.0, 0.0], (worlds, CRAFT, 1))
    targets[:, 1:] = attitude_of(TARGET, degrees=True)
    plain = NumpyFormation(FormationAttitude(craft=CRAFT, commanded=1), targets)
    rng = np.random.default_rng(0)
    choices = rng.integers(0, 3, (64, worlds, 1, 3))
    return lambda: plain.step(choices[plain.steps % 64], rng)


def _steps(effort: Effort) -> list[Row]:
    many = 64 if effort.quick else 1024
    rows = []
    for worlds in (1, many):
        name = f"formation_attitude_v1, {worlds:,} world{'s' if worlds > 1 else ''}"
        works: dict[str, Callable[[], object]] = {
            "1 thread": random_steps(gym.make_vec(TASK, num_envs=worlds, threads=1, craft=CRAFT)),
            "NumPy": numpy_steps(worlds),
        }
        if worlds > 1:
            env = gym.make_vec(TASK, num_envs=worlds, threads=2, craft=CRAFT)
            works["2 threads"] = random_steps(env)
        times = race(works, effort, threaded=worlds > 1)
        for way, timing in times.items():
            compared = "NumPy" if way == "1 thread" else "1 thread"
            gain = number(timing.times_faster_than(times[compared]))
            target = AtLeast(1_000_000) if way == "2 threads" else None
            rows.append(
                Row(
                    f"{name}, {way}",
                    timing.per_second(CRAFT * worlds),
                    "craft-steps/s",
                    target,
                    ratio="" if way == "NumPy" else f"{gain} times {compared}",
                    explain=_explanation(works[way], effort),
                    charted=True,
                    own=way != "NumPy",
                )
            )
    return rows


def _explanation(work: Callable[[], object], effort: Effort) -> Callable[[], str]:
    return lambda: profile(work, 3 if effort.quick else 100)


def _through_supersuit(effort: Effort) -> list[Row]:
    name = "formation_attitude_v1, PettingZoo through SuperSuit"
    if importlib.util.find_spec("supersuit") is None:
        return [Row(name, None, "craft-steps/s", note="not installed (extra `bench`)")]
    import supersuit

    from thruster_envs import formation_attitude_v1

    copies = 2 if effort.quick else 8
    one = supersuit.pettingzoo_env_to_vec_env_v1(formation_attitude_v1.parallel_env(craft=CRAFT))
    many: Any = supersuit.concat_vec_envs_v1(one, copies, num_cpus=0, base_class="gymnasium")
    many.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, 3, (many.num_envs, 3))
    works: dict[str, Callable[[], object]] = {
        "SuperSuit": lambda: many.step(actions),
        "native": random_steps(gym.make_vec(TASK, num_envs=copies, threads=1, craft=CRAFT)),
    }
    times = race(works, effort)
    rate = times["SuperSuit"].per_second(CRAFT * copies)
    gain = times["native"].times_faster_than(times["SuperSuit"])
    return [
        Row(
            f"formation_attitude_v1, {copies} worlds, native batch",
            times["native"].per_second(CRAFT * copies), "craft-steps/s",
            ratio=f"{number(gain)} times SuperSuit", charted=True,
        ),
        Row(
            f"{name}, {copies} worlds", rate, "craft-steps/s", note=f"supersuit {version('supersuit')}",
            charted=True, own=False,
        ),
    ]  # fmt: skip


def _missions(effort: Effort) -> list[Row]:
    steps, batch = (50, 4) if effort.quick else (3000, 128)
    works: dict[str, Callable[[], object]] = {
        "one mission": lambda: fly_missions(TARGET, degrees=True, craft=CRAFT, steps=steps),
        "missions": lambda: fly_missions(TARGET, degrees=True, craft=CRAFT, steps=steps, seeds=range(batch)),
    }
    times = race(works, effort, threaded=True)
    one, many = times["one mission"], times["missions"]
    return [
        Row(
            f"mission of {CRAFT} craft, {steps:,} s", 1e3 * one.seconds, "ms", AtMost(50.0),
            explain=lambda: profile(works["one mission"], 2),
        ),
        Row(
            f"{batch} missions of {CRAFT} craft at once", many.per_second(batch), "missions/s",
            ratio=f"{number(many.times_faster_than(one, own=batch))} times one by one",
        ),
    ]  # fmt: skip


def _pulses(effort: Effort) -> list[Row]:
    from scipy.integrate import solve_ivp

    circuit = _circuit()
    count = 16 if effort.quick else 256
    masses = circuit.slug_mass * np.linspace(0.1, 1.0, count)
    rates, samples = circuit_rates(circuit), np.linspace(0.0, 30.0, 3001)
    times = race(
        {
            "waveforms": lambda: pulse_waveforms(circuit, slug_mass=masses),
            "thrusts": lambda: pulse_thrust(circuit, slug_mass=masses),
            "solve_ivp": lambda: solve_ivp(
                rates, (0.0, 30.0), np.zeros(4), "DOP853", samples, rtol=1e-9, atol=1e-9
            ),
        },
        effort,
    )
    gain = times["waveforms"].times_faster_than(times["solve_ivp"], own=count)
    return [
        Row(
            f"waveforms of {count} pulses", times["waveforms"].per_second(count), "pulses/s",
            ratio=f"{number(gain)} times SciPy's", charted=True,
        ),
        Row(f"thrusts of {count} pulses", times["thrusts"].per_second(count), "pulses/s", charted=True),
        Row(
            "waveform by SciPy's `solve_ivp`", times["solve_ivp"].per_second(1.0), "pulses/s", charted=True,
            own=False,
        ),
    ]  # fmt: skip


def circuit_rates(circuit: Discharge) -> Callable[[float, NDArray[np.float64]], list[float]]:
    """Rates of position, charge, velocity and current for SciPy, in us, mm, uC, mm/us and A."""
    gradient = MU_0 * circuit.electrode_gap / circuit.electrode_width

    def rates(_: float, state: NDArray[np.float64]) -> list[float]:
        x, q, u, i = state.tolist()
        push = 0.5e-9 * gradient / circuit.slug_mass * i * i
        drop = 1e-6 * q / circuit.capacitance + (1e3 * gradient * u + circuit.resistance) * i
        along = (circuit.voltage - drop) / (circuit.inductance + 1e-3 * gradient * x)
        return [u, i, push, 1e-6 * along]

    return rates


def _diagnosis(effort: Effort) -> list[Row]:
    worlds = 16 if effort.quick else 256
    works = {
        "single": _one_by_one(gym.make(PULSE_TASK)),
        "batch": random_steps(gym.make_vec(PULSE_TASK, num_envs=worlds, threads=1)),
    }
    times = race(works, effort)
    return [
        Row("PulseDiagnosis-v0, one world, `gym.make`", times["single"].per_second(1.0), "steps/s"),
        Row(
            f"PulseDiagnosis-v0, {worlds} worlds, 1 thread", times["batch"].per_second(worlds), "steps/s",
            ratio=f"{number(times['batch'].times_faster_than(times['single'], own=worlds))} times one world",
        ),
    ]  # fmt: skip


def _one_by_one(env: gym.Env[Any, Any]) -> Callable[[], None]:
    actions = _drawn(env)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(next(actions))
        if terminated or truncated:
            env.reset()

    return step


def _networks(effort: Effort) -> list[Row]:
    import torch

    from thruster_agents.dynamic_neurons import TrainingSettings
    from thruster_agents.dynamic_neurons.low_level import LowLevelClassifier, LowLevelSettings

    announce("training of low-level networks", effort)
    rng, circuit = np.random.default_rng(0), _circuit()
    waves = pulse_waveforms(circuit, voltage=rng.uniform(857.0, 977.0, 12))
    voltage = waves.voltage + VOLTAGE_ERROR * rng.standard_normal(waves.voltage.shape)
    current = waves.current + CURRENT_ERROR * rng.standard_normal(waves.current.shape)
    settings = TrainingSettings(stop=1.0 if effort.quick else 1e-4, iterations=400)

    def train(seed: int) -> Any:
        classifier = LowLevelClassifier(LowLevelSettings(), generator=torch.Generator().manual_seed(seed))
        return classifier.train(voltage, current, training=settings)

    records = [train(seed) for seed in range(effort.repetitions)]
    spent = Timing(tuple(record.seconds for record in records))
    reached = sum(record.reached for record in records)
    return [
        Row(
            "low-level network to a mean square error of 1e-4",
            spent.seconds,
            "s",
            AtMost(60.0),
            note=f"{reached} of {len(records)} seeds reach it within {settings.iterations} iterations; the "
            f"slowest takes {number(max(spent.rounds))} s",
            explain=lambda: profile(lambda: train(0), 1),
        ),
        *_filter_rows(effort),
    ]


def _filter_rows(effort: Effort) -> list[Row]:
    """The recursive filter of a hidden layer, as a low-level network is trained with, beside SciPy's."""
    import torch
    from scipy.signal import lfilter

    from thruster_agents.dynamic_neurons import recursive_filter

    rng, units, order = np.random.default_rng(0), 10, 2
    signal = torch.tensor(rng.standard_normal((8, 100 if effort.quick else 3000, units)))
    feedforward = torch.tensor(rng.standard_normal((units, order + 1)))
    feedback = torch.tensor(rng.random((units, order)) / (2.0 * order))
    trained = [one.clone().requires_grad_() for one in (signal, feedforward, feedback)]

    def scipys() -> None:
        for unit in range(units):
            lfilter(feedforward[unit].numpy(), [1.0, *feedback[unit]], signal[..., unit].numpy(), axis=1)

    def both_ways() -> None:
        torch.autograd.grad(recursive_filter(*trained).square().sum(), trained)

    times = race(
        {"ours": lambda: recursive_filter(signal, feedforward, feedback), "scipy": scipys, "both": both_ways},
        effort,
    )
    ratio = times["ours"].times_faster_than(times["scipy"])
    return [
        Row(
            "filter of a dynamic layer, forwards", 1e3 * times["ours"].seconds, "ms",
            ratio=f"{ratio:.2f} times scipy.signal.lfilter",
        ),
        Row("filter of a dynamic layer, scipy.signal.lfilter", 1e3 * times["scipy"].seconds, "ms", own=False),
        Row("filter of a dynamic layer, forwards and back", 1e3 * times["both"].seconds, "ms"),
    ]  # fmt: skip


def _circuit() -> Discharge:
    circuit = load("ppt_cubesat").discharge
    assert circuit is not None
    return circuit
