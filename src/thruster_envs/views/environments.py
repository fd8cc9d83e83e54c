"""The environments by name, each with the page that documents it."""

from __future__ import annotations

from typing import Any, ClassVar

from thruster_envs.tasks import FormationKeeping, OrionRendezvous, Task, ThrusterMapping
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
