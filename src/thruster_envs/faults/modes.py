"""What a diagnosis has to tell apart: kinds and severities of faults in six modes.

A mode is what a repair asks for. Thrust that is missing is made up for by others, or the thruster is given
up; thrust that nobody commanded is cancelled, or its valve closed; thrust that comes in another direction or
at another time is to be calibrated. How a fault comes about (a valve, the flow, a discharge) makes no
difference to that, and of how badly a class is enough. The severity is that of the record: where it changes
in time, its largest.

Faults of a discharge do not change the thrust in proportion. The mode of a propellant loss and of a
conductivity loss is that of the thrust lost, with the discharge of the catalogue's PPT cubesat; sediment on
the electrodes gives more thrust than commanded, which is to be calibrated like thrust in another direction.

Left out: several faults of one thruster, which together may be another mode than each by itself.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from thruster_envs.faults.kinds import (
    ACTUATOR_TABLE,
    CODES,
    DEAD_FROM,
    PROPELLANT_WEAK_FROM,
    RESISTANCE_DEAD_FROM,
    RESISTANCE_WEAK_FROM,
    STUCK_FROM,
    WEAK_FROM,
    check_severity,
    kind_of,
)
from thruster_envs.kernels import kernel

__all__ = [
    "DEAD_FROM",
    "MODES",
    "PROPELLANT_WEAK_FROM",
    "RESISTANCE_DEAD_FROM",
    "RESISTANCE_WEAK_FROM",
    "STUCK_FROM",
    "WEAK_FROM",
    "mode_number",
    "mode_of",
]

MODES: tuple[str, ...] = ("dead", "weak", "slightly weak", "leaking", "stuck open", "tilted or late")
"""The modes, in the order of their numbers from 0.

| Number | Mode | Kinds | Severity |
|---|---|---|---|
| 0 | dead | stuck_off, loss, intermittent | 0.9 and more |
| 0 | dead | conductivity_loss | 0.399 ohm and more |
| 1 | weak | stuck_off, loss, intermittent | from 0.5 to below 0.9 |
| 1 | weak | propellant_loss | 0.9863 and more |
| 1 | weak | conductivity_loss | from 0.0448 to below 0.399 ohm |
| 2 | slightly weak | stuck_off, loss, intermittent | below 0.5 |
| 2 | slightly weak | propellant_loss | below 0.9863 |
| 2 | slightly weak | conductivity_loss | below 0.0448 ohm |
| 3 | leaking | leak, stuck_on, bias | below 0.5 |
| 4 | stuck open | leak, stuck_on, bias | 0.5 and more |
| 5 | tilted or late | misalignment, late_opening, slow_opening, electrode_sediment, sign | any |

From which severity on a kind has which mode stands in `thruster_envs.faults.kinds`.
"""

_MOST = max(len(one.modes) for one in ACTUATOR_TABLE)
#: (kinds, most modes), the severity from which on a kind has a mode, infinite where it has no more of them,
#: and the number of the mode.
_FROM = np.full((len(ACTUATOR_TABLE), _MOST), math.inf)
_MODE = np.zeros((len(ACTUATOR_TABLE), _MOST), np.int64)
for _kind, _line in enumerate(ACTUATOR_TABLE):
    for _place, (_severity, _name) in enumerate(_line.modes):
        _FROM[_kind, _place], _MODE[_kind, _place] = _severity, MODES.index(_name)


def mode_of(kind: str, severity: float) -> int:
    """Number of the mode of a fault.

    Raises:
        ValueError: A kind or severity that no fault can have, or a kind that has no mode.

    >>> MODES[mode_of("loss", 0.6)], MODES[mode_of("leak", 0.2)]
    ('weak', 'leaking')
    """
    check_severity(kind, severity)
    if not kind_of(kind).modes:
        raise ValueError(f"kind must be one of a thruster to have a mode, got {kind!r}")
    return int(mode_number(CODES[kind], severity))


@kernel
def mode_number(kind: Any, severity: Any) -> int:
    """:func:`mode_of` for a kind by its code."""
    mode = _MODE[kind - 1, 0]
    for place in range(1, _MODE.shape[1]):
        if severity >= _FROM[kind - 1, place]:
            mode = _MODE[kind - 1, place]
    return mode  # type: ignore[no-any-return]  # of an array of whole numbers
