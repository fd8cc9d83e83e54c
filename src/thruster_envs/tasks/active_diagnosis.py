"""Diagnosis with test pulses as a task: say which thruster has failed and how, and fire to find out.

Models the flight of :mod:`.fault_diagnosis` with a craft that only holds its place, so that thrusters hardly
fire and a fault hardly shows. Besides declaring what it believes, the agent chooses a test pulse for each
thruster in each control period, on top of the pilot's duties, until its budget of thruster-seconds is used
up. Leaves out tests that pause the pilot: it goes on holding the craft, and so undoes what a test has done.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from thruster_envs.faults import MODES
from thruster_envs.kernels import kernel
from thruster_envs.observations import Field, Reader
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import place
from thruster_envs.tasks.contract import Observations, check_not_negative, check_positive
from thruster_envs.tasks.fault_diagnosis import FLIGHT, DiagnosisState, FaultDiagnosis, open_statistics


@dataclass(frozen=True, kw_only=True)
class ActiveDiagnosis(FaultDiagnosis):
    """Configuration of ``ActiveDiagnosis-v1``, beyond that of :class:`FaultDiagnosis`.

    Attributes:
        test_duties: The test pulses that there are, as duties.
        budget: Test pulses of a flight, thruster-seconds.
        fuel_cost: What it costs to use up the budget.
        soft_rate_limit: Body rate from which on ``info["cost"]`` counts, rad/s.
    """

    reach: float | None = 0.0
    test_duties: tuple[float, ...] = (0.1, 0.4)
    budget: float = 60.0
    fuel_cost: float = 0.5
    soft_rate_limit: float = 0.1

    reward_terms: ClassVar[tuple[str, ...]] = (
        "lost", "right", "delay", "false_alarm", "wrong_name", "fuel",
    )  # fmt: skip
    max_episode_steps: ClassVar[int | None] = FLIGHT

    def __post_init__(self) -> None:
        super().__post_init__()
        duties = tuple(float(duty) for duty in self.test_duties)
        object.__setattr__(self, "test_duties", duties)
        if not duties or not all(0.0 < duty <= 1.0 for duty in duties):
            raise ValueError(
                f"test_duties is {duties!r}; one or more numbers above 0 and at most 1 would be right"
            )
        check_positive(self, "budget", "soft_rate_limit")
        check_not_negative(self, "fuel_cost")

    @cached_property
    def choices(self) -> tuple[int, ...] | None:
        """Thruster, from 1, or 0 for no fault; mode; test pulse of each thruster, 0 for none."""
        n = self.vehicle.number_of_thrusters
        return (n + 1, len(MODES), *(n * [1 + len(self.test_duties)]))

    def further_fields(self) -> tuple[Field, ...]:
        """What is left of the budget."""
        return (Field("budget", "budget left", 1, "s", self.budget, reference="budget", lowest=0.0),)

    def loss(self) -> float:
        """What a loss costs beside the periods that are left: the most a flight can be worth or cost."""
        return self.right_worth + self.worst_cost() + self.fuel_cost

    def rate_soft_limit(self) -> float:
        """Body rate from which on ``cost`` counts, rad/s: tests may turn the craft."""
        return self.soft_rate_limit

    def intervene(self, state: DiagnosisState, actions: NDArray[np.int64]) -> None:
        """Add the test pulses to the pilot's duties, thruster by thruster, as far as the budget goes."""
        duties = np.array((0.0, *self.test_duties))
        period, price = self.vehicle.control_period, self.fuel_cost / self.budget
        state.fleet.by_worlds(
            lambda first, last: _test(
                state.fleet.data, actions, duties, period, self.budget, price, state.statistics, first, last
            )
        )

    def observe(self, state: DiagnosisState) -> Observations:
        """(worlds, 1, observation_size)."""
        observations = super().observe(state)
        observations[:, 0, self._budget_column] = 1.0 - state.episode.tested / self.budget
        return observations

    @cached_property
    def _budget_column(self) -> int:
        return int(Reader(self.fields).columns("budget").start)

    def report(self, state: DiagnosisState) -> dict[str, dict[str, NDArray[Any]]]:
        """How the diagnosis went, with the test pulses fired."""
        report = super().report(state)
        report["diagnosis"]["tested"] = state.episode.tested[:, np.newaxis].copy()
        return report


@kernel(nogil=True)
def _test(data, actions, test_duties, period, budget, price, statistics, first, last):
    """Add test pulses in the worlds from ``first`` to ``last`` (exclusive); no duty exceeds 1."""
    episode = open_statistics(statistics)
    for world in range(first, last):
        b, w = place(world, 0, 1, data.shape[2])
        fired = 0.0
        for i in range(actions.shape[2] - 2):
            duty, wanted = data[b, at.DUTIES + i, w], test_duties[actions[world, 0, 2 + i]]
            left = max(0.0, budget - episode.tested[world] - fired)
            pulse = min(period * wanted, period * (1.0 - duty), left)
            data[b, at.DUTIES + i, w] = min(duty + pulse / period, 1.0)
            fired += pulse
        episode.tested[world] = min(episode.tested[world] + fired, budget)
        episode.fuel[world] = -price * fired if fired > 0.0 else 0.0
