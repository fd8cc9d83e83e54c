"""Diagnosis of single pulses as a task: see a discharge, and say whether its thruster has failed and how.

Models one pulsed plasma thruster that fires once in each control period while it degrades (Valdes 2008,
chapter 4). The agent sees the voltage and the current of the last pulse, sampled with noise, and declares
whether that pulse was healthy or which fault it had. A pulse is faulty if its true thrust is off the nominal
one by more than a band. The charge varies from pulse to pulse. Leaves out the craft: it does not move.

Voltage and current depend on the kick and the damping of a pulse alone (see
:mod:`thruster_envs.physics.plasma_pulse`), and a light slug kicks as narrow electrodes do. So one pulse by
itself tells resistance, but not mass from width: that takes how severe a fault is likely to be, how it has
grown, or a measured thrust.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thruster_envs.faults import DISCHARGE_KINDS, FULL_SCALE, Fault, FaultDistribution
from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import columns_of, opener, place
from thruster_envs.physics.fleet import Fleet
from thruster_envs.physics.health import pulse_shares
from thruster_envs.physics.plasma_pulse import (
    PulseMap,
    map_place,
    pulse_ratio,
    pulse_waveforms,
    tabulate_pulses,
)
from thruster_envs.random import COMMAND, STEP, normal_pair, philox, uniform_pair
from thruster_envs.spacecraft import Discharge
from thruster_envs.tasks.access import bounded
from thruster_envs.tasks.contract import (
    EpisodeState,
    FloatArray,
    Observations,
    Outcome,
    Task,
    Truth,
    check_not_negative,
    check_whole,
)
from thruster_envs.tasks.pictures import Frame, Picture, Trace, drawable, fuel_and_score

#: Pulses of an episode.
PULSES = 64
#: What can be declared: a healthy pulse, or one with a fault of this kind.
CASES: tuple[str, ...] = ("healthy", *DISCHARGE_KINDS)
#: Half of the credit for a faulty pulse is for calling it so, the rest for naming the fault.
_HALF_RIGHT = 0.5
_BOUND = 2.0
_THRUST_BOUND = 4.0


class Parameters(NamedTuple):
    """The configuration in numbers.

    Attributes:
        period: Control period, s.
        thruster: The one that fires, from 0.
        firing_time: Of a discharge, s.
        band: How far the thrust of a healthy pulse may be off the nominal one, as a share.
        jitter: Half-width of the scatter of the charge, as a share.
        resistance: Of the circuit, ohm.
        voltage_noise: Standard deviation of a sample, in shares of the nominal charge.
        current_noise: The same, in shares of the nominal peak current.
        thrust_noise: The same, in shares of the nominal thrust.
        right_worth: Of a pulse that is called what it is.
        delay_cost: Of a faulty pulse that is called healthy.
        false_alarm_cost: Of a healthy pulse that is called faulty.
        wrong_name_cost: Of a faulty pulse that is given the wrong fault.
    """

    period: float
    thruster: float
    firing_time: float
    band: float
    jitter: float
    resistance: float
    voltage_noise: float
    current_noise: float
    thrust_noise: float
    right_worth: float
    delay_cost: float
    false_alarm_cost: float
    wrong_name_cost: float


class Statistics(NamedTuple):
    """Episode statistics, (worlds,) each.

    Attributes:
        right: Term of the reward of the last step, and the next three likewise.
        delay: Likewise.
        false_alarm: Likewise.
        wrong_name: Likewise.
        healthy_pulses: Healthy pulses so far.
        faulty_pulses: Faulty pulses so far.
        false_pulses: Healthy pulses that were called faulty.
        credit: Sum of the credit for declarations.
        onset: Time of the first faulty pulse, s; -1 for not yet.
        noticed: Time from then until one was called faulty, s; -1 for not yet.
    """

    right: FloatArray
    delay: FloatArray
    false_alarm: FloatArray
    wrong_name: FloatArray
    healthy_pulses: FloatArray
    faulty_pulses: FloatArray
    false_pulses: FloatArray
    credit: FloatArray
    onset: FloatArray
    noticed: FloatArray


class PulseTruth(NamedTuple):
    """What is true of the last pulse, (worlds,) each.

    Attributes:
        mass: Share of the nominal slug mass.
        width: Share of the nominal electrode width.
        added: Added resistance, ohm.
        charge: Share of the nominal voltage.
        ratio: Thrust over the nominal one.
    """

    mass: FloatArray
    width: FloatArray
    added: FloatArray
    charge: FloatArray
    ratio: FloatArray


_parameters, _statistics = opener(Parameters), opener(Statistics, columns=True)
_pulse_truth = opener(PulseTruth, columns=True)


@dataclass(frozen=True)
class PulseModel:
    """The configuration in arrays.

    Attributes:
        parameters: As :class:`Parameters` names them.
        capacitors: (n,), the capacitor of each thruster.
        logarithms: The table of a :class:`~thruster_envs.physics.plasma_pulse.PulseMap`.
        waveforms: (kicks, dampings, 2 * samples), voltage and then current at the nodes of the map, in units
            of the observation at the nominal charge.
    """

    parameters: FloatArray
    capacitors: NDArray[np.int64]
    logarithms: FloatArray
    waveforms: FloatArray


@dataclass
class PulseState(EpisodeState[Statistics]):
    """Arrays of a batch."""

    model: PulseModel
    measured: FloatArray  # (worlds, 2 * samples + 1), voltage, current, thrust, in units of the observation
    pulse: FloatArray  # (worlds, 5), the truth about it, as PulseTruth names its columns
    case: NDArray[np.int64]  # (worlds,), what would be right to declare
    declared: NDArray[np.int64]  # (worlds,), the last declaration
    none: FloatArray  # (worlds,), zeros: there is no cost, and no end but the time limit
    names = Statistics

    @cached_property
    def truth(self) -> PulseTruth:
        """Views of the truth about the last pulse by name."""
        return columns_of(PulseTruth, self.pulse)


@dataclass(frozen=True, kw_only=True)
class PulseDiagnosis(Task):
    """Configuration of ``PulseDiagnosis-v0``.

    ``faults`` None means the default distribution, an empty list no faults. ``nonlinear`` and ``max_substep``
    have no effect, since nothing flies.

    Attributes:
        thruster: Number of the one that fires, from 1.
        samples: Of voltage and of current that a pulse is seen by.
        sample_spacing: Time from one sample to the next, s; the first is at the beginning of the pulse.
        voltage_noise: Standard deviation of a sample, V.
        current_noise: The same, A.
        thrust_noise: Standard deviation of a measured thrust, N.
        observe_thrust: Whether the thrust is measured, as on a test stand.
        voltage_jitter: Half-width of the uniform scatter of the charge from pulse to pulse, as a share.
        band: How far the thrust of a healthy pulse may be off the nominal one, as a share.
        right_worth: What it is worth to call all pulses of an episode what they are.
        delay_cost: What it costs to call a faulty pulse healthy, all through an episode.
        false_alarm_cost: What it costs to call a healthy pulse faulty, likewise.
        wrong_name_cost: What it costs to give a faulty pulse the wrong fault, likewise.
    """

    spacecraft: Any = "ppt_cubesat"
    thruster: int = 1
    samples: int = 64
    sample_spacing: float = 2e-7
    voltage_noise: float = 4.0
    current_noise: float = 60.0
    thrust_noise: float = 8e-7
    observe_thrust: bool = False
    voltage_jitter: float = 0.02
    band: float = 0.15
    right_worth: float = 1.0
    delay_cost: float = 1.0
    false_alarm_cost: float = 2.0
    wrong_name_cost: float = 0.5

    reward_terms: ClassVar[tuple[str, ...]] = ("right", "delay", "false_alarm", "wrong_name")
    max_episode_steps: ClassVar[int | None] = PULSES
    flies: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        discharge = self.vehicle.discharge
        if discharge is None:
            raise ValueError(
                f"the spacecraft {self.vehicle.name!r} has no discharge; one that has, like 'ppt_cubesat', "
                "would be right"
            )
        check_whole("thruster", self.thruster, 1, self.vehicle.number_of_thrusters)
        check_whole("samples", self.samples, 2, discharge.number_of_samples)
        every = min(max(self.sample_spacing / discharge.sample_time, 0.0), discharge.number_of_samples + 0.5)
        longest = (discharge.number_of_samples - 1) // (self.samples - 1)
        if not (1.0 <= round(every) <= longest and abs(every - round(every)) < 1e-6 * every):
            raise ValueError(
                f"sample_spacing is {self.sample_spacing!r} s; a multiple of {discharge.sample_time:g} s "
                f"up to {longest * discharge.sample_time:g} s, the end of the pulse, would be right"
            )
        check_not_negative(
            self, "voltage_noise", "current_noise", "thrust_noise", "right_worth", "delay_cost",
            "false_alarm_cost", "wrong_name_cost",
        )  # fmt: skip
        if not 0.0 < self.band < 1.0:
            raise ValueError(f"band is {self.band!r}; a share above 0 and below 1 would be right")
        most = math.sqrt(1.0 + self.band) - 1.0
        if not 0.0 <= self.voltage_jitter < most:
            raise ValueError(
                f"voltage_jitter is {self.voltage_jitter!r}; a share from 0 to below {most:.4f}, so that the "
                "charge alone makes no pulse faulty, would be right"
            )

    @property
    def discharge(self) -> Discharge:
        """The circuit of the vehicle."""
        assert self.vehicle.discharge is not None  # refused otherwise
        return self.vehicle.discharge

    @cached_property
    def sample_numbers(self) -> NDArray[np.int64]:
        """(samples,), which samples of a pulse's waveform are seen."""
        return np.arange(self.samples) * round(self.sample_spacing / self.discharge.sample_time)

    @cached_property
    def choices(self) -> tuple[int, ...] | None:
        """What the last pulse was, by its place in ``CASES``."""
        return (len(CASES),)

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """See the environment's docstring."""
        discharge = self.discharge
        thrust = (
            Field("thrust", "measured thrust", 1, bound=_THRUST_BOUND, lowest=-1.0, **self._per_thrust()),
        )
        return (
            Field(
                "voltage",
                "measured voltage of the capacitor",
                self.samples,
                "V",
                discharge.voltage,
                reference="nominal charge",
                bound=_BOUND,
            ),
            Field(
                "current",
                "measured discharge current",
                self.samples,
                "A",
                peak_current(discharge),
                reference="nominal peak current",
                bound=_BOUND,
            ),
            Field(
                "time",
                "time since the start",
                1,
                "s",
                PULSES * self.vehicle.control_period,
                reference="length of the episode",
                lowest=0.0,
            ),
            Field("declared", "whether each fault was declared last", len(CASES) - 1, lowest=0.0),
            *(thrust if self.observe_thrust else ()),
            *self.oracle_fields(),
        )

    def _per_thrust(self) -> dict[str, Any]:
        thrust = self.vehicle.thrusters[self.thruster - 1].thrust
        return {"unit": "N", "scale": thrust, "reference": "nominal thrust"}

    def oracle_fields(self) -> tuple[Field, ...]:
        """The truth about the pulse, where it was asked for."""
        if not self.observe_fault:
            return ()
        discharge = self.discharge
        return (
            Field("true_thrust", "true thrust", 1, bound=_THRUST_BOUND, lowest=0.0, **self._per_thrust()),
            Field(
                "true_slug_mass",
                "true mass of the slug",
                1,
                "kg",
                discharge.slug_mass,
                reference="nominal mass",
                lowest=0.0,
            ),
            Field(
                "true_width",
                "true width of the electrodes",
                1,
                "m",
                discharge.electrode_width,
                reference="nominal width",
                lowest=0.0,
            ),
            Field(
                "true_added_resistance",
                "true added resistance",
                1,
                "ohm",
                FULL_SCALE["conductivity_loss"],
                bound=10.0,
                lowest=0.0,
            ),
        )

    def default_faults(self) -> tuple[Fault, ...] | FaultDistribution:
        """In four episodes of five, one fault of the discharge that begins in the first half.

        It begins at once or grows, and does not always make the pulses faulty.
        """
        return FaultDistribution(
            probability=0.8,
            kinds=DISCHARGE_KINDS,
            severity={
                "propellant_loss": (0.85, 0.99),
                "electrode_sediment": (0.05, 0.6),
                "conductivity_loss": (0.004, 0.03),
            },
            onset=(0.0, 0.5 * PULSES * self.vehicle.control_period),
            profiles=("step", "ramp"),
            profile_time=(10.0, 40.0),
            thrusters=(self.thruster,),
        )

    def create(self, worlds: int, threads: int | None) -> PulseState:
        """Arrays for that many worlds."""
        fleet = Fleet(
            self.vehicle, worlds, slots=self.fault_slots, threads=threads, kinds=DISCHARGE_KINDS, sensors=()
        )
        return PulseState(
            fleet,
            np.zeros((worlds, len(Statistics._fields))),
            self._model(),
            measured=np.zeros((worlds, 2 * self.samples + 1)),
            pulse=np.zeros((worlds, len(PulseTruth._fields))),
            case=np.zeros(worlds, np.int64),
            declared=np.zeros(worlds, np.int64),
            none=np.zeros(worlds),
        )

    def _model(self) -> PulseModel:
        vehicle, discharge = self.vehicle, self.discharge
        nominal = vehicle.thrusters[self.thruster - 1].thrust
        parameters = Parameters(
            period=vehicle.control_period,
            thruster=self.thruster - 1.0,
            firing_time=discharge.firing_time,
            band=self.band,
            jitter=self.voltage_jitter,
            resistance=discharge.resistance,
            voltage_noise=self.voltage_noise / discharge.voltage,
            current_noise=self.current_noise / peak_current(discharge),
            thrust_noise=self.thrust_noise / nominal,
            right_worth=self.right_worth / PULSES,
            delay_cost=self.delay_cost / PULSES,
            false_alarm_cost=self.false_alarm_cost / PULSES,
            wrong_name_cost=self.wrong_name_cost / PULSES,
        )
        capacitors = np.array([thruster.capacitor for thruster in vehicle.thrusters], np.int64)
        waveforms = _waveforms(discharge, tuple(self.sample_numbers.tolist()))
        return PulseModel(np.array(parameters), capacitors, PulseMap.of(discharge).logarithms, waveforms)

    def reset(self, state: PulseState, which: NDArray[np.int64]) -> None:
        """Fire the first pulse."""
        state.declared[which] = 0
        state.statistics[which] = 0.0
        state.episode.onset[which] = state.episode.noticed[which] = -1.0
        self._fire(state, which)

    def step(self, state: PulseState, actions: NDArray[np.int64]) -> None:
        """Judge what the last pulse was declared to be, then fire the next one."""
        fleet, parameters = state.fleet, state.model.parameters
        fleet.by_worlds(
            lambda first, last: _evaluate_declaration(
                fleet.data, actions, parameters, state.case, state.declared, state.statistics, first, last
            )
        )
        fleet.by_worlds(lambda first, last: self._fire(state, fleet.everyone[first:last]))

    def _fire(self, state: PulseState, which: NDArray[np.int64]) -> None:
        fleet, model = state.fleet, state.model
        _fire(
            fleet.arrays, fleet.rows.delivered, model.parameters, model.capacitors, model.logarithms,
            model.waveforms, state.measured, state.pulse, state.case, which,
        )  # fmt: skip

    def observe(self, state: PulseState) -> Observations:
        """(worlds, 1, observation_size)."""
        observations = np.empty((state.fleet.worlds, 1, self.observation_size), np.float32)
        rows, fleet = observations[:, 0], state.fleet
        full_scale = FULL_SCALE["conductivity_loss"]
        fleet.by_worlds(
            lambda first, last: _observe(
                fleet.data, state.measured, state.pulse, state.declared, self.observe_thrust,
                self.observe_fault, full_scale, rows, first, last,
            )
        )  # fmt: skip
        return observations

    def outcome(self, state: PulseState) -> Outcome:
        """Never terminates: an episode is as long as the time limit says."""
        terms = state.statistics[:, np.newaxis, : len(self.reward_terms)]
        return Outcome(terms, state.none[:, np.newaxis], state.none)

    def truth(self, state: PulseState) -> Truth:
        """The score is the mean credit of the faulty pulses times the share of healthy ones called so."""
        fuel, score, success = np.empty((3, state.fleet.worlds, 1))
        _rate(state.fleet.data, state.statistics, fuel, score, success)
        return Truth(fuel, score, success)

    def report(self, state: PulseState) -> dict[str, dict[str, NDArray[Any]]]:
        """How the diagnosis went, and the truth about the pulse that is to be judged now."""
        episode = state.episode
        return {
            "diagnosis": {
                "detected": episode.noticed[:, np.newaxis] >= 0.0,
                "delay": episode.noticed[:, np.newaxis].copy(),
                "false_alarms": episode.false_pulses[:, np.newaxis].astype(np.int64),
                "case": state.case[:, np.newaxis].copy(),
                "thrust": state.truth.ratio[:, np.newaxis].copy(),
            }
        }

    def picture(self, frame: Frame) -> Picture:
        """Voltage and current of the last pulse beside those of a nominal one."""
        state: PulseState = frame.state
        world, info = frame.world, frame.info
        true, declared = (CASES[one[world]].replace("_", " ") for one in (state.case, state.declared))
        _, score = fuel_and_score(frame)
        return Picture(
            readouts=(
                ("thrust", f"{100.0 * info['diagnosis']['thrust'][world, 0]:.0f} %"),
                score,
                ("last pulse", true),
                ("declared before", declared),
            ),
            traces=self._traces(drawable(state.measured[world])),
            traces_name="last pulse",
        )

    def _traces(self, measured: FloatArray) -> tuple[Trace, ...]:
        discharge, numbers, samples = self.discharge, self.sample_numbers, self.samples
        nominal, volts, amperes = pulse_waveforms(discharge), discharge.voltage, peak_current(discharge)
        time, label = 1e6 * nominal.time[numbers], "time, µs"
        current = 1e-3 * (amperes * measured[samples : 2 * samples])
        return (
            Trace("voltage, V", label, time, nominal.voltage[numbers], volts * measured[:samples]),
            Trace("current, kA", label, time, 1e-3 * nominal.current[numbers], current),
        )


