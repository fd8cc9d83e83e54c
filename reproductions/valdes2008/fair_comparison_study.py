"""The missions of the fair comparison, and the methods that judge them.

Follower 1 turns to an attitude drawn from roll 20 to 35, pitch 30 to 50, yaw 40 to 60 degrees, which no
method has seen. One of its six thrusters fails by one of the three causes, at once (17 to 30 % of thrust) or
growing (to 20 to 40 %), from a moment in the first 100 s on; each mission has a paired fault-free run, with
the same attitude and sensor errors. A pulse is faulty if its thrust, without errors, is out of the band of 15
%. Thresholds come from validation seeds, networks from training seeds, judgements from test seeds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import torch

from reproductions.record import Effort
from reproductions.valdes2008.high_level_study import FOLLOWER, high_level
from reproductions.valdes2008.integrated_study import integrated
from reproductions.valdes2008.low_level_study import CLOSE, HEALTHY_PULSES, STOP, VOLTAGES, seeds_of, trained
from reproductions.valdes2008.study import (
    CIRCUIT,
    CUBESAT,
    CURRENT_ERROR,
    FAULT_CASES,
    VOLTAGE_ERROR,
    measured,
    out_of_band,
    thrust_of,
)
from thruster_agents.dynamic_neurons import Architecture, TrainingSettings
from thruster_agents.dynamic_neurons.high_level import MissionSignals
from thruster_agents.dynamic_neurons.low_level import LowLevelClassifier, LowLevelSettings
from thruster_agents.dynamic_neurons.training import one_thread
from thruster_agents.pulse_networks import PulseNetwork, PulseNetworkSettings, WaveformScores
from thruster_baselines.detection import threshold_for_rate
from thruster_baselines.detection.pulses import (
    MotionFit,
    PulseCountCUSUM,
    PulseFit,
    PulseResidual,
    absolute_motion,
)
from thruster_envs.faults import Fault
from thruster_envs.missions import Missions, fly_missions
from thruster_envs.physics.health import pulse_of
from thruster_envs.physics.plasma_pulse import pulse_waveforms
from thruster_envs.protocols import BoolArray, FloatArray, IntArray
from thruster_envs.seeds import TEST, TRAIN, VALIDATION

_LOW, _HIGH = (20.0, 30.0, 40.0), (35.0, 50.0, 60.0)  # roll, pitch and yaw, degrees
_STEP, _RAMP = (0.17, 0.30), (0.20, 0.40)  # change of thrust
_ONSET, _GROWTH = (0.0, 100.0), (100.0, 1000.0)  # s
_TOGETHER = 100  # missions in the memory at the same time
_RATE_ERROR = float(np.sqrt(2.0) * CUBESAT.sensors.rate)  # the follower's and the leader's
_HOLDING = 1000  # s, when the attitude is held
_SEEN_PULSES = 6000  # that a network with faults is trained on
_SCORES = 8
_GRU_STRIDE = 30

FORMS = tuple((case, growing) for case in FAULT_CASES for growing in (False, True))
"""Fault case, and whether it grows."""

Said: TypeAlias = dict[str, list[list[BoolArray]]]
"""By method: for each seed and mission, which firings are declared faulty."""


@dataclass(frozen=True)
class Plan:
    """How much is flown."""

    forms: int  # so many of the 36 pairs of thruster and form of fault; each with a fault-free run
    healthy: int  # healthy missions for thresholds, and as many for rates of false alarms
    seeds: int  # training runs of each network
    rate: float  # of false alarms that thresholds of whole missions are set to


@dataclass(frozen=True)
class Mission:
    """What is known of one mission of follower 1."""

    signals: MissionSignals  # as the networks take them
    attitude: FloatArray  # (periods + 1, 4), inertial, as measured
    rate: FloatArray  # (periods + 1, 3), rad/s, likewise
    step: IntArray  # (firings,), period from 0
    thruster: IntArray  # (firings,), from 0
    parameters: dict[str, FloatArray]  # of the pulses, as `pulse_waveforms` takes them
    faulty: BoolArray  # (firings,), whether the thrust is out of the band
    failing: int  # thruster that fails, from 0; -1 in a healthy one
    form: tuple[int, bool] | None  # fault case and whether it grows; None in a healthy one


def plan_of(effort: Effort) -> Plan:
    """At full effort all 36, 400 healthy missions, ten seeds, and one false alarm in a hundred missions."""
    whole = min(1.0, effort.flights / 100)
    healthy = max(8, round(400 * whole))
    return Plan(max(1, round(36 * whole)), healthy, seeds_of(effort), 0.01 if healthy >= 300 else 0.5)


def severity_of(case: int, change: float) -> float:
    """The severity at which a cause has changed the thrust by this share."""
    kind = FAULT_CASES[case]
    severities, changes = _changes(kind)
    return float(np.interp(change, changes, severities))


@cache
def _changes(kind: str) -> tuple[FloatArray, FloatArray]:
    """Severities, and by how much they change the thrust, never falling."""
    largest = {"propellant_loss": 0.985, "electrode_sediment": 0.45, "conductivity_loss": 0.05}[kind]
    severities = np.linspace(0.0, largest, 2000)
    return severities, np.maximum.accumulate(np.abs(thrust_of(**changed(kind, severities)) - 1.0))


def changed(kind: str, severity: FloatArray | float) -> dict[str, FloatArray]:
    """Arguments of `pulse_waveforms` for a cause of this severity."""
    mass, width, resistance = pulse_of(kind, np.asarray(severity))
    nominal = {
        "slug_mass": CIRCUIT.slug_mass * mass,
        "electrode_width": CIRCUIT.electrode_width * width,
        "added_resistance": resistance,
    }
    return {name: value for name, value in nominal.items() if isinstance(value, np.ndarray | np.floating)}


def _targets(rng: np.random.Generator, count: int) -> FloatArray:
    return rng.uniform(_LOW, _HIGH, (count, 3))[:, np.newaxis]


@cache
def test_missions(forms: int) -> tuple[Mission, ...]:
    """The faulty ones, then their fault-free runs."""
    rng = np.random.default_rng(TEST.start + 100)
    cases = [(thruster, form) for thruster in range(6) for form in FORMS]
    cases = [cases[k] for k in rng.permutation(len(cases))[:forms]]
    targets, faults = _targets(rng, forms), []
    for thruster, (case, growing) in cases:
        fault = Fault(
            thruster + 1, FAULT_CASES[case], craft=FOLLOWER + 1, onset=float(rng.uniform(*_ONSET)),
            severity=severity_of(case, rng.uniform(*(_RAMP if growing else _STEP))),
        )  # fmt: skip
        if growing:
            length = float(rng.uniform(*_GROWTH))
            fault = dataclasses.replace(fault, profile="ramp", profile_time=length)
        faults.append([fault])
    seeds = range(TEST.start + 1000, TEST.start + 1000 + forms)
    flying: dict[str, Any] = {"degrees": True, "craft": 2, "seeds": seeds}
    found = _missions(fly_missions(targets, faults=faults, **flying), cases)
    return (*found, *_missions(fly_missions(targets, **flying), [(-1, None)] * forms))


def healthy_missions(count: int, seeds: range) -> list[Mission]:
    """So many healthy missions with their own attitudes, with the first of these seeds."""
    rng = np.random.default_rng(seeds.start + 101)
    found: list[Mission] = []
    for first in range(0, count, _TOGETHER):
        number = min(_TOGETHER, count - first)
        begin = seeds.start + 5000 + first
        flown = fly_missions(_targets(rng, number), degrees=True, craft=2, seeds=range(begin, begin + number))
        found += _missions(flown, [(-1, None)] * number)
    return found


def _missions(flown: Missions, cases: list[Any]) -> list[Mission]:
    signals = MissionSignals.of(flown, FOLLOWER)
    attitude, rate = absolute_motion(
        flown.measured_attitude[:, :, FOLLOWER], flown.measured_rate[:, :, FOLLOWER],
        flown.measured_attitude[:, :, 0], flown.measured_rate[:, :, 0],
    )  # fmt: skip
    missions = []
    for number, (failing, form) in enumerate(cases):
        fired = flown.discharges(number, FOLLOWER)
        missions.append(
            Mission(
                signals[[number]], attitude[number], rate[number], fired.step, fired.thruster - 1,
                fired.parameters(), out_of_band(fired.thrust), failing, form,
            )
        )  # fmt: skip
    return missions


class Pulses(NamedTuple):
    """What is measured of the pulses of a mission: waveforms, and their scores for the networks."""

    voltage: FloatArray
    current: FloatArray
    scores: FloatArray


Judge: TypeAlias = Callable[[Mission, Pulses], BoolArray]


@cache
def scores() -> WaveformScores:
    """Of pulses of every cause."""
    rng = np.random.default_rng(TRAIN.start + 102)
    parameters, _ = drawn_pulses(rng, 600)
    return WaveformScores.of(*measured(rng, **parameters), (VOLTAGE_ERROR, CURRENT_ERROR), _SCORES)


def drawn_pulses(rng: np.random.Generator, count: int) -> tuple[dict[str, FloatArray], FloatArray]:
    """Pulses of any cause or none, at any charge voltage; and log thrust for either cause, and the true one.

    Half of the failing ones have a change of thrust that is evenly distributed, half a severity that is.
    """
    case = rng.integers(0, 4, count)
    parameters = {"slug_mass": np.full(count, CIRCUIT.slug_mass),
                  "electrode_width": np.full(count, CIRCUIT.electrode_width),
                  "added_resistance": np.zeros(count)}  # fmt: skip
    for number, kind in FAULT_CASES.items():
        own = np.flatnonzero(case == number)
        severities, changes = _changes(kind)
        largest = np.interp(0.45, changes, severities)
        drawn = np.where(
            rng.random(own.size) < 0.5,
            np.interp(rng.uniform(0.0, 0.45, own.size), changes, severities),
            rng.uniform(0.0, largest, own.size),
        )
        for name, values in changed(kind, drawn).items():
            parameters[name][own] = values
    parameters["voltage"] = rng.uniform(*VOLTAGES, count)
    impulse = (CIRCUIT.electrode_width / parameters["electrode_width"]) ** 2
    impulse *= CIRCUIT.slug_mass / parameters["slug_mass"]
    rest = {name: parameters[name] for name in ("added_resistance", "voltage")}
    by_mass = thrust_of(slug_mass=CIRCUIT.slug_mass / impulse, **rest)
    by_width = thrust_of(electrode_width=CIRCUIT.electrode_width / np.sqrt(impulse), **rest)
    return parameters, np.log(np.stack((by_mass, by_width, thrust_of(**parameters)), axis=1))


@cache
def pulse_networks(seeds: int, asked: str) -> tuple[PulseNetwork, ...]:
    """Trained on other pulses each."""
    found = []
    for seed in range(seeds):
        rng = np.random.default_rng(TRAIN.start + 103 + seed)
        parameters, log_thrust = drawn_pulses(rng, _SEEN_PULSES)
        seen = np.concatenate(
            [scores()(*measured(rng, **{name: part[k : k + 500] for name, part in parameters.items()}))
             for k in range(0, _SEEN_PULSES, 500)]
        )  # fmt: skip
        settings = PulseNetworkSettings(asked=asked)  # type: ignore[arg-type]
        one = PulseNetwork(_SCORES, settings, generator=torch.Generator().manual_seed(seed))
        answers = log_thrust[:, :2] if asked == "thrust" else out_of_band(np.exp(log_thrust[:, 2]))
        one.train(seen, np.asarray(answers, dtype=np.float64))
        found.append(one)
    return tuple(found)


@cache
def _low_levels(kind: str, seeds: int) -> tuple[LowLevelClassifier, ...]:
    """The other networks in the place of the dynamic one: static, or a recurrent unit."""
    if kind == "static":
        settings = LowLevelSettings(architecture=Architecture(kind="static"))
    else:
        settings = LowLevelSettings(
            inputs="charge_voltage", stride=_GRU_STRIDE, architecture=Architecture(kind="gru", hidden=(4,))
        )
    voltages = np.linspace(*VOLTAGES, HEALTHY_PULSES)
    healthy = measured(np.random.default_rng(VALIDATION.start + 46), voltage=voltages)
    found = []
    for seed in range(seeds):
        rng = np.random.default_rng(TRAIN.start + seed)
        pulses = measured(rng, voltage=rng.uniform(*VOLTAGES, 12))
        one = LowLevelClassifier(settings, generator=torch.Generator().manual_seed(seed))
        one.train(*pulses, training=TrainingSettings(stop=CLOSE, iterations=150))
        one.calibrate(*healthy)
        found.append(one)
    return tuple(found)


@cache
def fit() -> PulseFit:
    """The circuit."""
    return PulseFit(CIRCUIT, VOLTAGE_ERROR, CURRENT_ERROR)


@cache
def motion() -> MotionFit:
    """The craft."""
    return MotionFit(CUBESAT, _RATE_ERROR)


@cache
def _residual(rate: float) -> PulseResidual:
    """With a threshold that healthy pulses exceed once in ten thousand times, at any charge voltage."""
    count = 40_000 if rate < 0.1 else 10
    rng = np.random.default_rng(VALIDATION.start + 104)
    test = PulseResidual(fit(), 1.0)
    residuals = np.concatenate(
        [test.residual(*measured(rng, voltage=rng.uniform(*VOLTAGES, min(500, count))))
         for _ in range(0, count, 500)]
    )  # fmt: skip
    wanted = 1e-4 if rate < 0.1 else 0.5
    return PulseResidual(fit(), threshold_for_rate(residuals, wanted).threshold)


@dataclass(frozen=True)
class MissionThresholds:
    """What whole missions are judged with, from healthy ones of the validation seeds."""

    counts: PulseCountCUSUM  # cumulative sums of pulse counts
    share: float  # of the largest deviation of a thruster's share from one, in its standard deviations
    networks: tuple[FloatArray, ...]  # for each seed, of the residuals of roll, pitch and yaw


@cache
def _mission_thresholds(plan: Plan) -> MissionThresholds:
    missions = healthy_missions(plan.healthy, VALIDATION)
    pulses = np.concatenate([one.signals.pulses for one in missions])
    counts = PulseCountCUSUM.calibrated(pulses, _HOLDING, plan.rate, change=0.01)
    shares = np.array([_share_statistic(one).max() for one in missions])
    signals = [one.signals for one in missions]
    networks = []
    for run in high_level(plan.seeds):
        residuals = np.concatenate([run.classifier.residuals(one) for one in signals])
        networks.append(np.array([threshold_for_rate(column, plan.rate).threshold for column in residuals.T]))
    return MissionThresholds(counts, threshold_for_rate(shares, plan.rate).threshold, tuple(networks))


def _share_statistic(mission: Mission) -> FloatArray:
    """(6,): how far each thruster's share is from one, in standard deviations."""
    found = motion()(mission.attitude[np.newaxis], mission.rate[np.newaxis], mission.signals.pulses)
    return np.asarray(np.abs(found.share - 1.0) / found.deviation)[0]


