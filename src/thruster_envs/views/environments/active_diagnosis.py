"""`ActiveDiagnosis-v1`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import ActiveDiagnosis, Task
from thruster_envs.views.single import TaskEnv

__all__ = ["ActiveDiagnosisEnv"]


class ActiveDiagnosisEnv(TaskEnv):
    """Say which thruster has failed and how, and fire test pulses to find out.

    ## Description

    One Orion craft holds its place under a pilot that knows of no fault, and hardly fires; so a thruster that
    is dead or weak hardly shows. At the beginning of each control period the agent declares what it believes,
    as in `FaultDiagnosis-v1`, and chooses a test pulse for each thruster. The pulses are added to the pilot's
    duties, no duty above 1, in the order of the thrusters; what is over the budget is not fired. The pilot
    goes on holding the craft: a test that turns or moves it is undone, which costs fuel and shows thrusters
    too.

    ## Action Space

    `MultiDiscrete([13, 6, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3])`.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0 | thruster that is declared faulty, numbered from 1; 0 declares that there is no fault | 0 | 12 | 1 |
    | 1 | its mode, as in `FaultDiagnosis-v1`; without meaning where there is no fault | 0 | 5 | 1 |
    | 2-13 | test pulse of each thruster: 0 for none, else which of `test_duties`, from 1 | 0 | 2 | 1 |

    ## Observation Space

    `Box(..., (68,), float32)`, as in `FaultDiagnosis-v1`, and what is left of the budget. The last duties are
    those that were commanded, tests included.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-2 | measured position relative to the slot | -5 | 5 | 10 m |
    | 3-5 | measured velocity | -5 | 5 | 0.2 m/s |
    | 6-8 | measured attitude error | -5 | 5 | 0.5 rad |
    | 9-11 | measured rate error | -5 | 5 | 0.2 rad/s |
    | 12 | time since the start | 0 | 1 | length of the flight |
    | 13-24 | last duties | 0 | 1 | 1 |
    | 25-30 | last measured rate change | -5 | 5 | authority per axis |
    | 31-36 | last expected rate change | -5 | 5 | authority per axis |
    | 37-48 | measured less expected rate change, projected on each thruster | -5 | 5 | control period |
    | 49-60 | whether each thruster was declared last | 0 | 1 | 1 |
    | 61-66 | whether each mode was declared last | 0 | 1 | 1 |
    | 67 | budget left | 0 | 1 | budget |

    With `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 68-79 | true delivered share of each thruster's on-time | -1 | 1 | 1 |
    | 80-91 | true opening of each thruster when closed | -1 | 1 | 1 |

    ## Rewards

    As in `FaultDiagnosis-v1`, each period is worth something or costs something, in shares of a flight of 120
    periods:

    reward = (`right_worth` [thruster right] - `wrong_mode_cost` [thruster right, mode wrong] - `delay_cost`
    [fault, none declared] - `wrong_name_cost` [fault, another thruster declared] - `false_alarm_cost` [no
    fault, one declared]) / 120 - `fuel_cost` (share of the budget used) - (10.5 + 5 left / 120) [lost]

    | Term | What | In a period | In a flight |
    |---|---|---|---|
    | `right` | `right_worth` / 120 where a faulty thruster is declared | 0 to 0.042 | 0 to 5 |
    | `delay` | - `delay_cost` / 120 where a fault acts and none is declared | -0.021 to 0 | -2.5 to 0 |
    | `false_alarm` | - `false_alarm_cost` / 120 where one is declared without need | -0.042 to 0 | -5 to 0 |
    | `wrong_name` | - `wrong_name_cost` / 120, or - `wrong_mode_cost` / 120 | -0.033 to 0 | -4 to 0 |
    | `fuel` | - `fuel_cost` times the share of the budget that tests use up | -0.5 to 0 | -0.5 to 0 |
    | `lost` | - 10.5 - 5 (share of the periods left) | -15.5 to 0 | -15.5 to 0 |

    - `right`: of a faulty thruster that is declared, the more the earlier
    - `delay`: of a fault that is not declared
    - `false_alarm`: of a fault that is declared and is not there; it costs more than to say nothing
    - `wrong_name`: of the wrong thruster, which costs more than to say nothing, or of the wrong mode
    - `fuel`: of test pulses
    - `lost`: of a flight that is lost before its end, whatever was declared: 10.5 is `right_worth`, the
      largest cost and `fuel_cost`, 5 the largest cost

    At whatever time and under whatever discount, to be lost returns less than to fly on without being lost.

    With several faults at a time it is right to name any of them. To declare no fault for a whole flight
    returns 0 without a fault, which is the most there is, and on average -1.5 with those of the default.

    ## Starting State

    Near the origin, dispersed uniformly by 1.5 m, 5 mm/s, 5 degrees and 1 mrad/s on each axis; the origin is
    the place to hold. Faults are drawn as in `FaultDiagnosis-v1`: by default with probability 0.8, one
    thruster in any mode, from some time of the first half of the flight on.

    ## Episode End

    Terminates when the craft is further than 500 m from its slot or turns faster than 1 rad/s. Truncated
    after 120 periods (10 minutes).

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the body rate is above 0.1 rad/s; 0 below.
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 where none fails), `kind` (position
      in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor fails; 0 is an empty slot),
      `severity`, `onset` (s), `active`, `sensor` (position in `thruster_envs.faults.SENSORS`, from 1; 0 where
      none fails), `axis` (from 1; 0 for all three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of open valve since the reset, the pilot's and those of the tests.
    - `score`: the mean credit for what was declared while a fault acted (1 for thruster and mode, 0.5 for the
      thruster alone), times the share of the time without a fault in which none was declared; so far. 0 for
      a flight that is lost.
    - `success`: whether what was declared last is right, without a false alarm on the way and without a loss.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `diagnosis`: `detected`, `delay`, `false_alarms`, `isolated`, `identified`, `thruster` and `mode` as in
      `FaultDiagnosis-v1`; `tested`: test pulses fired since the reset, thruster-seconds.

    ## Arguments

    ```python
    gym.make("thruster_envs/ActiveDiagnosis-v1", test_duties=(0.05, 0.2), budget=30.0)
    ```

    - `spacecraft`, `faults`, `observe_fault`, `fault_slots`, `nonlinear`, `max_substep`, `pilot`, `leg`,
      `right_worth`, `delay_cost`, `false_alarm_cost`, `wrong_name_cost`, `wrong_mode_cost`, `range_limit`,
      `rate_limit`: as in `FaultDiagnosis-v1`.
    - `reach`: half-size of the cube in which slots are drawn, m; 0 by default, so that the craft stays.
    - `test_duties`: the test pulses that there are, as duties; (0.1, 0.4) by default.
    - `budget`: test pulses of a flight, thruster-seconds; 60 by default.
    - `fuel_cost`: what it costs to use up the budget; 0.5 by default.
    - `soft_rate_limit`: body rate from which on `cost` counts, rad/s.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/ActiveDiagnosis-v1", faults=[], budget=4.0)
    >>> observation, info = env.reset(seed=1)
    >>> for _ in range(3):
    ...     observation, reward, terminated, truncated, info = env.step([0, 0, 2, 0] + 10 * [0])
    >>> info["diagnosis"]["tested"], info["score"], info["reward_terms"]["fuel"]
    (4.0, 1.0, 0.0)

    ## Version History

    - v1: the right thruster is worth something, so that to learn it pays before it is learnt well,
      and a flight that is lost costs more than any that is not
    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = ActiveDiagnosis
