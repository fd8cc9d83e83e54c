"""The environments by name, each with the page that documents it."""

from __future__ import annotations

from typing import Any, ClassVar

from thruster_envs.tasks import (
    ActiveDiagnosis,
    FaultDiagnosis,
    FormationAttitude,
    FormationKeeping,
    MarsRendezvous,
    OrionRendezvous,
    PulseDiagnosis,
    Task,
    ThrusterMapping,
)
from thruster_envs.views.single import TaskEnv
from thruster_envs.views.vector import TaskVectorEnv


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
    | 54-65 | true delivered share of each thruster's on-time | 0 | 1 | 1 |
    | 66-77 | true opening of each thruster when closed | 0 | 1 | 1 |

    ## Rewards

    Minus the objective of the linear program, as the true vehicle delivers it, as a share of what it costs to
    miss the whole authority on every axis. With the command *c*, the delivered rate change *d*, the on-times
    *u* in s:

    - `miss`: - slack_cost . |c - d| / (slack_cost . authority), dimensionless
    - `fuel`: - fuel_cost . u / (slack_cost . authority), dimensionless

    where (fuel_cost, slack_cost) = `thruster_envs.spacecraft.objective_weights(effectiveness, period)`: a
    miss always costs more than the fuel that would avoid it.

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
      `thruster_envs.faults.KINDS`, from 1), `severity`, `active`.
    - `fuel`: thruster-seconds of open valve since the reset.
    - `score`: one minus the objective over that of doing nothing, summed over the episode so far, in 0..1.
    - `success`: whether the score is at least 0.9.

    ## Arguments

    ```python
    gym.make("thruster_envs/ThrusterMapping-v0", spacecraft="orion", faults=None, observe_fault=False)
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`.
    - `faults`: None for the default distribution, `[]` for no faults, a `Fault`, a list of them, or a
      `FaultDistribution`; also as plain mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the vehicle can have in an episode.
    - `nonlinear`, `max_substep`: as in the other environments; without effect here, where nothing moves.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

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


