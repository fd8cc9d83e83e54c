"""`FaultDiagnosis-v1`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import FaultDiagnosis, Task
from thruster_envs.views.single import TaskEnv

__all__ = ["FaultDiagnosisEnv"]


class FaultDiagnosisEnv(TaskEnv):
    """Watch a flight under a fixed pilot, and say which thruster has failed and how.

    ## Description

    One Orion craft flies from slot to slot under a pilot that knows of no fault: every 15 periods (75 s) the
    place where it should be changes, so that every thruster fires in every flight. At the beginning of each
    control period the agent sees what was commanded and what was measured, and declares what it believes: no
    fault, or one thruster in one mode. What it declares changes nothing in the flight. It is judged by what
    acts at that moment; a fault that has just begun cannot be known, so a delay of at least one period is
    the price of not guessing. Scatter of the thrust and coupling by the feed are what hides a fault. A fault
    of a sensor misleads the pilot and the agent; as long as no thruster has one, it is right to declare none.

    ## Action Space

    `MultiDiscrete([13, 6])`.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0 | thruster that is declared faulty, numbered from 1; 0 declares that there is no fault | 0 | 12 | 1 |
    | 1 | its mode; without meaning where there is no fault | 0 | 5 | 1 |

    The modes, `thruster_envs.faults.MODES`, group kinds and severities of faults by what is to be done about
    them:

    - 0, dead: `stuck_off`, `loss` or `intermittent`, of severity 0.9 or more
    - 1, weak: the same, of severity from 0.5 to below 0.9
    - 2, slightly weak: the same, of severity below 0.5
    - 3, leaking: `leak`, `stuck_on` or `bias`, of severity below 0.5
    - 4, stuck open: `leak`, `stuck_on` or `bias`, of severity 0.5 or more
    - 5, tilted or late: `misalignment`, `late_opening` or `sign`

    ## Observation Space

    `Box(..., (67,), float32)`. Position and velocity in LVLH axes x, y, z; attitude error, rate error and
    rate changes in body axes. *Authority* is the largest rate change that the healthy vehicle reaches on an
    axis in one period; values beyond a bound are clipped. *Projected on a thruster* is the on-time of that
    thruster alone that explains the rate change best.

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

    With `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 67-78 | true delivered share of each thruster's on-time | -1 | 1 | 1 |
    | 79-90 | true opening of each thruster when closed | -1 | 1 | 1 |

    ## Rewards

    Each period is worth something or costs something, in shares of a flight of 120 periods:

    reward = (`right_worth` [thruster right] - `wrong_mode_cost` [thruster right, mode wrong] - `delay_cost`
    [fault, none declared] - `wrong_name_cost` [fault, another thruster declared] - `false_alarm_cost` [no
    fault, one declared]) / 120

    | Term | What | In a period | In a flight |
    |---|---|---|---|
    | `right` | `right_worth` / 120 where a faulty thruster is declared | 0 to 0.042 | 0 to 5 |
    | `delay` | - `delay_cost` / 120 where a fault acts and none is declared | -0.021 to 0 | -2.5 to 0 |
    | `false_alarm` | - `false_alarm_cost` / 120 where one is declared without need | -0.042 to 0 | -5 to 0 |
    | `wrong_name` | - `wrong_name_cost` / 120, or - `wrong_mode_cost` / 120 | -0.033 to 0 | -4 to 0 |

    - `right`: of a faulty thruster that is declared, the more the earlier
    - `delay`: of a fault that is not declared
    - `false_alarm`: of a fault that is declared and is not there; it costs more than to say nothing
    - `wrong_name`: of the wrong thruster, which costs more than to say nothing, or of the wrong mode

    A flight that is lost before its end, in which the agent has no part, is charged at once what its last
    declaration costs, if it stood to the end; where it was right, nothing.

    With several faults at a time it is right to name any of them. To declare no fault for a whole flight
    returns 0 without a fault, which is the most there is, and on average -1.5 with those of the default.

    ## Starting State

    Near the origin, dispersed uniformly by 1.5 m, 5 mm/s, 5 degrees and 1 mrad/s on each axis; the first
    slot, like every later one, is drawn uniformly in a cube of half-size 5 m. By default a fault is drawn at
    every reset with probability 0.8, and begins in the first half of the flight: `stuck_off`; `loss` (twice
    as likely) of 0.3 to 0.9; `leak` of 0.1 to 0.5; `stuck_on` of 0.5 to 1; `misalignment` of 0.2 to 0.5 rad.

    ## Episode End

    Terminates when the craft is further than 500 m from its slot or turns faster than 1 rad/s. Under the
    scripted pilot no fault of the default distribution brings Orion to that; one that is stuck open mostly
    makes SPHERES turn so fast. Truncated after 120 periods (10 minutes).

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: 0, the agent has no part in the flight.
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 where none fails), `kind` (position
      in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor fails; 0 is an empty slot),
      `severity`, `onset` (s), `active`, `sensor` (position in `thruster_envs.faults.SENSORS`, from 1; 0 where
      none fails), `axis` (from 1; 0 for all three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of open valve since the reset, all of them the pilot's.
    - `score`: the mean credit for what was declared while a fault acted (1 for thruster and mode, 0.5 for the
      thruster alone), times the share of the time without a fault in which none was declared; so far.
    - `success`: whether what was declared last is right, without a false alarm on the way.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `state`: how the craft truly moves: `position` (m) and `velocity` (m/s) in LVLH axes, `attitude` from
      LVLH to the body (scalar first), `rate` (rad/s, inertial, body axes).
    - `diagnosis`: how it went. `detected`: whether the first fault has been noticed: a fault was declared
      that is not the false alarm which stood when it began. `delay`: from its onset to then, s; -1 if not
      yet. `false_alarms`: times that a fault, or another thruster's, was declared while none acted.
      `isolated`, `identified`: whether what was declared last had the thruster, and the mode too, of a fault
      that acted. `thruster`, `mode`: what would be right to declare now (the fault that began first).

    ## Arguments

    ```python
    gym.make("thruster_envs/FaultDiagnosis-v1", faults={"probability": 1.0, "kinds": ["leak"]})
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`. Its orbit
      may be elliptic or have J2: the information then has `orbit`, with the `true_anomaly`, rad.
    - `faults`: None for the default distribution, `[]` for no faults, a `Fault`, a list of them, or a
      `FaultDistribution`; also as plain mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the craft can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations instead of the linear ones, Hill's
      or those of an elliptic orbit; with J2 it always does.
    - `max_substep`: longest integration sub-step, s; None lets each craft take as many as its turning needs.
    - `pilot`: None for the scripted pilot, or a `thruster_envs.protocols.Pilot`: a callable that turns what
      the flight software of all worlds sees into their duties. An `EnvSpec` with one does not go into JSON.
    - `reach`: half-size of the cube in which slots are drawn, m; None (5 m on Orion) for that from which the
      scripted pilot goes back to the origin with a third of the vehicle's authority. `leg`: periods between
      two slots.
    - `right_worth`, `delay_cost`, `false_alarm_cost`, `wrong_name_cost`, `wrong_mode_cost`: what each
      is worth or costs if it lasts for a whole flight; 5, 2.5, 5, 4 and 2.5 by default.
    - `range_limit`, `rate_limit`: bounds, m and rad/s.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/FaultDiagnosis-v1", faults=[{"thruster": 3, "kind": "stuck_off"}])
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step([3, 0])
    >>> info["score"], info["diagnosis"]["identified"], round(reward, 4)
    (1.0, True, 0.0417)

    ## Version History

    - v1: the right thruster is worth something, so that to learn it pays before it is learnt well
    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = FaultDiagnosis
