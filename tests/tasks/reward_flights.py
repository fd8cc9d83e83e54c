"""Flights of whole batches under scripted policies, and what they return."""

from dataclasses import dataclass

import numpy as np

from tests.tasks.flying import begin
from thruster_baselines.mapping import LPMapper
from thruster_envs.physics import rows as at
from thruster_envs.pilots import AttitudePilot, SlotPilot

DISCOUNTS = (0.99, 0.997, 1.0)


@dataclass
class Flights:
    """What became of a batch: rewards and terms are 0 where an episode is over.

    Attributes:
        terms: (steps, worlds, agents, terms).
        terminated: (worlds,), whether the episode came to its own end.
        score: (worlds, agents), at its end.
        success: Likewise.
        length: (worlds,), steps.
    """

    terms: np.ndarray
    terminated: np.ndarray
    score: np.ndarray
    success: np.ndarray
    length: np.ndarray

    def returns(self, discount):
        """(worlds, agents)."""
        weights = discount ** np.arange(len(self.terms))
        return np.einsum("t,twak->wa", weights, self.terms)

    def term(self, task, name):
        """(steps, worlds, agents), of one term of the reward."""
        return self.terms[..., task.reward_terms.index(name)]


def steps_of(task):
    """Control periods of an episode that runs to its end."""
    return task.steps or task.max_episode_steps


def fly(task, policy, worlds, *, faults=None, limit=None):
    """Fly ``policy(batch, step)``, which gives actions (worlds, agents, size), through an episode each."""
    limit = limit or steps_of(task)
    options = None if faults is None else {"faults": faults}
    batch = begin(task, worlds, limit=limit, options=options)
    running = np.ones(worlds, bool)
    shape = (worlds, len(task.agents))
    score, success, length = np.zeros(shape), np.zeros(shape, bool), np.zeros(worlds, int)
    terminated, terms = np.zeros(worlds, bool), np.zeros((limit, *shape, len(task.reward_terms)))
    for step in range(limit):
        result = batch.step(policy(batch, step))
        terms[step] = np.where(running[:, None, None], result.reward_terms, 0.0)
        ends = running & result.done
        info = batch.info(result)
        score[ends], success[ends] = info["score"][ends], info["success"][ends]
        length[ends], terminated[ends] = step + 1, result.terminated[ends]
        running &= ~result.done
        if not running.any():
            break
    return Flights(terms[: step + 1], terminated, score, success, length)


def nothing(batch, step):
    """No thruster is opened; nothing is declared."""
    shape = batch._shape
    return np.full(shape, -1.0) if batch.task.choices is None else np.zeros(shape)


def constant(actions):
    """The same action in every world and period, (agents, size) or (worlds, agents, size)."""
    return lambda batch, step: np.broadcast_to(actions, batch._shape)


def until(first, share, then=nothing):
    """One policy for a share of the episode, or of each world's (worlds,), then another."""

    def policy(batch, step):
        early = step < np.asarray(share) * batch.max_episode_steps
        if early.all():
            return first(batch, step)
        if not early.any():
            return then(batch, step)
        return np.where(np.reshape(early, (-1, 1, 1)), first(batch, step), then(batch, step))

    return policy


def spin_up(batch, step):
    """Open the thrusters that turn the craft about one axis the same way, and no others; declare nothing."""
    return _turning(batch, 0)


def spin_about(axis):
    """:func:`spin_up` about an axis."""
    return lambda batch, step: _turning(batch, axis)


def _turning(batch, axis):
    task, actions = batch.task, nothing(batch, 0)
    if task.choices is not None and len(task.choices) == 3:
        actions[..., axis] = 1.0
        return actions
    turning = task.vehicle.effectiveness()[3:]
    opened = turning[axis] > 1e-9 * np.abs(turning).max()
    if task.choices is None:
        actions[..., : opened.size][..., opened] = 1.0
    elif len(task.choices) > 3:
        actions[..., 2:][..., opened] = task.choices[-1] - 1
    return actions


def random_duties(seed):
    """Duties, or options, drawn anew for every craft in every period."""
    rng = np.random.default_rng(seed)

    def policy(batch, step):
        choices = batch.task.choices
        if choices is None:
            return rng.uniform(-1.0, 1.0, batch._shape)
        return rng.integers(0, choices, batch._shape)

    return policy


def random_constants(seed):
    """Duties, or options, drawn once for each craft of each world."""
    drawn = {}

    def policy(batch, step):
        if step == 0:
            drawn["actions"] = random_duties(seed)(batch, 0)
        return drawn["actions"]

    return policy


def bang_bang(seed):
    """Valves that are open or shut for eight periods at a time, a tenth of them open."""
    rng, drawn = np.random.default_rng(seed), {}

    def policy(batch, step):
        if step % 8 == 0:
            choices = batch.task.choices
            most = 1.0 if choices is None else np.array(choices) - 1.0
            drawn["actions"] = np.where(rng.random(batch._shape) < 0.1, most, nothing(batch, step))
        return drawn["actions"]

    return policy


