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

from typing import Any

from thruster_envs.faults import encoding as code
from thruster_envs.faults.record import KINDS, check_kind, check_severity
from thruster_envs.kernels import kernel

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
| 3 | leaking | leak, stuck_on | below 0.5 |
| 4 | stuck open | leak, stuck_on | 0.5 and more |
| 5 | tilted or late | misalignment, late_opening, slow_opening, electrode_sediment | any |
"""

#: Shares of the thrust from which on a thruster counts as weak and as dead, and opening from which on it
#: counts as stuck open.
WEAK_FROM, DEAD_FROM, STUCK_FROM = 0.5, 0.9, 0.5

#: The same in the severities of faults of a discharge: share of the slug with which half of the thrust is
#: lost, and added resistance, ohm, with which half and nine tenths are.
PROPELLANT_WEAK_FROM, RESISTANCE_WEAK_FROM, RESISTANCE_DEAD_FROM = 0.9863, 0.0448, 0.399


def mode_of(kind: str, severity: float) -> int:
    """Number of the mode of a fault.

    Raises:
        ValueError: A kind or severity that no fault can have.

    >>> MODES[mode_of("loss", 0.6)], MODES[mode_of("leak", 0.2)]
    ('weak', 'leaking')
    """
    check_kind(kind)
    check_severity(kind, severity)
    return int(mode_number(KINDS.index(kind) + 1, severity))


@kernel
def mode_number(kind: Any, severity: Any) -> int:
    """:func:`mode_of` for a kind by its code."""
    if (
        kind == code.MISALIGNMENT
        or kind == code.LATE_OPENING
        or kind == code.SLOW_OPENING
        or kind == code.ELECTRODE_SEDIMENT
    ):
        return 5
    if kind == code.STUCK_ON or kind == code.LEAK:
        return 4 if severity >= STUCK_FROM else 3
    if kind == code.PROPELLANT_LOSS:
        return 1 if severity >= PROPELLANT_WEAK_FROM else 2
    weak, dead = WEAK_FROM, DEAD_FROM
    if kind == code.CONDUCTIVITY_LOSS:
        weak, dead = RESISTANCE_WEAK_FROM, RESISTANCE_DEAD_FROM
    return 0 if severity >= dead else (1 if severity >= weak else 2)