def faulty_with_motion(mission: Mission, by_mass: FloatArray, by_width: FloatArray) -> BoolArray:
    """(firings,): out of the band by the thrust of that cause which the motion speaks for."""
    mass, width = out_of_band(by_mass), out_of_band(by_width)
    if np.array_equal(mass, width):
        return mass
    answer = motion().width_changed(
        mission.attitude, mission.rate, mission.signals.pulses[0], (mission.step, mission.thruster),
        by_mass, by_width,
    )  # fmt: skip
    return np.where(answer[mission.thruster], width, mass)


def methods(plan: Plan) -> dict[str, list[Judge]]:
    """By name: a judge for each seed, or one."""
    limits = _mission_thresholds(plan)
    residual = _residual(plan.rate)

    def low(classifier: LowLevelClassifier) -> Judge:
        return lambda _, pulses: classifier.declare(pulses.voltage, pulses.current)

    def high(seed: int, thresholds: FloatArray) -> Judge:
        classifier = high_level(plan.seeds)[seed].classifier
        return lambda mission, _: (classifier.residuals(mission.signals)[0] > thresholds)[
            mission.thruster // 2
        ]

    def both(seed: int) -> Judge:
        scheme = integrated(plan.seeds)[seed]
        return lambda mission, pulses: (
            scheme.diagnose(
                mission.signals,
                mission.thruster,
                lambda which: (pulses.voltage[which], pulses.current[which]),
            ).faulty
        )

    def by_network(network: PulseNetwork) -> Judge:
        return lambda mission, pulses: faulty_with_motion(mission, *network.predict(pulses.scores).T)

    def health(network: PulseNetwork) -> Judge:
        return lambda _, pulses: network.predict(pulses.scores) > 0.5

    def circuit(mission: Mission, pulses: Pulses) -> BoolArray:
        return fit()(pulses.voltage, pulses.current).faulty()

    def circuit_and_motion(mission: Mission, pulses: Pulses) -> BoolArray:
        estimate = fit()(pulses.voltage, pulses.current)
        return faulty_with_motion(mission, estimate.thrust_if_mass, estimate.thrust_if_width)

    def counts(mission: Mission, pulses: Pulses) -> BoolArray:
        said = limits.counts(mission.signals.pulses)
        pair = mission.thruster // 2
        return said.flagged[0, pair] & (mission.step >= said.first[0, pair])

    def shares(mission: Mission, pulses: Pulses) -> BoolArray:
        return (_share_statistic(mission) > limits.share)[mission.thruster]

    runs = range(plan.seeds)
    return {
        "always healthy": [lambda mission, _: np.zeros(mission.faulty.shape, dtype=np.bool_)],
        "always faulty": [lambda mission, _: np.ones(mission.faulty.shape, dtype=np.bool_)],
        "low level, as the source stops": [low(one.classifier) for one in trained(STOP, plan.seeds)],
        "low level, trained on": [low(one.classifier) for one in trained(CLOSE, plan.seeds)],
        "static network": [low(one) for one in _low_levels("static", plan.seeds)],
        "recurrent unit (GRU)": [low(one) for one in _low_levels("gru", plan.seeds)],
        "high level": [high(seed, high_level(plan.seeds)[seed].thresholds) for seed in runs],
        "high level, thresholds of 400 missions": [high(seed, limits.networks[seed]) for seed in runs],
        "integrated": [both(seed) for seed in runs],
        "residual of the physical pulse": [lambda _, pulses: residual(pulses.voltage, pulses.current)],
        "cumulative sums of pulse counts": [counts],
        "thrust by the motion": [shares],
        "circuit fitted": [circuit],
        "circuit fitted, and motion": [circuit_and_motion],
        "network of waveforms": [health(one) for one in pulse_networks(plan.seeds, "health")],
        "network of waveforms, and motion": [by_network(one) for one in pulse_networks(plan.seeds, "thrust")],
    }