class SlotFlight:
    """The scripted pilot of slots, of which the first craft are commanded, along a reference.

    Args:
        places: ``places(batch, step)`` gives (worlds, craft, 6), m and m/s.
    """

    def __init__(self, places):
        self.places, self.pilot = places, None

    def __call__(self, batch, step):
        fleet, task = batch.fleet, batch.task
        self.pilot = self.pilot or SlotPilot.of(task.vehicle)
        craft, n = task.number_of_craft, task.vehicle.number_of_thrusters
        self.pilot.fly(fleet.data, self.places(batch, step), 0, craft, fleet.worlds)
        return 2.0 * fleet.read(at.DUTIES, n)[:, : len(task.agents)] - 1.0


def approach(end=0.0, share=0.8):
    """Fly `OrionRendezvous` along a line that begins and ends at rest, at a share of the start's distance.

    Args:
        end: That share.
        share: Of the time, for the way.
    """

    def places(batch, step):
        task = batch.task
        s = min(step / (share * task.steps), 1.0)
        rate = 1.0 / (share * task.steps * task.vehicle.control_period)
        left = 1.0 - (1.0 - end) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        speed = -(1.0 - end) * 30.0 * s * s * (1.0 - s) ** 2 * rate
        start = np.array(task.start)
        return np.tile(np.concatenate([left * start, speed * start]), (batch.number, 1, 1))

    return SlotFlight(places)


def keep_slots(aside=0.0):
    """Fly `FormationKeeping` by the scripted pilot, to a place radially aside of each slot, m."""

    def places(batch, step):
        slots = batch.state.slots.copy()
        slots[..., 0] += aside
        return slots

    return SlotFlight(places)


def capture(batch, step):
    """Fly `MarsRendezvous` by its own pilot."""
    return batch.task.pilot_actions(batch.state)


def _capture_elsewhere(batch, place, speed, aside):
    """Fly `MarsRendezvous` by its own pilot, which takes another place for that of its reference."""
    estimate, time = batch.state.estimate, batch.steps[0] * batch.task.vehicle.control_period
    wanted, wanted_speed = batch.state.model.pilot.reference(time)[:2]
    before = estimate.copy()
    estimate[:, 0] -= aside
    estimate[:, 1] += wanted - place
    estimate[:, 4] += wanted_speed - speed
    actions = batch.task.pilot_actions(batch.state)
    estimate[:] = before
    return actions


def stop_at(distance):
    """Fly `MarsRendezvous` by its own pilot, and stay at a distance from the target, m."""

    def policy(batch, step):
        place, speed = batch.state.model.pilot.reference(step * batch.task.vehicle.control_period)[:2]
        near = place >= -distance
        return _capture_elsewhere(batch, -distance if near else place, 0.0 if near else speed, 0.0)

    return policy


def rush(speed):
    """Fly `MarsRendezvous` at the target, at a speed in m/s."""

    def policy(batch, step):
        place = min(speed * step * batch.task.vehicle.control_period - batch.task.distance, 5.0)
        return _capture_elsewhere(batch, place, speed, 0.0)

    return policy


def pass_by(aside):
    """Fly `MarsRendezvous` by its own pilot, to a place radially aside of the target, m."""

    def policy(batch, step):
        place, speed = batch.state.model.pilot.reference(step * batch.task.vehicle.control_period)[:2]
        return _capture_elsewhere(batch, place, speed, aside)

    return policy


def turn(share=1.0):
    """Fly `FormationAttitude` by the law of its source, through a share of each turn."""

    def policy(batch, step):
        task, fleet, targets = batch.task, batch.fleet, batch.state.targets
        pilot = AttitudePilot.of(task.vehicle)
        half = share * np.arccos(np.clip(targets[..., :1], -1.0, 1.0))
        vector = targets[..., 1:]
        axis = vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12)
        aims = np.concatenate([np.cos(half), np.sin(half) * axis], axis=-1)
        pilot.fly(fleet.data, aims, 0, task.craft, fleet.worlds)
        agents = slice(task.first_commanded, task.first_commanded + len(task.agents))
        duties = fleet.read(at.DUTIES, task.vehicle.number_of_thrusters)[:, agents]
        forwards, backwards = pilot.gains.thrusters.T
        return duties[..., forwards] + 2.0 * duties[..., backwards]

    return policy


def right(batch, step):
    """Declare what is so, with no test pulse."""
    actions = nothing(batch, step)
    if hasattr(batch.state, "case"):
        actions[..., 0] = batch.state.case[:, np.newaxis]
        return actions
    report = batch.task.report(batch.state)["diagnosis"]
    actions[..., 0], actions[..., 1] = report["thruster"], report["mode"]
    return actions


def allocate(share=1.0):
    """Fly `ThrusterMapping` by a share of what the linear program that knows the fault commands."""

    def policy(batch, step):
        task = batch.task
        effectiveness, offset = task.true_model(batch.state)
        mapper = LPMapper(task.vehicle)
        on_times = mapper(batch.state.command - offset, effectiveness=effectiveness).on_times
        return 2.0 * share * on_times[:, np.newaxis] / task.vehicle.control_period - 1.0

    return policy