@cache
def peak_current(discharge: Discharge) -> float:
    """Largest current of a nominal pulse, A, which scales the observed currents."""
    return float(pulse_waveforms(discharge).current.max())


@cache
def _waveforms(discharge: Discharge, samples: tuple[int, ...]) -> FloatArray:
    """Voltage and current at the nodes of the map, (kicks, dampings, 2 * samples), read-only."""
    nodes = tabulate_pulses(discharge, np.array(samples))
    unit = discharge.voltage * math.sqrt(discharge.capacitance / discharge.inductance)
    waveforms = np.concatenate((1.0 - nodes[1], unit / peak_current(discharge) * nodes[3]), axis=-1)
    waveforms.setflags(write=False)
    return waveforms


@kernel(nogil=True)
def _fire(
    arrays, delivered, numbers, capacitors, logarithms, waveforms, measured, pulse, case, which
):  # fmt: skip
    """Fire the pulse of the present period in some worlds and measure it."""
    parameters, truth = _parameters(numbers), _pulse_truth(pulse)
    data, faults, streams = arrays[0], arrays[1], arrays[2]
    n, lanes, columns, thruster = (
        capacitors.shape[0],
        data.shape[2],
        waveforms.shape[2],
        int(parameters.thruster),
    )
    samples = columns // 2
    noise = np.empty(8 * (columns // 8 + 1))
    for world in which:
        b, w = place(world, 0, 1, lanes)
        row = measured[world]
        number, episode = np.uint64(np.int64(data[b, at.STEP, w])), streams[b, at.EPISODE, w]
        low, high = streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w]
        words = philox(np.uint64(0), number, episode, np.uint64(COMMAND << 32), low, high)
        charge = 1.0 + parameters.jitter * (2.0 * uniform_pair(words[0])[0] - 1.0)
        mass, width, added = pulse_shares(
            faults[b, w], thruster, capacitors, data[b, at.STEP, w] * parameters.period
        )
        ratio = pulse_ratio(mass, width, added, charge, logarithms, parameters.resistance)
        truth.mass[world], truth.width[world], truth.added[world], truth.charge[world] = (
            mass,
            width,
            added,
            charge,
        )
        truth.ratio[world] = ratio
        case[world] = 0
        if abs(ratio - 1.0) > parameters.band:
            case[world] = _main_cause(mass, width, added, logarithms, parameters.resistance)
        for block in range(noise.shape[0] // 8):
            words = philox(np.uint64(block), number, episode, np.uint64(STEP << 32), low, high)
            for k in range(4):
                noise[8 * block + 2 * k], noise[8 * block + 2 * k + 1] = normal_pair(words[k])
        first, second, a, c = map_place(mass, width, added, charge, parameters.resistance)
        for k in range(columns):
            row[k] = 0.0
        for i in range(4):
            for j in range(4):
                weight, node = charge * a[i] * c[j], waveforms[first + i, second + j]
                for k in range(columns):
                    row[k] += weight * node[k]
        for k in range(samples):
            row[k] += parameters.voltage_noise * noise[k]
            row[samples + k] += parameters.current_noise * noise[samples + k]
        row[columns] = ratio + parameters.thrust_noise * noise[columns]
        for i in range(n):
            fires = 1.0 if i == thruster else 0.0
            data[b, at.DUTIES + i, w] = fires
            data[b, delivered + i, w] = fires * ratio * parameters.firing_time
        data[b, at.OPEN_TIME, w] += parameters.firing_time


@njit
def _main_cause(mass, width, added, logarithms, resistance):
    """Which fault alone would take the thrust furthest off, by its place in ``CASES``."""
    cause, furthest = 0, -1.0
    for k in range(1, 4):
        alone = pulse_ratio(
            mass if k == 1 else 1.0, width if k == 2 else 1.0, added if k == 3 else 0.0, 1.0, logarithms,
            resistance,
        )  # fmt: skip
        off = abs(math.log(alone))
        if off > furthest:
            cause, furthest = k, off
    return cause


@kernel
def _rate(data, statistics, fuel, score, success):
    """Fuel, score and success of every world, (worlds, 1) each."""
    episode = _statistics(statistics)
    for world in range(statistics.shape[0]):
        b, w = place(world, 0, 1, data.shape[2])
        faulty, healthy = episode.faulty_pulses[world], episode.healthy_pulses[world]
        credit = episode.credit[world] / max(faulty, 1.0) if faulty > 0.0 else 1.0
        no_alarm = 1.0 - episode.false_pulses[world] / max(healthy, 1.0)
        fuel[world, 0] = data[b, at.OPEN_TIME, w]
        score[world, 0] = credit * no_alarm if healthy + faulty > 0.0 else 0.0
        success[world, 0] = score[world, 0] >= 0.9


@kernel(nogil=True)
def _evaluate_declaration(data, actions, numbers, case, declared, statistics, first, last):
    """Compare declarations with the pulses they are about, in the worlds from ``first`` to ``last``."""
    parameters, episode = _parameters(numbers), _statistics(statistics)
    for world in range(first, last):
        b, w = place(world, 0, 1, data.shape[2])
        time = data[b, at.STEP, w] * parameters.period
        said, true = actions[world, 0, 0], case[world]
        for term in (episode.right, episode.delay, episode.false_alarm, episode.wrong_name):
            term[world] = 0.0
        if said == true:
            episode.right[world] = parameters.right_worth
        elif said == 0:
            episode.delay[world] = -parameters.delay_cost
        elif true == 0:
            episode.false_alarm[world] = -parameters.false_alarm_cost
        else:
            episode.wrong_name[world] = -parameters.wrong_name_cost
        if true == 0:
            episode.healthy_pulses[world] += 1.0
            episode.false_pulses[world] += 1.0 if said > 0 else 0.0
        else:
            episode.faulty_pulses[world] += 1.0
            episode.credit[world] += 1.0 if said == true else (_HALF_RIGHT if said > 0 else 0.0)
            episode.onset[world] = time if episode.onset[world] < 0.0 else episode.onset[world]
            if said > 0 and episode.noticed[world] < 0.0:
                episode.noticed[world] = time - episode.onset[world]
        declared[world] = said
        data[b, at.STEP, w] += 1.0


@kernel(nogil=True)
def _observe(
    data, measured, pulse, declared, observe_thrust, observe_fault, full_scale, observations, first, last
):  # fmt: skip
    columns, faults, truth = measured.shape[1] - 1, len(CASES) - 1, _pulse_truth(pulse)
    for world in range(first, last):
        b, w = place(world, 0, 1, data.shape[2])
        row = observations[world]
        for k in range(columns):
            row[k] = bounded(measured[world, k], _BOUND)
        row[columns] = min(data[b, at.STEP, w] / PULSES, 1.0)
        for k in range(faults):
            row[columns + 1 + k] = 1.0 if declared[world] == k + 1 else 0.0
        k = columns + 1 + faults
        if observe_thrust:
            row[k] = min(max(measured[world, columns], -1.0), _THRUST_BOUND)
            k += 1
        if observe_fault:
            row[k] = min(truth.ratio[world], _THRUST_BOUND)
            row[k + 1], row[k + 2] = truth.mass[world], truth.width[world]
            row[k + 3] = min(truth.added[world] / full_scale, 10.0)
