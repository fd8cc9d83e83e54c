"""`ThrusterMapping-v0`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import Task, ThrusterMapping
from thruster_envs.views.single import TaskEnv

__all__ = ["ThrusterMappingEnv"]


class ThrusterMappingEnv(TaskEnv):
    """Turn commanded rate changes into thruster on-times, on a vehicle that may carry a hidden fault.

    ## Description

    A flight controller asks for a change of velocity and of angular rate; the policy says for how much of the
    control period each thruster is open. One of them may be dead or weak, and nobody says which: it shows
    only in the difference between what was expected and what was measured. Each command stands for itself:
    the craft does not move between commands, and the rate change is linear in the on-times, as the true,
    faulty vehicle delivers them (Yang 2003, chapter 2). So the best that anybody can do for a command is a
    linear program that knows the fault. Feed coupling, scatter, minimum pulses, valve delays and depletion
    are switched off.

    Thrusters, numbers and bounds below are those of the default vehicle, Orion, which has 12 thrusters.

    ## Action Space

    `Box(-1, 1, (12,), float32)`, the duty of each thruster in the coming period of 5 s.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-11 | duty of each thruster: -1 stays shut, 0 opens for half the period, 1 for all of it | -1 | 1 | 1 |

    ## Observation Space

    `Box(..., (54,), float32)`. Rate changes have six numbers: three of translation, three of rotation, body
    axes x, y, z. *Authority* is the largest rate change that the healthy vehicle reaches on an axis in one
    period; values beyond a bound are clipped. *Projected on a thruster* is the on-time of that thruster alone
    that explains the rate change best.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-5 | commanded rate change | -3 | 3 | authority per axis |
    | 6-17 | last duties | 0 | 1 | 1 |
    | 18-23 | last measured rate change | -3 | 3 | authority per axis |
    | 24-29 | last expected rate change | -3 | 3 | authority per axis |
    | 30-41 | last measured rate change, projected on each thruster | -3 | 3 | control period |
    | 42-53 | last expected rate change, projected on each thruster | -3 | 3 | control period |

    With `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 54-65 | true delivered share of each thruster's on-time | -1 | 1 | 1 |
    | 66-77 | true opening of each thruster when closed | -1 | 1 | 1 |

    ## Rewards

    Minus the objective of the linear program, as the true vehicle delivers it, as a share of what it costs to
    miss the whole authority on every axis. With the command *c*, the delivered rate change *d*, the on-times
    *u* in s:

    - `miss`: - slack_cost . |c - d| / (slack_cost . authority), dimensionless
    - `fuel`: - fuel_cost . u / (slack_cost . authority), dimensionless

    where (fuel_cost, slack_cost) = `thruster_envs.spacecraft.objective_weights(effectiveness, period)`: a
    miss always costs more than the fuel that would avoid it.

    | Term | What | In a period | In an episode |
    |---|---|---|---|
    | `miss` | as above; up to 1.5 of the authority is commanded | -2.5 to 0 | -80 to 0 |
    | `fuel` | as above, on Orion | -0.0083 to 0 | -0.27 to 0 |

    Nothing can be lost, and no episode ends early. Doing nothing misses every command whole; the linear
    program that knows the fault returns the most there is.

    ## Starting State

    No last command. The first command is drawn like every later one. Four kinds are equally likely: a single
    axis within its authority; all axes within 0.3 of it; all axes within 1.5 of it, mostly out of
    reach; all axes within 0.02 of it. By default a fault is drawn at every reset with probability 0.8: a
    thruster that is stuck off or has lost part of its thrust, from some command of the first half of the
    episode on.

    ## Episode End

    Never terminates; truncated after 32 commands.

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: 0, there is nothing to violate.
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 is an empty slot), `kind` (position in
      `thruster_envs.faults.KINDS`, from 1), `severity`, `onset` (s), `active`; `sensor` and `axis` are 0, no
      sensor fails here.
    - `stale`: false for each of `thruster_envs.faults.SENSORS`, for the same reason.
    - `fuel`: thruster-seconds of open valve since the reset.
    - `score`: one minus the objective over that of doing nothing, summed over the episode so far, in 0..1.
    - `success`: whether the score is at least 0.9.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.

    ## Arguments

    ```python
    gym.make("thruster_envs/ThrusterMapping-v0", spacecraft="orion", faults=None, observe_fault=False)
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`, on any
      orbit, since nothing moves.
    - `faults`: None for the default distribution, `[]` for no faults, a `Fault`, a list of them, or a
      `FaultDistribution`; also as plain mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the vehicle can have in an episode.
    - `nonlinear`, `max_substep`: as in the other environments; without effect here, where nothing moves.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/ThrusterMapping-v0", faults=[])
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(-1.0 + 0.0 * env.action_space.sample())
    >>> info["score"], info["reward_terms"]["fuel"], reward == info["reward_terms"]["miss"]
    (0.0, -0.0, True)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = ThrusterMapping
