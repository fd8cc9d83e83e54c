"""`MarsRendezvous-v1`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import MarsRendezvous, Task
from thruster_envs.views.single import TaskEnv

__all__ = ["MarsRendezvousEnv"]


class MarsRendezvousEnv(TaskEnv):
    """Bring a chaser about Mars over the last twenty metres to capture, thruster faults or not.

    ## Description

    The final translation of a Mars Sample Return rendezvous (Fonod et al. 2013): the chaser comes from behind
    along the V-bar, at 0.1 m/s, inside a corridor, and has to cross the capture plane near its centre, slowly
    and well pointed. Eight thrusters of 22 N give force and torque together. A command becomes one pulse per
    thruster, about one period of 0.1 s later, by a delay that nobody knows; thrust rises and falls with a lag
    of 20 ms. The chaser sees the target through a LIDAR (errors up to 1 mm) and its attitude through
    estimates, all one period old. It moves by the full two-body relative equations about Mars; differential
    gravity, drag and sunlight push it; its true mass, inertia, centre of mass and thrusts differ a little
    from the description.

    A thruster that is stuck open turns the chaser by ten degrees in about 25 s, against a pilot that knows of
    nothing, and pushes it out of the corridor within a minute. With `inhibit=True` the action also closes
    isolation valves and goes over to a spare set of thrusters. Where only the first set fails, as by default,
    whoever goes over at once is safe without any diagnosis; faults may strike the spare set as well, or a
    `spacecraft` may have none. Every number of the vehicle is MSR-A, a parameter set of this project: the
    source withholds them.

    ## Action Space

    `Box(-1, 1, (8,), float32)`, the open rate of each thruster in the coming period of 0.1 s. What is open
    for less than 5 ms stays shut.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-7 | open rate of each thruster: -1 stays shut, 0 opens for half the period, 1 for all | -1 | 1 | 1 |

    With `inhibit=True` there follow one number for each isolation valve, closed while it is above 0, and one
    for the spare branch, which takes over for good once it is above 0: `Box(-1, 1, (17,), float32)`. The
    valves are then those of the spare branch. A `spacecraft` without one has no number for it.

    ## Observation Space

    `Box(..., (36,), float32)`. Position and velocity in LVLH axes (x radial, y along-track, z cross-track),
    from the target; attitude error, rate error and rate changes in body axes. The attitude of the approach
    has x to the target, y against the orbit's normal and z to the planet. What is measured, filtered or
    expected is as old as navigation is slow; time, open rates, valves, branch and truth are those of now.
    *Authority* is the largest rate change that the healthy vehicle reaches on an axis in one period. Values
    beyond a bound are clipped.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-2 | measured relative position, whole approach | -5 | 5 | distance at the start |
    | 3-5 | measured relative position, close by | -5 | 5 | 1 m |
    | 6-8 | filtered relative velocity | -5 | 5 | 0.1 m/s |
    | 9-11 | measured attitude error | -5 | 5 | 0.1 rad |
    | 12-14 | measured rate error | -5 | 5 | 0.02 rad/s |
    | 15 | time to go | 0 | 1 | length of the episode |
    | 16-23 | last open rates | 0 | 1 | 1 |
    | 24-29 | last measured rate change | -5 | 5 | authority per axis |
    | 30-35 | last expected rate change | -5 | 5 | authority per axis |

    The velocity is that of an alpha-beta filter (0.3, 0.05) on the LIDAR, driven by the expected rate change.
    With `inhibit=True` there follow whether each isolation valve is closed (8) and, where there is one,
    whether the spare branch is in use (1), 0 or 1. With `observe_fault=True` there follow after that, for
    each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 36-43 | true delivered share of each thruster's on-time | -1 | 1 | 1 |
    | 44-51 | true opening of each thruster when closed | -1 | 1 | 1 |

    ## Rewards

    With *T* the periods of an episode, *o* the lateral offset, *a* the angle from the attitude of the
    approach, *w* the body rate, *u* the share of thruster time in which valves were open, *d* the distance,
    *D* that at the start and *t* the time since:

    reward = -(2 o / (o + 0.25 m) + 0.5 a / (a + 3 deg) + 0.5 w / (w + 0.5 deg/s) + 0.2 u) / T +
    4 (P - P before) + 4 (0.5 + 0.5 economy) [captured] - (3.2 left / T) [ended otherwise] -
    4 (0.5 + 0.5 badness) [missed or lost], with P = - max(d / D, 1 - t / (200 s))

    | Term | What | In a period | In an episode |
    |---|---|---|---|
    | `corridor` | - 2 o / (o + 0.25 m) / T | -2 / T to 0 | -2 to 0 |
    | `attitude` | - (0.5 a / (a + 3 deg) + 0.5 w / (w + 0.5 deg/s)) / T | -1 / T to 0 | -1 to 0 |
    | `fuel` | - 0.2 u / T | -0.2 / T to 0 | -0.2 to 0 |
    | `progress` | 4 (P - P before); P is - 1.5 when missed or lost | -6 to 4 | -2 to 4 |
    | `capture` | 4 (0.5 + 0.5 min(1, nominal / spent thruster-seconds)) | 0 to 4 | 0 to 4 |
    | `lost` | - 3.2 left / T, and - 4 (0.5 + 0.5 badness) | -7.2 to 0 | -7.2 to 0 |

    - `corridor`: of the way off the V-bar
    - `attitude`: of bad pointing and of turning
    - `fuel`: of open valves
    - `progress`: of the distance gained, as far as it is not ahead of the nominal approach; its terms sum to
      4 times the difference of the potential's ends, the last one - (D + 10 m) / D when missed or lost
    - `capture`: the more the fewer the thruster-seconds; the nominal ones are those of an open rate of 0.1 in
      all thrusters for the nominal time, 200 s
    - `lost`: at any end but a capture, what the periods left could have cost; and if the capture plane is
      crossed otherwise, or the chaser is lost, as much again as a capture is worth. The *badness* of a loss
      is 1; that of a miss the mean over its five requirements of how far each is exceeded, 1 from five
      times the tolerance on.

    At whatever time and under whatever discount, to be lost returns less than to fly on without being lost.
    To do nothing is to coast on, off the V-bar and past the target, which is a miss or a loss after some 2000
    periods: that returns more than any earlier loss, and less than to stop on the way or to retreat. A
    discount of 0.99 per period sees 10 s of an approach of 200 s.

    ## Starting State

    At `distance` (20 m) behind the target at 0.1 m/s towards it, dispersed uniformly by 0.1 m, 2 mm/s, 1
    degree and 0.02 degrees/s on each axis. Phase of the delays, place on the orbit, direction of sunlight and
    the true vehicle are drawn at every reset. No faults unless `faults` says so.

    ## Episode End

    Terminates when the chaser crosses the capture plane (y = 0): a capture if it is within 0.1 m of the
    centre, at most at 0.15 m/s along and 0.02 m/s across, within 3 degrees and 0.5 degrees/s. Also when it
    is 10 m farther from the target than `distance` (a retreat: safe, but no success); when it is lost,
    turning faster than 0.2 rad/s or within 2 m of the target outside of the corridor; and when one and a half
    nominal times are up (3000 periods). The corridor is 0.25 m about the V-bar at the capture plane and
    widens by 10 degrees. Never truncated.

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the lateral offset is above the half-width of the corridor; 0 inside,
      and farther from the target than `distance`.
    - `fault`: arrays over the fault slots: `thruster` (from 1, 9 to 16 on the redundant branch; 0 where none
      fails), `kind` (position in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor
      fails; 0 is an empty slot), `severity`, `onset` (s), `active` (on the branch that is in use), `sensor`
      (position in `thruster_envs.faults.SENSORS`, from 1; 0 where none fails), `axis` (from 1; 0 for all
      three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of open valve since the reset.
    - `score`: at capture 0.5, and 0.5 more for at most the thruster-seconds of an open rate of 0.1 in all
      thrusters for the nominal time, in inverse proportion for more; 0.25 for a retreat; 0 if missed or lost;
      else 0.25 times the share of the distance gained.
    - `success`: whether the target is captured.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `approach`: `retreated`; `safe`: neither missed nor lost, so far; `branch`: 0, or 1 for the spare one;
      `delay`: from the last command to the opening of its pulse, s, for each thruster, as it truly is, told
      to open or not; 0 at the reset; `state` (13): true position (m) and velocity (m/s) in LVLH axes,
      attitude from LVLH to the body (scalar first), inertial rate in body axes (rad/s).

    ## Arguments

    ```python
    gym.make("thruster_envs/MarsRendezvous-v1", faults=[{"thruster": 3, "kind": "stuck_on", "onset": 60.0}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`; one with a
      modulator, on a circular orbit without J2, which its disturbances have.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own. Thrusters 9 to 16 are those of the
      spare branch; what is wrong with them shows once it is in use. A pulse lasts 0.1 s at most, and an
      opening later than it is long loses it: the 0.5 to 2 s of `late_opening` that a distribution draws by
      default shut a thruster altogether.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the chaser can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations (the default) or by Hill's.
    - `max_substep`: longest integration sub-step, s; None for the control period.
    - `distance`: behind the target at the start, m; 2.5 to 1000.
    - `inhibit`: whether isolation valves, and the spare branch where there is one, are part of the action.
    - `navigation_delay`: age of what is observed, in control periods; 1 by default.
    - `disturbances`: whether differential gravity, drag and sunlight act.
    - `mass_error`, `inertia_error`, `thrust_error`: half-widths of the true mass, moments of inertia (all by
      one share) and thrust of each thruster, as shares; 0.01, 0.02 and 0.01 by default.
    - `centre_of_mass_error`: half-width of the true centre of mass on each axis, m; 0.01 by default.
    - `offset_tolerance`, `closing_tolerance`, `lateral_tolerance`, `attitude_tolerance`, `rate_tolerance`:
      what counts as captured, m, m/s, m/s, rad, rad/s.
    - `rate_limit`: body rate at which the chaser is lost, rad/s.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    The scripted pilot, which captures where nothing fails, flies like this:

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/MarsRendezvous-v1", distance=5.0)
    >>> observation, info = env.reset(seed=1)
    >>> worlds, terminated = env.unwrapped.worlds, False
    >>> while not terminated:
    ...     action = worlds.task.pilot_actions(worlds.state)[0, 0]
    ...     observation, reward, terminated, truncated, info = env.step(action)
    >>> info["success"], info["approach"]["safe"]
    (True, True)

    ## Version History

    - v1: a reward that no loss can raise: coming near pays only if the target is not missed or endangered
    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = MarsRendezvous