LEARNED = (
    "low level, as the source stops",
    "low level, trained on",
    "static network",
    "recurrent unit (GRU)",
    "high level",
    "high level, thresholds of 400 missions",
    "integrated",
    "network of waveforms",
    "network of waveforms, and motion",
)
"""Methods of which there are as many as seeds."""


@cache
def judge(plan: Plan) -> Said:
    """What every method says of every firing of the test missions."""
    with one_thread():
        return _judge(plan)


def _judge(plan: Plan) -> Said:
    judges = methods(plan)
    said: Said = {name: [[] for _ in those] for name, those in judges.items()}
    for number, mission in enumerate(test_missions(plan.forms)):
        rng = np.random.default_rng(TEST.start + 20_000 + number)
        voltage, current = measured(rng, **mission.parameters)
        pulses = Pulses(voltage, current, scores()(voltage, current))
        for name, those in judges.items():
            for seed, one in enumerate(those):
                said[name][seed].append(np.asarray(one(mission, pulses), dtype=np.bool_))
    return said


@cache
def further_false_alarms(plan: Plan) -> dict[str, list[int]]:
    """Of further healthy missions: in how many the two best methods alarm, for each seed.

    A healthy pulse at the nominal charge voltage is always the same but for its errors, and these are white:
    so its scores are drawn directly, as are its coordinates in the directions of the library.
    """
    missions = healthy_missions(plan.healthy, TEST)
    networks = pulse_networks(plan.seeds, "thrust")
    exact = measured_without_errors()
    nominal = scores()(*exact)[0]
    coordinates = fit().library.project(*exact)[0]
    alarms = {"circuit fitted, and motion": [0], "network of waveforms, and motion": [0] * plan.seeds}
    for number, mission in enumerate(missions):
        rng = np.random.default_rng(TEST.start + 40_000 + number)
        firings = mission.thruster.size
        estimate = fit().of_projections(coordinates + rng.standard_normal((firings, coordinates.size)))
        alarms["circuit fitted, and motion"][0] += bool(
            faulty_with_motion(mission, estimate.thrust_if_mass, estimate.thrust_if_width).any()
        )
        seen = nominal + rng.standard_normal((firings, nominal.size))
        for seed, network in enumerate(networks):
            alarms["network of waveforms, and motion"][seed] += bool(
                faulty_with_motion(mission, *network.predict(seen).T).any()
            )
    return alarms


def measured_without_errors() -> tuple[FloatArray, FloatArray]:
    """Voltage and current (1, samples) of a healthy pulse at the nominal charge voltage."""
    waves = pulse_waveforms(CIRCUIT, voltage=[CIRCUIT.voltage])
    return waves.voltage, waves.current
