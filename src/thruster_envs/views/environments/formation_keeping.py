"""`FormationKeeping-v1`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import FormationKeeping, Task
from thruster_envs.views.single import TaskEnv

__all__ = ["FormationKeepingEnv"]


class FormationKeepingEnv(TaskEnv):
    """Keep one craft of a formation in its slot, while the scripted pilot flies the others.

    ## Description

    Three Orion craft (two to eight) keep slots that lie evenly on a circular relative orbit of 50 m about an
    empty reference point. Free motion follows that orbit without fuel, so what is to be flown against is
    dispersion, sensor noise, firing scatter, and faults. The fuel bill is shared. The first craft is the
    agent's; the others fly with the suite's scripted pilot, which knows of no fault. With every craft as an
    agent of its own this is the PettingZoo environment `thruster_envs.formation_keeping_v1`.

    ## Action Space

    `Box(-1, 1, (12,), float32)`, the duty of each thruster in the coming period of 5 s.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-11 | duty of each thruster: -1 stays shut, 0 opens for half the period, 1 for all of it | -1 | 1 | 1 |

    ## Observation Space

    `Box(..., (43,), float32)` for three craft. Positions and velocities in LVLH axes x, y, z; attitude error,
    rate error and rate changes in body axes. *Authority* is the largest rate change that the healthy vehicle
    reaches on an axis in one period. Values beyond a bound are clipped.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-2 | measured position relative to the slot | -5 | 5 | 10 m |
    | 3-5 | measured velocity relative to the slot | -5 | 5 | 0.05 m/s |
    | 6-8 | measured attitude error | -5 | 5 | 0.5 rad |
    | 9-11 | measured rate error | -5 | 5 | 0.05 rad/s |
    | 12-23 | last duties | 0 | 1 | 1 |
    | 24-29 | last measured rate change | -5 | 5 | authority per axis |
    | 30-35 | last expected rate change | -5 | 5 | authority per axis |
    | 36 | own fuel over the formation's mean, less one | -1 | 5 | 1 |
    | 37-42 | measured positions of the other craft | -5 | 5 | 100 m |

    The positions of the other craft are relative to the own one, in the order of the craft. With
    `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 43-54 | true delivered share of each thruster's on-time | -1 | 1 | 1 |
    | 55-66 | true opening of each thruster when closed | -1 | 1 | 1 |

    ## Rewards

    With *d* the distance from the slot, *a* the angle from LVLH and *u* the mean over all craft of the
    share of thruster time in which valves were open:

    reward = 5 / 120 (1 / (1 + d / `slot_tolerance`) + 0.5 / (1 + a / (0.1 rad)) + `fuel_price` (1 - u)) -
    5 (1.5 + `fuel_price`) [lost]

    | Term | What | In a period | In an episode of 120 |
    |---|---|---|---|
    | `tracking` | 5 / 120 / (1 + d / `slot_tolerance`) | 0 to 0.042 | 0 to 5 |
    | `attitude` | 2.5 / 120 / (1 + a / (0.1 rad)) | 0 to 0.021 | 0 to 2.5 |
    | `fuel` | 5 / 120 `fuel_price` (1 - u) | 0 to 0.021 | 0 to 2.5 |
    | `lost` | - 5 (1.5 + `fuel_price`) | -10 or 0 | -10 or 0 |

    - `tracking`: of being in the slot
    - `attitude`: of being aligned with LVLH
    - `fuel`: of valves that stay shut; whoever fires, all pay
    - `lost`: a craft, as much as a whole episode can be worth

    No period without a loss returns less than 0: at whatever time, under whatever discount and whatever the
    time limit, a loss returns less than any way to go on without one. Doing nothing drifts some metres off
    the slot and is not lost.

    ## Starting State

    The first slot is at a random phase of the relative orbit. Each craft starts at its slot, dispersed
    uniformly by 1.5 m, 5 mm/s, 5 degrees and 1 mrad/s on each axis. No faults unless `faults` says so.

    ## Episode End

    Terminates when any craft is further than 100 m from its slot or turns faster than 1 rad/s. Truncated
    after 120 periods (10 minutes).

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: 1 - distance / 10 m to the nearest other craft, where that is above 0: the danger of a
      collision.
    - `fault`: arrays over the fault slots of the own craft: `thruster` (from 1; 0 where none fails), `kind`
      (position in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor fails; 0 is an
      empty slot), `severity`, `onset` (s), `active`, `sensor` (position in `thruster_envs.faults.SENSORS`,
      from 1; 0 where none fails), `axis` (from 1; 0 for all three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of open valve of the own craft since the reset.
    - `score`: share of the steps so far after which the craft was within 1 m of its slot.
    - `success`: whether the score is at least 0.8, without any cost on the way and without a craft lost.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `state`: how the craft truly moves: `position` (m) and `velocity` (m/s) in LVLH axes, `attitude` from
      LVLH to the body (scalar first), `rate` (rad/s, inertial, body axes).

    ## Arguments

    ```python
    gym.make("thruster_envs/FormationKeeping-v1", craft=4, faults=[{"thruster": 5, "kind": "leak"}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`. Its orbit
      may be elliptic or have J2: the information then has `orbit`, with the `true_anomaly`, rad. The slots
      are then on the closed relative orbit that becomes the circle as the eccentricity goes.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the own faults is added to the observation.
    - `fault_slots`: faults that each craft can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations instead of the linear ones, Hill's
      or those of an elliptic orbit; with J2 it always does.
    - `max_substep`: longest integration sub-step, s; None lets each craft take as many as its turning needs.
    - `craft`: number of craft, 2 to 8.
    - `radius`: of the relative orbit, m. `slot_tolerance`: distance within which a slot counts as kept, m.
    - `keep_out`: distance between craft below which `cost` counts, m.
    - `range_limit`, `rate_limit`: bounds, m and rad/s.
    - `fuel_price`: worth of all thrusters open for a whole period, in units of what keeping
      the slot is worth; 0.5 by default.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/FormationKeeping-v1", craft=4)
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, info["success"]
    ((46,), False)

    ## Version History

    - v1: a reward that no loss can raise: periods are worth something, and a loss costs a whole episode
    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = FormationKeeping
