"""`PulseDiagnosis-v0`: its page."""

from __future__ import annotations

from typing import ClassVar

from thruster_envs.tasks import PulseDiagnosis, Task
from thruster_envs.views.single import TaskEnv

__all__ = ["PulseDiagnosisEnv"]


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

    `Discrete(4)`; in the vector form `MultiDiscrete([4, 4, ...])`, one number for each world.

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

    | Term | What | In a period | In an episode |
    |---|---|---|---|
    | `right` | `right_worth` / 64 | 0 to 0.016 | 0 to 1 |
    | `delay` | - `delay_cost` / 64 | -0.016 to 0 | -1 to 0 |
    | `false_alarm` | - `false_alarm_cost` / 64 | -0.031 to 0 | -2 to 0 |
    | `wrong_name` | - `wrong_name_cost` / 64 | -0.008 to 0 | -0.5 to 0 |

    Nothing can be lost, and no episode ends early. To declare every pulse healthy returns 1 without a fault,
    which is the most there is, and 0.2 on average with those of the default.

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
      `thruster_envs.faults.KINDS`, from 1), `severity`, `onset` (s), `active`; `sensor` and `axis` are 0, no
      sensor fails here.
    - `stale`: false for each of `thruster_envs.faults.SENSORS`, for the same reason.
    - `fuel`: thruster-seconds of firing since the reset, 0.016 s for each pulse.
    - `score`: the mean credit of the faulty pulses (1 for the right fault, 0.5 for another one, 0 for
      healthy), times the share of the healthy pulses that were declared healthy; so far.
    - `success`: whether the score is at least 0.9.
    - `is_success`: the same, under the name from which Stable-Baselines3 logs a success rate.
    - `diagnosis`: how it went. `detected`: whether a faulty pulse was declared faulty. `delay`: from the
      first faulty pulse to then, s; -1 if not yet. `false_alarms`: healthy pulses that were declared faulty.
      `case`: what would be right to declare now. `thrust`: of the last pulse, over the nominal one.

    ## Arguments

    ```python
    gym.make("thruster_envs/PulseDiagnosis-v0", faults={"probability": 1.0, "kinds": ["propellant_loss"]})
    ```

    - `spacecraft`: a name in the catalogue, the path of a TOML file, a mapping, or a `Spacecraft`; one whose
      thrusters have a discharge, on any orbit.
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
    - `flat_info`: whether the information has keys like `reward_terms/fuel` instead of dictionaries, and
      NumPy scalars instead of Python's numbers.

    >>> import gymnasium as gym
    >>> import thruster_envs
    >>> worn = {"thruster": 1, "kind": "conductivity_loss", "severity": 0.02}
    >>> env = gym.make("thruster_envs/PulseDiagnosis-v0", faults=[worn])
    >>> observation, info = env.reset(seed=1)
    >>> info["diagnosis"]["case"], round(info["diagnosis"]["thrust"], 2)
    (3, 0.68)
    >>> observation, reward, terminated, truncated, info = env.step(3)
    >>> info["score"], reward
    (1.0, 0.015625)

    ## Version History

    - v0: initial version
    """

    task_type: ClassVar[type[Task]] = PulseDiagnosis
