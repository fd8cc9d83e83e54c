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
from typing import Any, ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from thruster_envs.faults import DISCHARGE_KINDS, FULL_SCALE, Fault, FaultDistribution
from thruster_envs.kernels import kernel
from thruster_envs.observations import Field
from thruster_envs.physics import rows as at
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
from thruster_envs.tasks.access import bounded, place
from thruster_envs.tasks.contract import (
    FloatArray,
    Observations,
    Outcome,
    Task,
    TaskState,
    Truth,
    check_not_negative,
    check_whole,
)

#: Pulses of an episode.
PULSES = 64
#: What can be declared: a healthy pulse, or one with a fault of this kind.
CASES: tuple[str, ...] = ("healthy", *DISCHARGE_KINDS)
#: Half of the credit for a faulty pulse is for calling it so, the rest for naming the fault.
_HALF_RIGHT = 0.5
_BOUND = 2.0
_THRUST_BOUND = 4.0
# Columns of the account of an episode: what the last declaration was worth; healthy and faulty pulses so far,
# those with a false alarm, sum of the credit; time of the first faulty pulse, s, and seconds until one was
# called faulty, both -1 for not yet.
_RIGHT, _DELAY, _FALSE_ALARM, _WRONG_NAME, _HEALTHY, _FAULTY, _FALSE_PULSES, _CREDIT = range(8)
_ONSET, _NOTICED, _ACCOUNT = 8, 9, 10
# Columns of the truth about the last pulse: shares of slug mass and electrode width, added resistance in ohm,
# share of the voltage, thrust over the nominal one.
_MASS, _WIDTH, _ADDED, _CHARGE, _RATIO, _PULSE = range(6)
# Entries of the limits.
(
    _PERIOD, _THRUSTER, _FIRING, _BAND, _JITTER, _RESISTANCE, _VOLTAGE_NOISE, _CURRENT_NOISE, _THRUST_NOISE,
    _RIGHT_WORTH, _DELAY_COST, _FALSE_ALARM_COST, _WRONG_NAME_COST,
) = range(13)  # fmt: skip


@dataclass(frozen=True)
class PulseModel:
    """The configuration in numbers.

    Attributes:
        limits: (13,).
        capacitors: (n,), the capacitor of each thruster.
        logarithms: The table of a :class:`~thruster_envs.physics.plasma_pulse.PulseMap`.
        waveforms: (kicks, dampings, 2 * samples), voltage and then current at the nodes of the map, in units
            of the observation at the nominal charge.
    """

    limits: FloatArray
    capacitors: NDArray[np.int64]
    logarithms: FloatArray
    waveforms: FloatArray


