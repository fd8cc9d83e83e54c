"""What every detector checks at its door, whatever it is fed with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.protocols import BoolArray, FloatArray

__all__ = ["check_effectiveness", "mask_of", "rows_of"]


def rows_of(given: FloatArray, vehicles: int, size: int, name: str) -> FloatArray:
    """Values (vehicles, size); those of one vehicle, (size,), stand for all.

    Raises:
        ValueError: Another shape; the message has the name.
    """
    if given.shape == (size,):
        return np.repeat(given[np.newaxis], vehicles, axis=0)
    if given.shape != (vehicles, size):
        raise ValueError(f"{name} has the shape {given.shape}; ({vehicles}, {size}) would be right")
    return given


def mask_of(given: ArrayLike | None, vehicles: int) -> BoolArray:
    """A mask (vehicles,); all of them for None.

    Raises:
        ValueError: Another shape, or something other than a mask.
    """
    if given is None:
        return np.ones(vehicles, np.bool_)
    mask = np.asarray(given)
    if mask.shape != (vehicles,) or mask.dtype != np.bool_:
        raise ValueError(
            f"vehicles is an array of {mask.dtype} and of the shape {mask.shape}; a mask "
            f"({vehicles},) would be right"
        )
    return mask


def check_effectiveness(given: FloatArray, vehicles: int, shape: tuple[int, ...]) -> None:
    """Refuse an effectiveness that is neither of the shape (m, n) nor (vehicles, m, n), or not finite.

    Raises:
        ValueError: One line that says which.
    """
    if given.shape not in (shape, (vehicles, *shape)):
        raise ValueError(
            f"effectiveness has the shape {given.shape}; {shape}, or with {vehicles} vehicles in front, "
            "would be right"
        )
    if not np.isfinite(given).all():
        raise ValueError("effectiveness has an entry that is not finite; m/s^2, rad/s^2 would be right")
