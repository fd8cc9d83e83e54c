"""What users pass to any view, checked in one place: seeds, actions, and the order of calls."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from thruster_envs.configuration import shown


class NotReset(ResetNeeded, ValueError):
    """A call that needs an episode, before the first reset."""

    def __init__(self, call: str) -> None:
        super().__init__(f"the environment has not been reset; call reset() before {call}()")


def checked_seed(seed: Any) -> int:
    """A seed as a Python integer.

    Raises:
        ValueError: Anything but a whole number from 0 to 2**128 - 1.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if not 0 <= number < 2**128:
        raise ValueError(f"seed must be a whole number from 0 to 2**128 - 1, got {shown(seed)}")
    return number


def checked_options(options: Any) -> Mapping[str, Any]:
    """The options of a reset, of which there may be none.

    Raises:
        ValueError: Anything but a mapping or None.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ValueError(f"options must be a dict or None, got {shown(options)}")
    return options


def checked_actions(
    actions: Any, shape: tuple[int, ...], *, name: str = "the action", switches: bool = False
) -> NDArray[np.float64]:
    """Actions as float64, in exactly this shape.

    Args:
        actions: What the user gave.
        shape: That of the action space.
        name: What to call it in a message.
        switches: Whether booleans are numbers here, as where an action chooses between options; as duties
            from -1 to 1 they would not mean what they seem to.

    Raises:
        ValueError: Another shape, or anything but real numbers.
    """
    try:
        array = np.asarray(actions)
    except ValueError:
        raise ValueError(f"{name} has parts of different lengths; must have the shape {shape}") from None
    if array.dtype.kind not in ("iufb" if switches else "iuf"):
        raise ValueError(f"{name} must be real numbers, got the type {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}; {shape} would be right")
    return array.astype(np.float64)
