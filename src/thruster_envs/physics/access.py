"""What compiled code above the physics needs: rows of a craft, errors against LVLH, names of numbers."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from thruster_envs.helpers import njit
from thruster_envs.physics import rows as at
from thruster_envs.physics.attitude import rotate

Named = TypeVar("Named", bound=tuple[Any, ...])


def opener(kind: type[Named], *, columns: bool = False) -> Any:
    """A compiled function that makes a NamedTuple of an array, for the first lines of a kernel.

    Kernels are called with arrays, since a NamedTuple takes thirty times as long to enter one. Inside a
    kernel its names cost nothing.

    Args:
        kind: The NamedTuple.
        columns: Whether the array is (..., fields), so that each field is a view (...,) of it, to be written
            too; else it is (fields,), and each field is a number.
    """
    place = "..., " if columns else ""
    entries = ", ".join(f"array[{place}{k}]" for k in range(len(kind._fields)))  # type: ignore[attr-defined]
    # By eval, since Numba compiles no star expression of an array, and as a loop the names would cost time.
    names = {"kind": kind, "__name__": kind.__module__}
    return njit(eval(f"lambda array: kind({entries})", names), forceinline=True)


def columns_of(kind: type[Named], array: NDArray[Any]) -> Named:
    """Views (...,) of the columns of an array (..., fields) by the names of a NamedTuple."""
    return kind(*np.moveaxis(array, -1, 0))


@njit(forceinline=True)
def place(world, craft, number_of_craft, lanes):
    """Block and lane of a craft."""
    body = world * number_of_craft + craft
    return body // lanes, body % lanes


@njit(forceinline=True)
def attitude_error(q):
    """Rotation left against LVLH (rad, body axes) if it is small: twice the vector part of ``q``."""
    sign = 2.0 if q[0] >= 0.0 else -2.0
    return (-sign * q[1], -sign * q[2], -sign * q[3])


@njit(forceinline=True)
def turning_of_frame(data, b, w):
    """Rate at which LVLH of a craft turns now, rad/s, in its own axes."""
    return (data[b, at.FRAME_RATE, w], 0.0, data[b, at.FRAME_RATE + 1, w])


@njit(forceinline=True)
def rate_error(q, rate, turning):
    """Body rate against LVLH, rad/s in body axes; ``turning`` is that of the frame itself, in its axes."""
    frame = rotate(q, turning)
    return (rate[0] - frame[0], rate[1] - frame[1], rate[2] - frame[2])


@njit(forceinline=True)
def errors_of(data, first, b, w):
    """Attitude error, rad, and rate error, rad/s, against LVLH in body axes.

    ``first`` is the first row of the motion: ``at.POSITION`` as it truly is, ``at.MEASURED`` as sensors say.
    """
    q = (data[b, first + 6, w], data[b, first + 7, w], data[b, first + 8, w], data[b, first + 9, w])
    rate = (data[b, first + 10, w], data[b, first + 11, w], data[b, first + 12, w])
    return attitude_error(q), rate_error(q, rate, turning_of_frame(data, b, w))