@dataclass
class PulseState(TaskState):
    """Arrays of a batch: the last pulse of each world, declarations and accounts."""

    model: PulseModel
    measured: FloatArray  # (worlds, 2 * samples + 1), voltage, current, thrust, in units of the observation
    pulse: FloatArray  # (worlds, 5), the truth about it
    case: NDArray[np.int64]  # (worlds,), what would be right to declare
    declared: NDArray[np.int64]  # (worlds,), the last declaration
    account: FloatArray  # (worlds, 10)
    none: FloatArray  # (worlds,), zeros: there is no cost, and no end but the time limit


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
            fleet, self._model(), np.zeros((worlds, 2 * self.samples + 1)), np.zeros((worlds, _PULSE)),
            np.zeros(worlds, np.int64), np.zeros(worlds, np.int64), np.zeros((worlds, _ACCOUNT)),
            np.zeros(worlds),
        )  # fmt: skip

    def _model(self) -> PulseModel:
        vehicle, discharge = self.vehicle, self.discharge
        nominal = vehicle.thrusters[self.thruster - 1].thrust
        limits = (
            vehicle.control_period, self.thruster - 1.0, discharge.firing_time, self.band,
            self.voltage_jitter, discharge.resistance, self.voltage_noise / discharge.voltage,
            self.current_noise / peak_current(discharge), self.thrust_noise / nominal,
            self.right_worth / PULSES, self.delay_cost / PULSES, self.false_alarm_cost / PULSES,
            self.wrong_name_cost / PULSES,
        )  # fmt: skip
        capacitors = np.array([thruster.capacitor for thruster in vehicle.thrusters], np.int64)
        waveforms = _waveforms(discharge, tuple(self.sample_numbers.tolist()))
        return PulseModel(np.array(limits), capacitors, PulseMap.of(discharge).logarithms, waveforms)

    def reset(self, state: PulseState, which: NDArray[np.int64]) -> None:
        """Fire the first pulse."""
        state.declared[which] = 0
        state.account[which] = 0.0
        state.account[which, _ONSET : _NOTICED + 1] = -1.0
        self._fire(state, which)

    def step(self, state: PulseState, actions: NDArray[np.int64]) -> None:
        """Judge what the last pulse was declared to be, then fire the next one."""
        fleet, limits = state.fleet, state.model.limits
        fleet.by_worlds(
            lambda first, last: _judge(
                fleet.data, actions, limits, state.case, state.declared, state.account, first, last
            )
        )
        fleet.by_worlds(lambda first, last: self._fire(state, fleet.everyone[first:last]))

    def _fire(self, state: PulseState, which: NDArray[np.int64]) -> None:
        fleet, model = state.fleet, state.model
        _fire(
            fleet.arrays, fleet.rows.delivered, model.limits, model.capacitors, model.logarithms,
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
        terms = state.account[:, np.newaxis, : len(self.reward_terms)]
        return Outcome(terms, state.none[:, np.newaxis], state.none)

    def truth(self, state: PulseState) -> Truth:
        """The score is the mean credit of the faulty pulses times the share of quiet healthy ones."""
        fuel, score, success = np.empty((3, state.fleet.worlds, 1))
        _rate(state.fleet.data, state.account, fuel, score, success)
        return Truth(fuel, score, success)

    def report(self, state: PulseState) -> dict[str, dict[str, NDArray[Any]]]:
        """How the diagnosis went, and the truth about the pulse that is to be judged now."""
        account = state.account
        return {
            "diagnosis": {
                "detected": account[:, _NOTICED : _NOTICED + 1] >= 0.0,
                "delay": account[:, _NOTICED : _NOTICED + 1].copy(),
                "false_alarms": account[:, _FALSE_PULSES : _FALSE_PULSES + 1].astype(np.int64),
                "case": state.case[:, np.newaxis].copy(),
                "thrust": state.pulse[:, _RATIO : _RATIO + 1].copy(),
            }
        }


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
    arrays, delivered, limits, capacitors, logarithms, waveforms, measured, pulse, case, which
):  # fmt: skip
    """Fire the pulse of the present period in some worlds and measure it."""
    data, faults, streams = arrays[0], arrays[1], arrays[2]
    n, lanes, columns, thruster = (
        capacitors.shape[0],
        data.shape[2],
        waveforms.shape[2],
        int(limits[_THRUSTER]),
    )
    samples = columns // 2
    noise = np.empty(8 * (columns // 8 + 1))
    for world in which:
        b, w = place(world, 0, 1, lanes)
        row, truth = measured[world], pulse[world]
        number, episode = np.uint64(np.int64(data[b, at.STEP, w])), streams[b, at.EPISODE, w]
        low, high = streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w]
        words = philox(np.uint64(0), number, episode, np.uint64(COMMAND << 32), low, high)
        charge = 1.0 + limits[_JITTER] * (2.0 * uniform_pair(words[0])[0] - 1.0)
        mass, width, added = pulse_shares(
            faults[b, w], thruster, capacitors, data[b, at.STEP, w] * limits[_PERIOD]
        )
        ratio = pulse_ratio(mass, width, added, charge, logarithms, limits[_RESISTANCE])
        truth[_MASS], truth[_WIDTH], truth[_ADDED], truth[_CHARGE] = mass, width, added, charge
        truth[_RATIO] = ratio
        case[world] = 0
        if abs(ratio - 1.0) > limits[_BAND]:
            case[world] = _main_cause(mass, width, added, logarithms, limits[_RESISTANCE])
        for block in range(noise.shape[0] // 8):
            words = philox(np.uint64(block), number, episode, np.uint64(STEP << 32), low, high)
            for k in range(4):
                noise[8 * block + 2 * k], noise[8 * block + 2 * k + 1] = normal_pair(words[k])
        first, second, a, c = map_place(mass, width, added, charge, limits[_RESISTANCE])
        for k in range(columns):
            row[k] = 0.0
        for i in range(4):
            for j in range(4):
                weight, node = charge * a[i] * c[j], waveforms[first + i, second + j]
                for k in range(columns):
                    row[k] += weight * node[k]
        for k in range(samples):
            row[k] += limits[_VOLTAGE_NOISE] * noise[k]
            row[samples + k] += limits[_CURRENT_NOISE] * noise[samples + k]
        row[columns] = ratio + limits[_THRUST_NOISE] * noise[columns]
        for i in range(n):
            fires = 1.0 if i == thruster else 0.0
            data[b, at.DUTIES + i, w] = fires
            data[b, delivered + i, w] = fires * ratio * limits[_FIRING]
        data[b, at.OPEN_TIME, w] += limits[_FIRING]


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
def _rate(data, account, fuel, score, success):
    """Fuel, score and success of every world, (worlds, 1) each."""
    for world in range(account.shape[0]):
        b, w = place(world, 0, 1, data.shape[2])
        row = account[world]
        credit = row[_CREDIT] / max(row[_FAULTY], 1.0) if row[_FAULTY] > 0.0 else 1.0
        quiet = 1.0 - row[_FALSE_PULSES] / max(row[_HEALTHY], 1.0)
        fuel[world, 0] = data[b, at.OPEN_TIME, w]
        score[world, 0] = credit * quiet if row[_HEALTHY] + row[_FAULTY] > 0.0 else 0.0
        success[world, 0] = score[world, 0] >= 0.9


@kernel(nogil=True)
def _judge(data, actions, limits, case, declared, account, first, last):
    """Compare declarations with the pulses they are about, in the worlds from ``first`` to ``last``."""
    for world in range(first, last):
        b, w = place(world, 0, 1, data.shape[2])
        row, time = account[world], data[b, at.STEP, w] * limits[_PERIOD]
        said, true = actions[world, 0, 0], case[world]
        for k in range(_WRONG_NAME + 1):
            row[k] = 0.0
        if said == true:
            row[_RIGHT] = limits[_RIGHT_WORTH]
        elif said == 0:
            row[_DELAY] = -limits[_DELAY_COST]
        elif true == 0:
            row[_FALSE_ALARM] = -limits[_FALSE_ALARM_COST]
        else:
            row[_WRONG_NAME] = -limits[_WRONG_NAME_COST]
        if true == 0:
            row[_HEALTHY] += 1.0
            row[_FALSE_PULSES] += 1.0 if said > 0 else 0.0
        else:
            row[_FAULTY] += 1.0
            row[_CREDIT] += 1.0 if said == true else (_HALF_RIGHT if said > 0 else 0.0)
            row[_ONSET] = time if row[_ONSET] < 0.0 else row[_ONSET]
            if said > 0 and row[_NOTICED] < 0.0:
                row[_NOTICED] = time - row[_ONSET]
        declared[world] = said
        data[b, at.STEP, w] += 1.0


@kernel(nogil=True)
def _observe(
    data, measured, pulse, declared, observe_thrust, observe_fault, full_scale, observations, first, last
):  # fmt: skip
    columns, faults = measured.shape[1] - 1, len(CASES) - 1
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
            row[k] = min(pulse[world, _RATIO], _THRUST_BOUND)
            row[k + 1], row[k + 2] = pulse[world, _MASS], pulse[world, _WIDTH]
            row[k + 3] = min(pulse[world, _ADDED] / full_scale, 10.0)
