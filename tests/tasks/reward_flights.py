"""Flights of whole batches under scripted policies, and what they return."""

from dataclasses import dataclass

import numpy as np

from tests.tasks.flying import begin
from thruster_baselines.control import QuaternionTeam
from thruster_envs.physics import rows as at
from thruster_envs.pilots.slots import SlotPilot

DISCOUNTS = (0.99, 0.997, 1.0)


@dataclass
class Flights:
    """What became of a batch: rewards and terms are 0 where an episode is over.

    Attributes:
        terms: (steps, worlds, agents, terms).
        terminated: (worlds,), whether the episode came to its own end before the time was up.
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


def fly(task, policy, worlds, seed=0, options=None):
    """Fly ``policy(batch, step)``, which gives actions (worlds, agents, size), through an episode each."""
    limit = steps_of(task)
    batch = begin(task, worlds, seed, limit, options)
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
        early = step < np.asarray(share) * steps_of(batch.task)
        if early.all():
            return first(batch, step)
        if not early.any():
            return then(batch, step)
        return np.where(np.reshape(early, (-1, 1, 1)), first(batch, step), then(batch, step))

    return policy


def spin_up(batch, step):
    """Open the thrusters that turn the craft about one axis the same way, and no others."""
    task = batch.task
    if task.choices is not None and len(task.choices) == 3:
        return np.ones(batch._shape)
    turning = task.vehicle.effectiveness()[3:]
    axis = np.argmax(np.abs(turning).sum(axis=1))
    duties = np.where(turning[axis] > 1e-9 * np.abs(turning).max(), 1.0, -1.0)
    actions = np.full(batch._shape, -1.0)
    actions[..., : duties.size] = duties
    return actions


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
        actions = np.full(batch._shape, -1.0)
        actions[..., :n] = 2.0 * fleet.read(at.DUTIES, n)[:, : len(task.agents)] - 1.0
        return actions


def approach(share=0.8, end=0.0):
    """Fly `OrionRendezvous` along a straight line that begins and ends at rest, to a share of the start."""

    def places(batch, step):
        task = batch.task
        s = min(step / (share * task.steps), 1.0)
        rate = 1.0 / (share * task.steps * task.vehicle.control_period) if s < 1.0 else 0.0
        left = 1.0 - (1.0 - end) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        speed = -(1.0 - end) * 30.0 * s * s * (1.0 - s) ** 2 * rate
        start = np.array(task.start)
        slot = np.concatenate([left * start, speed * start])
        return np.broadcast_to(slot, (batch.number, 1, 6)).copy()

    return SlotFlight(places)


def keep_slots(batch, step):
    """Fly `FormationKeeping` by the scripted pilot."""
    return SlotFlight(lambda batch, step: batch.state.slots)(batch, step)


def capture(batch, step):
    """Fly `MarsRendezvous` by its own pilot."""
    return batch.task.pilot_actions(batch.state)


def turn(batch, step):
    """Fly `FormationAttitude` by the law of its source."""
    task = batch.task
    return QuaternionTeam(task.vehicle, action=task.action)(batch.observe())


def right(batch, step):
    """Declare what is so, with no test pulse."""
    actions = np.zeros(batch._shape)
    if hasattr(batch.state, "case"):
        actions[..., 0] = batch.state.case[:, np.newaxis]
        return actions
    report = batch.task.report(batch.state)["diagnosis"]
    actions[..., 0], actions[..., 1] = report["thruster"], report["mode"]
    return actions
