"""`FormationAttitude-v1`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import FormationAttitude, Task
from thruster_envs.views.single import TaskEnv

__all__ = ["FormationAttitudeEnv"]


class FormationAttitudeEnv(TaskEnv):
    """Turn one craft of a formation to its attitude by pulses, while the scripted law flies the others.

    ## Description

    Cubesats with three pairs of pulsed plasma thrusters, a leader and its followers (Valdes 2008, chapters 5
    and 6; attitude alone). The leader holds its attitude; each follower turns from it by some 55 to 80
    degrees and holds that. A thruster fires at most once in a period of 1 s, with 0.1 mN for 16 ms; the two
    of a pair share a capacitor and never fire together. The requirements are those of the source: each
    component of the quaternion's error below 0.006 before 1000 s have passed and at the end, each relative
    rate below 6e-5 rad/s at the end. The gravity gradient and a small constant torque disturb. Discharges can
    fail in ways of their own, beside those of every thruster.

    The first follower is the agent's; the leader and the others fly by the law of the source, which knows of
    no fault. With every follower as an agent of its own this is the PettingZoo environment
    `thruster_envs.formation_attitude_v1`.

    An episode is as long as the missions of the source. For learning, `max_episode_steps=1200` keeps what
    matters, the turn and its settling, at less than half of the steps. One pulse hardly moves a craft, and
    pulses drawn anew in every period cancel: to explore, hold each action for some ten periods with
    `thruster_envs.views.HoldAction(env, 10)`, or `VectorHoldAction` for many worlds.

    ## Action Space

    `MultiDiscrete([3, 3, 3])`, a pulse about each axis in the coming period.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-2 | about x, y and z: 0 no pulse, 1 a pulse forwards, 2 a pulse backwards | 0 | 2 | 1 |

    With `action="duties"` it is `Box(-1, 1, (6,), float32)`: for each thruster a share, from -1 for none to 1
    for all, of the one pulse that there can be in a period. Shares are added up; a thruster fires when it is
    owed a whole pulse, and of two on one capacitor the one that is owed more. The observation then also has,
    before what a fault does, the share of a pulse that each thruster is owed (0 to 2).

    ## Observation Space

    `Box(..., (21,), float32)`. Quaternions are scalar first and not negative, of the
    body *from* what it is compared with. The leader, where it is an agent, takes the frame it started in for
    the leader. Values beyond a bound are clipped.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-3 | measured attitude from the target, as a quaternion | -1 | 1 | 1 |
    | 4-6 | measured attitude error | -1 | 1 | 0.05 rad |
    | 7-9 | measured rate relative to the leader | -5 | 5 | 0.001 rad/s |
    | 10-13 | target from the leader, as a quaternion | -1 | 1 | 1 |
    | 14-19 | whether each thruster was asked to fire last | 0 | 1 | 1 |
    | 20 | own fuel over the formation's mean, less one | -1 | 5 | 1 |

    With `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 21-26 | true impulse that asking each thruster adds | -2 | 2 | nominal impulse |
    | 27-32 | true impulse of each thruster unasked | -2 | 2 | nominal impulse |

    ## Rewards

    With *a* the angle from the target, *e* the share by which the own fuel is above the formation's mean,
    at most 1, and *p* the pulses of the period:

    reward = 7 / 3000 (1 - (a / pi + a / (a + 0.05 rad)) / 2 + `balance_price` (1 - e) +
    `pulse_price` (1 - p / 3)) - 7 (1 + `balance_price` + `pulse_price`) [lost]

    | Term | What | In a period | In an episode of 3000 |
    |---|---|---|---|
    | `pointing` | 7 / 3000 (1 - (a / pi + a / (a + 0.05 rad)) / 2) | 0 to 0.00233 | 0 to 7 |
    | `balance` | 7 / 3000 `balance_price` (1 - e) | 0 to 0.00005 | 0 to 0.14 |
    | `pulses` | 7 / 3000 `pulse_price` (1 - p / 3) | 0 to 0.00007 | 0 to 0.21 |
    | `lost` | - 7 (1 + `balance_price` + `pulse_price`) | -7.35 or 0 | -7.35 or 0 |

    - `pointing`: of being at the target
    - `balance`: of using no more fuel than the others
    - `pulses`: of pulses that are not fired
    - `lost`: a craft, as much as a whole episode can be worth

    No period without a loss returns less than 0: at whatever time, under whatever discount and whatever the
    time limit, a loss returns less than any way to go on without one. Doing nothing stays at the start and is
    not lost. To be lost takes some 1000 periods of pulses, a turn 700: a discount of 0.99 per period hardly
    sees either.

    ## Starting State

    All craft at rest and aligned with each other. The target of each follower is drawn: roll from 20 to 35
    degrees, pitch from 30 to 50, yaw from 40 to 60. The leader's is to stay. No faults unless `faults` says
    so.

    ## Episode End

    Terminates when any craft turns faster than 0.05 rad/s. Truncated after 3000 periods (50 minutes).

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the body rate is above 0.01 rad/s; 0 below.
    - `fault`: arrays over the fault slots of the own craft: `thruster` (from 1; 0 where none fails), `kind`
      (position in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor fails; 0 is an
      empty slot), `severity`, `onset` (s), `active`, `sensor` (position in `thruster_envs.faults.SENSORS`,
      from 1; 0 where none fails), `axis` (from 1; 0 for all three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of discharge of the own craft since the reset; a pulse is 0.016.
    - `score`: half for the share of the turn that is done, half for the share of the six requirements met
      now, that of a rate counted only where the attitude about the same axis is right; 0 where a craft is
      lost.
    - `success`: whether all six are met and the attitude settled within 1000 s of its target being set.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `attitude`: `error`, the angle from the target in rad; `requirements_met`, how many of the six;
      `settling_time`, s from the target being set until the attitude was within its tolerance for good, -1
      where it is not.

    ## Arguments

    ```python
    gym.make("thruster_envs/FormationAttitude-v1", faults=[{"craft": 2, "thruster": 1, "kind": "loss"}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`, with a
      discharge and a thruster for each way about each axis. On an elliptic orbit the gravity gradient goes
      with the cube of the distance, and the information has `orbit`, with the `true_anomaly`, rad.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own. Craft 1 is the leader, craft 2
      follower 1.
    - `observe_fault`: whether the truth about the own faults is added to the observation.
    - `fault_slots`: faults that each craft can have in an episode, 4 by default.
    - `craft`: number of craft, 2 to 16, the leader among them.
    - `action`: `"pulses"` or `"duties"`, as above.
    - `roll_degrees`, `pitch_degrees`, `yaw_degrees`: ranges of the angles of targets.
    - `retarget_interval`: control periods after which all followers get new targets; None for never. In the
      period in which a target is set, all information is still about the one before.
    - `gravity_gradient`: whether it acts. `bias_torque`: a constant torque on every craft, N m, body axes.
      `fault_bias`: torque that comes with a fault of a discharge, N m: for one that takes thrust, and for one
      that adds some.
    - `rate_soft_limit`: body rate from which on `cost` counts; `rate_limit`: at which a craft is lost, rad/s.
    - `balance_price`, `pulse_price`: see Rewards.
    - `max_substep`: longest integration sub-step, s; None for 1 s. `nonlinear`: without effect, nothing
      moves.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/FormationAttitude-v1", craft=4)
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, round(info["attitude"]["error"], 2)
    ((21,), 1.05)

    ## Version History

    - v1: a reward that no loss can raise: periods are worth something, and a loss costs a whole episode
    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = FormationAttitude
