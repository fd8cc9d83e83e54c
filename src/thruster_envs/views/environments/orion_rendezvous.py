"""`OrionRendezvous-v1`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import OrionRendezvous, Task
from thruster_envs.views.single import TaskEnv

__all__ = ["OrionRendezvousEnv"]


class OrionRendezvousEnv(TaskEnv):
    """Bring a craft from 300 m to rest at the target in half an orbit, by commanding its thrusters.

    ## Description

    The mission of Yang 2003, chapter 6, in six degrees of freedom: the craft starts 300 m radially above the
    target, nearly at rest and nearly aligned with the local-vertical frame (LVLH: x radial, y along-track, z
    cross-track), and has to be at the origin, at rest and aligned, when half an orbit has passed. It moves by
    the equations of Hill (or, with `nonlinear=True`, by the full two-body relative equations), and navigates
    by noisy relative measurements. Thrusters share one feed, scatter from firing to firing, and may fail; a
    policy can tell from the difference between the expected and the measured rate change.

    ## Action Space

    `Box(-1, 1, (12,), float32)`, the duty of each thruster in the coming period of 5 s.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-11 | duty of each thruster: -1 stays shut, 0 opens for half the period, 1 for all of it | -1 | 1 | 1 |

    ## Observation Space

    `Box(..., (37,), float32)`. Position and velocity in LVLH axes x, y, z; attitude error, rate error and
    rate changes in body axes. *Authority* is the largest rate change that the healthy vehicle reaches on an
    axis in one period. Values beyond a bound are clipped.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-2 | measured relative position | -5 | 5 | 300 m |
    | 3-5 | measured relative velocity | -5 | 5 | 0.5 m/s |
    | 6-8 | measured attitude error | -5 | 5 | 0.5 rad |
    | 9-11 | measured rate error | -5 | 5 | 0.05 rad/s |
    | 12 | time to go | 0 | 1 | length of the episode |
    | 13-24 | last duties | 0 | 1 | 1 |
    | 25-30 | last measured rate change | -5 | 5 | authority per axis |
    | 31-36 | last expected rate change | -5 | 5 | authority per axis |

    With `observe_fault=True` there follow, for each thruster:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 37-48 | true delivered share of each thruster's on-time | -1 | 1 | 1 |
    | 49-60 | true opening of each thruster when closed | -1 | 1 | 1 |

    ## Rewards

    With *T* the periods of an episode, *u* the share of thruster time in which valves were open, and *x* what
    is still to be paid: the two-impulse delta-v to go (of the Hill equations, or those of an elliptic orbit,
    in closed form, m/s), and rates and attitude errors at their worth in m/s, over the delta-v of the
    undisturbed mission:

    reward = - 2 u / T + 5 (P - P before) + 5 (0.5 + 0.5 economy) [arrived] - (5 + 2 left / T) [lost], with
    P = - x / (1 + x)

    | Term | What | In a period | In an episode |
    |---|---|---|---|
    | `fuel` | - 2 u / T | -2 / T to 0 | -2 to 0 |
    | `progress` | 5 (P - P before); P is -1 at a loss | -5 to 5 | -2.5 to 2.5 |
    | `arrival` | 5 (0.5 + 0.5 min(1, mission delta-v / spent)) | 0 to 5 | 0 to 5 |
    | `lost` | - 5 - 2 left / T | -7 to 0 | -7 to 0 |

    - `fuel`: of valves that are open
    - `progress`: of a potential from 0, nothing to pay, down to -1; its terms sum to 5 times the difference
      of its ends
    - `arrival`: in the terminal box when the time is up, the more the less fuel was spent
    - `lost`: out of bounds, at least as much as all that could still come

    At whatever time and under whatever discount, to be lost returns less than to fly on without being lost.
    To do nothing is to drift out of range, which loses the craft after some 320 periods: that returns more
    than any earlier loss, and less than staying near the start.

    ## Starting State

    At `start` (300, 0, 0) m, dispersed uniformly by 5 m, 5 mm/s, 5 degrees and 1 mrad/s on each axis. No
    faults unless `faults` says so.

    ## Episode End

    Terminates when the time is up (571 periods: half an orbit of 2 pi / 0.0011 rad/s in periods of 5 s), or
    when the craft is further than 2000 m away or turns faster than 1 rad/s. Never truncated.

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the body rate is above 0.1 rad/s; 0 below.
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 where none fails), `kind` (position
      in `thruster_envs.faults.KINDS`, from 1, or in `SENSOR_KINDS` where a sensor fails; 0 is an empty slot),
      `severity`, `onset` (s), `active`, `sensor` (position in `thruster_envs.faults.SENSORS`, from 1; 0 where
      none fails), `axis` (from 1; 0 for all three).
    - `stale`: for each of `thruster_envs.faults.SENSORS`, whether its last measurement dropped out, so that
      the one before it is seen once more.
    - `fuel`: thruster-seconds of open valve since the reset.
    - `score`: in the terminal box 0.5, and up to 0.5 more for economy; outside it up to 0.5 for distance
      gained; 0 out of bounds.
    - `success`: whether the craft is in the terminal box: within 2 m, 0.02 m/s, 5 degrees, 0.5 degrees/s.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `state`: how the craft truly moves: `position` (m) and `velocity` (m/s) in LVLH axes, `attitude` from
      LVLH to the body (scalar first), `rate` (rad/s, inertial, body axes).

    ## Arguments

    ```python
    gym.make("thruster_envs/OrionRendezvous-v1", faults=[{"thruster": 3, "kind": "stuck_off"}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`. Its orbit
      may be elliptic or have J2: the information then has `orbit`, with the `true_anomaly`, rad.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the craft can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations instead of the linear ones, Hill's
      or those of an elliptic orbit; with J2 it always does.
    - `max_substep`: longest integration sub-step, s; None lets each craft take as many as its turning needs.
    - `start`: relative position at the start, m, LVLH.
    - `position_tolerance`, `velocity_tolerance`, `attitude_tolerance`, `rate_tolerance`: half-sizes of the
      terminal box, m, m/s, rad, rad/s.
    - `range_limit`, `rate_limit`: bounds, m and rad/s. `rate_soft_limit`: body rate from which on `cost`
      counts.
    - `orbits`: time for the rendezvous, in orbits.
    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/OrionRendezvous-v1", faults=[{"thruster": 3, "kind": "stuck_off"}])
    >>> observation, info = env.reset(seed=1)
    >>> round(300.0 * float(observation[0]), -1), info["fault"]["active"].tolist()
    (300.0, [True, False, False, False])

    ## Version History

    - v1: a reward that no loss can raise: the potential is bounded, and a loss costs what was left
    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = OrionRendezvous