class ThrusterMappingVectorEnv(TaskVectorEnv):
    """Many worlds of thruster mapping; :class:`ThrusterMappingEnv` describes one."""

    task_type: ClassVar[type[Task]] = ThrusterMapping


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
    | 37-48 | true delivered share of each thruster's on-time | 0 | 1 | 1 |
    | 49-60 | true opening of each thruster when closed | 0 | 1 | 1 |

    ## Rewards

    In units of the delta-v of the undisturbed mission (two impulses from `start`, sum of absolute
    components):

    - `fuel`: - (thruster-seconds of the period) times (mean thrust / mass), m/s, over that delta-v
    - `progress`: the change of a potential: minus the two-impulse delta-v still to go (of the Hill equations,
      in closed form, m/s), and minus rates and attitude errors at their worth in m/s, over that delta-v
    - `arrival`: 1 if the craft is in the terminal box when the time is up; -1 if it goes out of bounds

    The potential makes the reward dense and leaves the best policy as it was, but for the end that it starts
    from.

    ## Starting State

    At `start` (300, 0, 0) m, dispersed uniformly by 5 m, 5 mm/s, 5 degrees and 1 mrad/s on each axis. No
    faults unless `faults` says so.

    ## Episode End

    Terminates when the time is up (571 periods: half an orbit of 2 pi / 0.0011 rad/s in periods of 5 s), or
    when the craft is further than 2000 m away or turns faster than 1 rad/s. Never truncated.

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the body rate is above 0.1 rad/s; 0 below.
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 is an empty slot), `kind` (position in
      `thruster_envs.faults.KINDS`, from 1), `severity`, `active`.
    - `fuel`: thruster-seconds of open valve since the reset.
    - `score`: in the terminal box 0.5, and up to 0.5 more for economy; outside it up to 0.5 for distance
      gained; 0 out of bounds.
    - `success`: whether the craft is in the terminal box: within 2 m, 0.02 m/s, 5 degrees, 0.5 degrees/s.

    ## Arguments

    ```python
    gym.make("thruster_envs/OrionRendezvous-v0", faults=[{"thruster": 3, "kind": "stuck_off"}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the craft can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations instead of Hill's.
    - `max_substep`: longest integration sub-step, s; None lets each craft take as many as its turning needs.
    - `start`: relative position at the start, m, LVLH.
    - `position_tolerance`, `velocity_tolerance`, `attitude_tolerance`, `rate_tolerance`: half-sizes of the
      terminal box, m, m/s, rad, rad/s.
    - `range_limit`, `rate_limit`: bounds, m and rad/s. `rate_soft_limit`: body rate from which on `cost`
      counts.
    - `orbits`: time for the rendezvous, in orbits.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/OrionRendezvous-v0", faults=[{"thruster": 3, "kind": "stuck_off"}])
    >>> observation, info = env.reset(seed=1)
    >>> round(300.0 * float(observation[0]), -1), info["fault"]["active"].tolist()
    (300.0, [True, False, False, False])

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = OrionRendezvous


class OrionRendezvousVectorEnv(TaskVectorEnv):
    """Many worlds of the rendezvous; :class:`OrionRendezvousEnv` describes one."""

    task_type: ClassVar[type[Task]] = OrionRendezvous


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
    isolation valves and goes over to a spare set of thrusters. Every number of the vehicle is MSR-A, a
    parameter set of this project: the source withholds them.

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
    has x to the target, y against the orbit's normal and z to the planet. Everything but time and open rates
    is as old as navigation is slow. *Authority* is the largest rate change that the healthy vehicle reaches
    on an axis in one period. Values beyond a bound are clipped.

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
    | 36-43 | true delivered share of each thruster's on-time | 0 | 1 | 1 |
    | 44-51 | true opening of each thruster when closed | 0 | 1 | 1 |

    ## Rewards

    A *nominal time* is that of the approach at constant speed, 200 s.

    - `corridor`: - min(lateral offset / 1 m, 1), as a mean over the nominal time
    - `attitude`: - 0.5 min(angle from the attitude of the approach / 10 degrees, 1), likewise
    - `fuel`: - 0.25 times the thruster-seconds of the period over those of an open rate of 0.1 in all
      thrusters for the nominal time
    - `progress`: the distance gained, as a share of that at the start
    - `capture`: 1 at capture; -1 if the capture plane is crossed otherwise, or the chaser is lost

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
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 is an empty slot), `kind` (position in
      `thruster_envs.faults.KINDS`, from 1), `severity`, `active` (no longer once the spare branch has taken
      over, which no fault strikes).
    - `fuel`: thruster-seconds of open valve since the reset.
    - `score`: at capture 0.5, and up to 0.5 more for economy; 0.25 for a retreat; 0 if missed or lost; else
      0.25 times the share of the distance gained.
    - `success`: whether the target is captured.
    - `approach`: `retreated`; `safe`: neither missed nor lost, so far; `branch`: 0, or 1 for the spare one;
      `delay`: from command to opening of each thruster's last pulse, s, as it truly was; 0 before the first.

    ## Arguments

    ```python
    gym.make("thruster_envs/MarsRendezvous-v0", faults=[{"thruster": 3, "kind": "stuck_on", "onset": 60.0}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`; one with a
      modulator.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the chaser can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations (the default) or by Hill's.
    - `max_substep`: longest integration sub-step, s; None for the control period.
    - `distance`: behind the target at the start, m; 2 to 1000.
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

    The scripted pilot, which captures where nothing fails, flies like this:

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/MarsRendezvous-v0", distance=5.0)
    >>> observation, info = env.reset(seed=1)
    >>> worlds, terminated = env.unwrapped.worlds, False
    >>> while not terminated:
    ...     action = worlds.task.pilot_actions(worlds.state)[0, 0]
    ...     observation, reward, terminated, truncated, info = env.step(action)
    >>> info["success"], info["approach"]["safe"]
    (True, True)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = MarsRendezvous


class MarsRendezvousVectorEnv(TaskVectorEnv):
    """Many approaches about Mars; :class:`MarsRendezvousEnv` describes one."""

    task_type: ClassVar[type[Task]] = MarsRendezvous


class FormationKeepingEnv(TaskEnv):
    """Keep one craft of a formation in its slot, while the scripted pilot flies the others.

    ## Description

    Three Orion craft (two to eight) keep slots that lie evenly on a circular relative orbit of 50 m about an
    empty reference point. Free motion follows that orbit without fuel, so what is to be flown against is
    dispersion, sensor noise, firing scatter, and faults. The fuel bill is shared. The first craft is the
    agent's; the others fly with the suite's scripted pilot, which knows of no fault. With every craft as an
    agent of its own this is the PettingZoo environment `thruster_envs.formation_keeping_v0`.

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
    | 43-54 | true delivered share of each thruster's on-time | 0 | 1 | 1 |
    | 55-66 | true opening of each thruster when closed | 0 | 1 | 1 |

    ## Rewards

    - `tracking`: - min(distance from the slot / 10 m, 1)
    - `attitude`: - 0.5 min(angle from LVLH / 1 rad, 1)
    - `fuel`: - `fuel_price` times the mean over all craft of the share of thruster time in which valves were
      open

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
    - `fault`: arrays over the fault slots of the own craft: `thruster` (from 1; 0 is an empty slot), `kind`
      (position in `thruster_envs.faults.KINDS`, from 1), `severity`, `active`.
    - `fuel`: thruster-seconds of open valve of the own craft since the reset.
    - `score`: share of the steps so far after which the craft was within 1 m of its slot.
    - `success`: whether the score is at least 0.8, without any cost on the way and without a craft lost.

    ## Arguments

    ```python
    gym.make("thruster_envs/FormationKeeping-v0", craft=4, faults=[{"thruster": 5, "kind": "leak"}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`.
    - `faults`: None for no faults, a `Fault`, a list of them, or a `FaultDistribution`; also as plain
      mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the own faults is added to the observation.
    - `fault_slots`: faults that each craft can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations instead of Hill's.
    - `max_substep`: longest integration sub-step, s; None lets each craft take as many as its turning needs.
    - `craft`: number of craft, 2 to 8.
    - `radius`: of the relative orbit, m. `slot_tolerance`: distance within which a slot counts as kept, m.
    - `keep_out`: distance between craft below which `cost` counts, m.
    - `range_limit`, `rate_limit`: bounds, m and rad/s.
    - `fuel_price`: worth of all thrusters open for a whole period, in units of the largest tracking penalty.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/FormationKeeping-v0", craft=4)
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, info["success"]
    ((46,), False)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = FormationKeeping
    fixed: ClassVar[dict[str, Any]] = {"commanded": 1}


class FormationKeepingVectorEnv(TaskVectorEnv):
    """Many formations with one commanded craft each; :class:`FormationKeepingEnv` describes one."""

    task_type: ClassVar[type[Task]] = FormationKeeping
    fixed: ClassVar[dict[str, Any]] = {"commanded": 1}


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
    `thruster_envs.formation_attitude_v0`.

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
    | 21-26 | true impulse that asking each thruster adds | 0 | 2 | nominal impulse |
    | 27-32 | true impulse of each thruster unasked | 0 | 2 | nominal impulse |

    ## Rewards

    - `pointing`: - (a / (1 rad) + a / (a + 0.05 rad)) / 2, with the angle a from the target
    - `balance`: - `balance_price` times the share by which the own fuel is above the formation's mean, at
      most 1
    - `pulses`: - `pulse_price` times the pulses of the period, over 3

    ## Starting State

    All craft at rest and aligned with each other. The target of each follower is drawn: roll from 20 to 35
    degrees, pitch from 30 to 50, yaw from 40 to 60. The leader's is to stay. No faults unless `faults` says
    so.

    ## Episode End

    Terminates when any craft turns faster than 0.05 rad/s. Truncated after 3000 periods (50 minutes).

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the body rate is above 0.01 rad/s; 0 below.
    - `fault`: arrays over the fault slots of the own craft: `thruster` (from 1; 0 is an empty slot), `kind`
      (position in `thruster_envs.faults.KINDS`, from 1), `severity`, `active`.
    - `fuel`: thruster-seconds of discharge of the own craft since the reset; a pulse is 0.016.
    - `score`: half for the share of the turn that is done, half for the share of the six requirements met
      now, that of a rate counted only where the attitude about the same axis is right; 0 where a craft is
      lost.
    - `success`: whether all six are met and the attitude settled within 1000 s of its target being set.
    - `attitude`: `error`, the angle from the target in rad; `requirements_met`, how many of the six;
      `settling_time`, s from the target being set until the attitude was within its tolerance for good, -1
      where it is not.

    ## Arguments

    ```python
    gym.make("thruster_envs/FormationAttitude-v0", faults=[{"craft": 2, "thruster": 1, "kind": "loss"}])
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`, with a
      discharge and a thruster for each way about each axis.
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

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/FormationAttitude-v0", craft=4)
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, round(info["attitude"]["error"], 2)
    ((21,), 1.05)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = FormationAttitude
    fixed: ClassVar[dict[str, Any]] = {"command_leader": False, "commanded": 1}


class FormationAttitudeVectorEnv(TaskVectorEnv):
    """Many formations with one commanded follower each; :class:`FormationAttitudeEnv` describes one."""

    task_type: ClassVar[type[Task]] = FormationAttitude
    fixed: ClassVar[dict[str, Any]] = {"command_leader": False, "commanded": 1}


class FaultDiagnosisEnv(TaskEnv):
    """Watch a flight under a fixed pilot, and say which thruster has failed and how.

    ## Description

    One Orion craft flies from slot to slot under a pilot that knows of no fault: every 15 periods (75 s) the
    place where it should be changes, so that every thruster fires in every flight. At the beginning of each
    control period the agent sees what was commanded and what was measured, and declares what it believes: no
    fault, or one thruster in one mode. What it declares changes nothing in the flight. It is judged by what
    acts at that moment; a fault that has just begun cannot be known, so a delay of at least one period is
    the price of not guessing. Scatter of the thrust and coupling by the feed are what hides a fault.

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
    - 3, leaking: `leak` or `stuck_on`, of severity below 0.5
    - 4, stuck open: `leak` or `stuck_on`, of severity 0.5 or more
    - 5, tilted or late: `misalignment` or `late_opening`

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
    | 67-78 | true delivered share of each thruster's on-time | 0 | 1 | 1 |
    | 79-90 | true opening of each thruster when closed | 0 | 1 | 1 |

    ## Rewards

    A sum of costs, each in shares of a flight of 120 periods:

    - `delay`: - `delay_cost` / 120 where a fault acts and none is declared
    - `false_alarm`: - `false_alarm_cost` / 120 where no fault acts and one is declared
    - `wrong_name`: - `wrong_name_cost` / 120 where a fault acts and a thruster without one is declared;
      - `wrong_mode_cost` / 120 where the thruster is right and the mode is not

    A flight that is lost before its end is charged at once as if the last declaration stood to its end. With
    several faults at a time it is right to name any of them.

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
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 is an empty slot), `kind` (position in
      `thruster_envs.faults.KINDS`, from 1), `severity`, `active`.
    - `fuel`: thruster-seconds of open valve since the reset, all of them the pilot's.
    - `score`: the mean credit for what was declared while a fault acted (1 for thruster and mode, 0.5 for the
      thruster alone), times the share of the time without a fault in which none was declared; so far.
    - `success`: whether what was declared last is right, without a false alarm on the way.
    - `diagnosis`: how it went. `detected`: whether the first fault has been noticed: a fault was declared
      that is not the false alarm which stood when it began. `delay`: from its onset to then, s; -1 if not
      yet. `false_alarms`: times that a fault, or another thruster's, was declared while none acted.
      `isolated`, `identified`: whether what was declared last had the thruster, and the mode too, of a fault
      that acted. `thruster`, `mode`: what would be right to declare now (the fault that began first).

    ## Arguments

    ```python
    gym.make("thruster_envs/FaultDiagnosis-v0", faults={"probability": 1.0, "kinds": ["leak"]})
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`.
    - `faults`: None for the default distribution, `[]` for no faults, a `Fault`, a list of them, or a
      `FaultDistribution`; also as plain mappings. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the faults is added to the observation.
    - `fault_slots`: faults that the craft can have in an episode, 4 by default.
    - `nonlinear`: whether to fly by the full two-body relative equations instead of Hill's.
    - `max_substep`: longest integration sub-step, s; None lets each craft take as many as its turning needs.
    - `pilot`: None for the scripted pilot, or a `thruster_envs.protocols.Pilot`: a callable that turns what
      the flight software of all worlds sees into their duties. An `EnvSpec` with one does not go into JSON.
    - `reach`: half-size of the cube in which slots are drawn, m; None (5 m on Orion) for that from which the
      scripted pilot goes back to the origin with a third of the vehicle's authority. `leg`: periods between
      two slots.
    - `delay_cost`, `false_alarm_cost`, `wrong_name_cost`, `wrong_mode_cost`: what each costs if it lasts for
      a whole flight; 1, 2, 1.5 and 0.5 by default.
    - `range_limit`, `rate_limit`: bounds, m and rad/s.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/FaultDiagnosis-v0", faults=[{"thruster": 3, "kind": "stuck_off"}])
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step([3, 0])
    >>> info["score"], info["diagnosis"]["identified"], reward
    (1.0, True, 0.0)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = FaultDiagnosis


class FaultDiagnosisVectorEnv(TaskVectorEnv):
    """Many flights to be diagnosed; :class:`FaultDiagnosisEnv` describes one."""

    task_type: ClassVar[type[Task]] = FaultDiagnosis


class ActiveDiagnosisEnv(TaskEnv):
    """Say which thruster has failed and how, and fire test pulses to find out.

    ## Description

    One Orion craft holds its place under a pilot that knows of no fault, and hardly fires; so a thruster that
    is dead or weak hardly shows. At the beginning of each control period the agent declares what it believes,
    as in `FaultDiagnosis-v0`, and chooses a test pulse for each thruster. The pulses are added to the pilot's
    duties, no duty above 1, in the order of the thrusters; what is over the budget is not fired. The pilot
    goes on holding the craft: a test that turns or moves it is undone, which costs fuel and shows thrusters
    too.

    ## Action Space

    `MultiDiscrete([13, 6, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3])`.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0 | thruster that is declared faulty, numbered from 1; 0 declares that there is no fault | 0 | 12 | 1 |
    | 1 | its mode, as in `FaultDiagnosis-v0`; without meaning where there is no fault | 0 | 5 | 1 |
    | 2-13 | test pulse of each thruster: 0 for none, else which of `test_duties`, from 1 | 0 | 2 | 1 |

    ## Observation Space

    `Box(..., (68,), float32)`, as in `FaultDiagnosis-v0`, and what is left of the budget. The last duties are
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
    | 68-79 | true delivered share of each thruster's on-time | 0 | 1 | 1 |
    | 80-91 | true opening of each thruster when closed | 0 | 1 | 1 |

    ## Rewards

    As in `FaultDiagnosis-v0`, in shares of a flight of 120 periods, and the fuel of the tests:

    - `delay`: - `delay_cost` / 120 where a fault acts and none is declared
    - `false_alarm`: - `false_alarm_cost` / 120 where no fault acts and one is declared
    - `wrong_name`: - `wrong_name_cost` / 120 where a fault acts and a thruster without one is declared;
      - `wrong_mode_cost` / 120 where the thruster is right and the mode is not
    - `fuel`: - `fuel_cost` times the share of the budget that the test pulses of the period use up

    A flight that is lost before its end is charged at once as if the last declaration stood to its end. With
    several faults at a time it is right to name any of them.

    ## Starting State

    Near the origin, dispersed uniformly by 1.5 m, 5 mm/s, 5 degrees and 1 mrad/s on each axis; the origin is
    the place to hold. Faults are drawn as in `FaultDiagnosis-v0`: by default with probability 0.8, one
    thruster in any mode, from some time of the first half of the flight on.

    ## Episode End

    Terminates when the craft is further than 500 m from its slot or turns faster than 1 rad/s. Truncated
    after 120 periods (10 minutes).

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: by how much, as a share, the body rate is above 0.1 rad/s; 0 below.
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 is an empty slot), `kind` (position in
      `thruster_envs.faults.KINDS`, from 1), `severity`, `active`.
    - `fuel`: thruster-seconds of open valve since the reset, the pilot's and those of the tests.
    - `score`: the mean credit for what was declared while a fault acted (1 for thruster and mode, 0.5 for the
      thruster alone), times the share of the time without a fault in which none was declared; so far.
    - `success`: whether what was declared last is right, without a false alarm on the way.
    - `diagnosis`: `detected`, `delay`, `false_alarms`, `isolated`, `identified`, `thruster` and `mode` as in
      `FaultDiagnosis-v0`; `tested`: test pulses fired since the reset, thruster-seconds.

    ## Arguments

    ```python
    gym.make("thruster_envs/ActiveDiagnosis-v0", test_duties=(0.05, 0.2), budget=30.0)
    ```

    - `spacecraft`, `faults`, `observe_fault`, `fault_slots`, `nonlinear`, `max_substep`, `pilot`, `leg`,
      `delay_cost`, `false_alarm_cost`, `wrong_name_cost`, `wrong_mode_cost`, `range_limit`, `rate_limit`: as
      in `FaultDiagnosis-v0`.
    - `reach`: half-size of the cube in which slots are drawn, m; 0 by default, so that the craft stays.
    - `test_duties`: the test pulses that there are, as duties; (0.1, 0.4) by default.
    - `budget`: test pulses of a flight, thruster-seconds; 60 by default.
    - `fuel_cost`: what it costs to use up the budget; 0.1 by default.
    - `soft_rate_limit`: body rate from which on `cost` counts, rad/s.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> env = gym.make("thruster_envs/ActiveDiagnosis-v0", faults=[], budget=4.0)
    >>> observation, info = env.reset(seed=1)
    >>> for _ in range(3):
    ...     observation, reward, terminated, truncated, info = env.step([0, 0, 2, 0] + 10 * [0])
    >>> info["diagnosis"]["tested"], info["score"], info["reward_terms"]["fuel"]
    (4.0, 1.0, 0.0)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = ActiveDiagnosis


class ActiveDiagnosisVectorEnv(TaskVectorEnv):
    """Many flights to be tested; :class:`ActiveDiagnosisEnv` describes one."""

    task_type: ClassVar[type[Task]] = ActiveDiagnosis


class PulseDiagnosisEnv(TaskEnv):
    """See the voltage and the current of a plasma thruster's pulse, and say whether and how it has failed.

    ## Description

    A pulsed plasma thruster fires once a second and may degrade: its slug of plasma gets lighter, sediment
    narrows its electrodes, or its circuit conducts less (Valdes 2008, chapter 4). The agent sees the last
    pulse by 64 samples each of the capacitor's voltage and of the discharge current, every 0.2 us from its
    beginning on, and declares what it was. It is judged by what that pulse truly was, then the next one is
    fired. A pulse is *faulty* if its true thrust is below 85 % or above 115 % of the nominal one, and has the
    fault that by itself would take the thrust furthest off. The charge scatters from pulse to pulse and takes
    the thrust off by up to 4 %; it makes no pulse faulty by itself.

    Voltage and current depend on two numbers only, which a light slug and narrow electrodes change alike. So
    one pulse tells resistance from both, but not these from each other, although the thrust falls with the
    one and rises with the other: a slug of half the mass, still healthy, gives the waveforms of electrodes
    that are faulty by their sediment. What a fault has grown from, and how, tells more; a measured thrust
    (`observe_thrust`) tells all.

    ## Action Space

    `MultiDiscrete([4])`.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0 | what the last pulse was | 0 | 3 | 1 |

    - 0, healthy
    - 1, `propellant_loss`: too light a slug, less thrust
    - 2, `electrode_sediment`: too narrow electrodes, more thrust
    - 3, `conductivity_loss`: too much resistance, less thrust

    ## Observation Space

    `Box(..., (132,), float32)`. The noise of a sample is 4 V or 60 A; the nominal charge is 910 V, the
    nominal peak current 11,094 A. Values beyond a bound are clipped.

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 0-63 | measured voltage of the capacitor | -2 | 2 | nominal charge |
    | 64-127 | measured discharge current | -2 | 2 | nominal peak current |
    | 128 | time since the start | 0 | 1 | length of the episode |
    | 129-131 | whether each fault was declared last | 0 | 1 | 1 |

    With `observe_thrust=True` one more number follows, measured thrust over the nominal one, within -1 and 4.
    With `observe_fault=True` there follow:

    | Index | Meaning | Min | Max | Unit |
    |---|---|---|---|---|
    | 132 | true thrust | 0 | 4 | nominal thrust |
    | 133 | true mass of the slug | 0 | 1 | nominal mass |
    | 134 | true width of the electrodes | 0 | 1 | nominal width |
    | 135 | true added resistance | 0 | 10 | 0.1 ohm |

    ## Rewards

    Each in shares of an episode of 64 pulses:

    - `right`: `right_worth` / 64 where the pulse was what it was declared to be
    - `delay`: - `delay_cost` / 64 where a faulty pulse was declared healthy
    - `false_alarm`: - `false_alarm_cost` / 64 where a healthy pulse was declared faulty
    - `wrong_name`: - `wrong_name_cost` / 64 where a faulty pulse was declared to have another fault

    ## Starting State

    The first pulse has been fired. By default a fault of the thruster is drawn at every reset with
    probability 0.8, and begins in the first half of the episode, at once or growing for 10 to 40 s:
    `propellant_loss` of 0.85 to 0.99 (faulty from 0.88 on), `electrode_sediment` of 0.05 to 0.6 (from 0.14
    on) or `conductivity_loss` of 4 to 30 mohm (from 8 mohm on).

    ## Episode End

    Does not terminate. Truncated after 64 pulses.

    ## Information

    - `reward_terms`: the terms above by name; they sum to the reward.
    - `cost`: 0.
    - `fault`: arrays over the fault slots: `thruster` (from 1; 0 is an empty slot), `kind` (position in
      `thruster_envs.faults.KINDS`, from 1), `severity`, `active`.
    - `fuel`: thruster-seconds of firing since the reset, 0.016 s for each pulse.
    - `score`: the mean credit of the faulty pulses (1 for the right fault, 0.5 for another one, 0 for
      healthy), times the share of the healthy pulses that were declared healthy; so far.
    - `success`: whether the score is at least 0.9.
    - `diagnosis`: how it went. `detected`: whether a faulty pulse was declared faulty. `delay`: from the
      first faulty pulse to then, s; -1 if not yet. `false_alarms`: healthy pulses that were declared faulty.
      `case`: what would be right to declare now. `thrust`: of the last pulse, over the nominal one.

    ## Arguments

    ```python
    gym.make("thruster_envs/PulseDiagnosis-v0", faults={"probability": 1.0, "kinds": ["propellant_loss"]})
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`; one whose
      thrusters have a discharge.
    - `faults`: None for the default distribution, `[]` for no faults, a `Fault`, a list of them, or a
      `FaultDistribution`; also as plain mappings. Only the three kinds above, and only those of the
      `thruster`, or shared with it, act. `reset(options={"faults": ...})` gives one episode its own.
    - `observe_fault`: whether the truth about the pulse is added to the observation.
    - `fault_slots`: faults that the craft can have in an episode, 4 by default.
    - `nonlinear`, `max_substep`: without effect, the craft does not move.
    - `thruster`: number of the thruster that fires.
    - `samples`, `sample_spacing`: how many samples of voltage and of current, and the time between them, s.
    - `voltage_noise`, `current_noise`, `thrust_noise`: standard deviations, V, A and N.
    - `observe_thrust`: whether the thrust is measured too, as on a test stand.
    - `voltage_jitter`: half-width of the scatter of the charge, as a share.
    - `band`: how far the thrust of a healthy pulse may be off, as a share.
    - `right_worth`, `delay_cost`, `false_alarm_cost`, `wrong_name_cost`: what each is worth or costs if it
      lasts for a whole episode; 1, 1, 2 and 0.5 by default.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> worn = {"thruster": 1, "kind": "conductivity_loss", "severity": 0.02}
    >>> env = gym.make("thruster_envs/PulseDiagnosis-v0", faults=[worn])
    >>> observation, info = env.reset(seed=1)
    >>> info["diagnosis"]["case"], round(info["diagnosis"]["thrust"], 2)
    (3, 0.68)
    >>> observation, reward, terminated, truncated, info = env.step([3])
    >>> info["score"], reward
    (1.0, 0.015625)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = PulseDiagnosis


class PulseDiagnosisVectorEnv(TaskVectorEnv):
    """Many thrusters to be diagnosed; :class:`PulseDiagnosisEnv` describes one."""

    task_type: ClassVar[type[Task]] = PulseDiagnosis
