"""Compiled helpers that every task uses: rows of a craft, duties in, the oracle view out, bounded numbers."""

import math

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.kernels import kernel
from thruster_envs.physics import health
from thruster_envs.physics import rows as at
from thruster_envs.physics.access import place, turning_of_frame
from thruster_envs.physics.attitude import exponential, rotate
from thruster_envs.physics.fleet import Fleet
from thruster_envs.random import RESET, philox, uniform_pair

#: First rows of what the sensors said, 3, 3, 4 and 3 of them: m, m/s, body-from-LVLH, rad/s.
MEASURED_POSITION, MEASURED_VELOCITY, MEASURED_ATTITUDE, MEASURED_RATE = (
    at.MEASURED + k for k in (0, 3, 6, 10)
)


#: What a task of one's own draws for in a step: the purpose after those of :mod:`thruster_envs.random`.
_OWN = 8


@njit(forceinline=True)
def draw_start(streams, b, w, craft, uniform):
    """Fill ``uniform`` with numbers from 0 to 1 for the start of an episode; its size is a multiple of 8."""
    for block in range(uniform.shape[0] // 8):
        words = philox(
            np.uint64(2 + block), np.uint64(0), streams[b, at.EPISODE, w],
            np.uint64(RESET << 32) | np.uint64(craft), streams[b, at.KEY_LOW, w], streams[b, at.KEY_HIGH, w],
        )  # fmt: skip
        for k in range(4):
            uniform[8 * block + 2 * k], uniform[8 * block + 2 * k + 1] = uniform_pair(words[k])


@kernel
def _fill_starts(streams, which, uniform):
    number_of_craft, lanes = uniform.shape[1], streams.shape[2]
    for k in range(which.shape[0]):
        for craft in range(number_of_craft):
            b, w = place(which[k], craft, number_of_craft, lanes)
            draw_start(streams, b, w, craft, uniform[k, craft])


def start_numbers(fleet: Fleet, which: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Numbers from 0 to 1 for the start of episodes, functions of their seeds: (len(which), craft, count)."""
    uniform = np.empty((len(which), fleet.craft, 8 * -(-count // 8)))
    _fill_starts(fleet.streams, which, uniform)
    return uniform[..., :count]


@kernel
def _fill_steps(data, streams, uniform):
    number_of_craft, lanes = uniform.shape[1], streams.shape[2]
    for world in range(uniform.shape[0]):
        for craft in range(number_of_craft):
            b, w = place(world, craft, number_of_craft, lanes)
            for block in range(uniform.shape[2] // 8):
                words = philox(
                    np.uint64(block), np.uint64(np.int64(data[b, at.STEP, w])), streams[b, at.EPISODE, w],
                    np.uint64(_OWN << 32) | np.uint64(craft), streams[b, at.KEY_LOW, w],
                    streams[b, at.KEY_HIGH, w],
                )  # fmt: skip
                for k in range(4):
                    first, second = uniform_pair(words[k])
                    uniform[world, craft, 8 * block + 2 * k] = first
                    uniform[world, craft, 8 * block + 2 * k + 1] = second


def step_numbers(fleet: Fleet, count: int) -> NDArray[np.float64]:
    """Numbers from 0 to 1 for a step: (worlds, craft, count).

    They are functions of the seed, the episode and the control periods flown so far: the same however often
    they are asked for before ``fleet.fly()``, others after it.
    """
    uniform = np.empty((fleet.worlds, fleet.craft, 8 * -(-count // 8)))
    _fill_steps(fleet.data, fleet.streams, uniform)
    return uniform[..., :count]


@kernel
def duties_of(actions, duties):
    """Turn actions -1..1 into duties 0..1, (worlds, agents, n) both; False if a number is not finite."""
    finite = True
    for world in range(actions.shape[0]):
        for agent in range(actions.shape[1]):
            for i in range(actions.shape[2]):
                action = actions[world, agent, i]
                finite &= math.isfinite(action)
                duties[world, agent, i] = min(max(0.5 * action + 0.5, 0.0), 1.0)
    return finite


@kernel
def options_of(actions, choices, options):
    """Turn actions into options, (worlds, agents, entries) both; False if one does not exist."""
    exist = True
    for world in range(actions.shape[0]):
        for agent in range(actions.shape[1]):
            for k in range(actions.shape[2]):
                action = actions[world, agent, k]
                exists = 0.0 <= action < choices[k] and action == math.floor(action)
                options[world, agent, k] = int(action) if exists else 0
                exist &= exists
    return exist


@kernel
def command_duties(data, duties, number_of_craft):
    """Write duties (worlds, agents, n) into the rows of the first craft of each world."""
    lanes = data.shape[2]
    for world in range(duties.shape[0]):
        for craft in range(duties.shape[1]):
            b, w = place(world, craft, number_of_craft, lanes)
            for i in range(duties.shape[2]):
                data[b, at.DUTIES + i, w] = duties[world, craft, i]


@njit(forceinline=True)
def bounded(x, bound):
    """A number kept within plus and minus ``bound``, as the observation spaces promise."""
    return min(max(x, -bound), bound)


@njit(forceinline=True)
def write_oracle_view(faults, b, w, start, period, row, column):
    """Write the oracle view, 2 n numbers, into an observation from ``column`` on."""
    n = (row.shape[0] - column) // 2
    for i in range(n):
        _, row[column + i], row[column + n + i] = health.shares_of(faults[b, w], i, start, period)


@kernel
def true_model(data, faults, columns, wrenches, inverse_inertia, period, number_of_craft, worlds):
    """The vehicle as it truly is in the coming period.

    Returns the rate change per second of commanded on-time, (worlds, craft, 6, n) in m/s^2 and rad/s^2, and
    what comes without a command, (worlds, craft, 6) in m/s and rad/s; body axes. ``columns`` is the first row
    of the true wrenches. Exact for faults that do not change within the period and whose thrust is
    proportional to the on-time, feed coupling and scatter apart; where a fault adds to the duty, as long as
    the sum is at most 1.
    """
    n, lanes = wrenches.shape[0], data.shape[2]
    effectiveness, offset = np.zeros((worlds, number_of_craft, 6, n)), np.zeros((worlds, number_of_craft, 6))
    wrench = np.empty((6 * n, 1))
    for world in range(worlds):
        for craft in range(number_of_craft):
            b, w = place(world, craft, number_of_craft, lanes)
            start = data[b, at.STEP, w] * period
            for k in range(6 * n):
                wrench[k, 0] = data[b, columns + k, w]
            for slot in range(faults.shape[2]):
                if health.is_active(faults[b, w, slot], start + 0.5 * period):
                    health.tilt_columns(faults[b, w, slot], start + 0.5 * period, wrench, 0)
            for i in range(n):
                share, _, closed = health.shares_of(faults[b, w], i, start, period)
                column = wrench[6 * i : 6 * i + 6, 0]
                for k in range(3):
                    column[k] /= data[b, at.MASS, w]
                x, y, z = column[3], column[4], column[5]
                for k in range(3):
                    column[3 + k] = (
                        inverse_inertia[k, 0] * x + inverse_inertia[k, 1] * y + inverse_inertia[k, 2] * z
                    )
                for k in range(6):
                    effectiveness[world, craft, k, i] = share * column[k]
                    offset[world, craft, k] += closed * period * column[k]
    return effectiveness, offset


@njit(forceinline=True)
def disperse(data, b, w, uniform, position, velocity, half_widths):
    """Disperse a craft about a position, m, and a velocity, m/s, and about the attitude and rate of LVLH.

    By twelve numbers from 0 to 1, uniformly in a box of these half-widths: m, m/s, rad, rad/s.
    """
    for k in range(3):
        data[b, at.POSITION + k, w] = position[k] + half_widths[0] * (2.0 * uniform[k] - 1.0)
        data[b, at.VELOCITY + k, w] = velocity[k] + half_widths[1] * (2.0 * uniform[3 + k] - 1.0)
    _disperse_attitude(data, b, w, uniform[6:12], half_widths[2], half_widths[3])


@njit(forceinline=True)
def _disperse_attitude(data, b, w, uniform, angle, rate):
    half = 0.5 * angle
    q = exponential(
        half * (2.0 * uniform[0] - 1.0), half * (2.0 * uniform[1] - 1.0), half * (2.0 * uniform[2] - 1.0)
    )
    frame = rotate(q, turning_of_frame(data, b, w))
    for k in range(4):
        data[b, at.ATTITUDE + k, w] = q[k]
    for k in range(3):
        data[b, at.RATE + k, w] = frame[k] + rate * (2.0 * uniform[3 + k] - 1.0)
