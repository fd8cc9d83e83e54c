"""Every mapper that fits a spacecraft on the same commands: what is missed, what is fired, how long it takes.

What the vehicle makes of the on-times is its nominal description with the feed's coupling, and with valves
that do not open for less than a minimum pulse. Faults, scatter, delays and ramps are left out, and mappers
that need to be told an uncertainty.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thruster_baselines.mapping.additive import AdditiveCompensationMapper
from thruster_baselines.mapping.carrying import CarryingMapper
from thruster_baselines.mapping.coupling import delivered_rate_change
from thruster_baselines.mapping.crude import CrudeMapper
from thruster_baselines.mapping.differential import DifferentialCompensationMapper
from thruster_baselines.mapping.exact import ExactCompensationMapper
from thruster_baselines.mapping.lp import LPMapper
from thruster_baselines.mapping.milp import MILPMapper
from thruster_baselines.mapping.minimum_norm import MinimumNormShiftMapper
from thruster_baselines.mapping.minimum_pulse import MinimumPulseMapper, minimum_pulses
from thruster_baselines.mapping.model import LostDirectionsWarning, require_command_shape
from thruster_baselines.mapping.non_negative import NonNegativeLeastSquaresMapper
from thruster_baselines.mapping.null_space import NullSpaceMapper
from thruster_baselines.mapping.pseudo_inverse import PseudoInverseMapper
from thruster_baselines.mapping.quadratic import QuadraticMapper
from thruster_baselines.mapping.redistributed import RedistributedPseudoInverseMapper
from thruster_baselines.mapping.schmitt import SchmittTriggerMapper
from thruster_baselines.mapping.truncating import TruncatingMapper
from thruster_envs.extras import extra
from thruster_envs.protocols import FloatArray, Mapper, MapperWithMemory
from thruster_envs.spacecraft import Spacecraft, load

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ComparedMapper", "MapperComparison", "compare_mappers"]

_TIMED = 30  # single calls, at most, whose times the median is of
_FEWEST, _LONGEST = 3, 0.5  # at least so many of them, and no more once they have taken so many s
_REACHED = 1e-6  # of the authority: a larger miss of the linear program is out of reach
_SMALLEST = 0.01  # of the authority, size of the smallest default command

_ALWAYS: dict[str, Callable[[Spacecraft], Mapper]] = {
    "LPMapper": LPMapper,
    "PseudoInverseMapper": PseudoInverseMapper,
    "RedistributedPseudoInverseMapper": RedistributedPseudoInverseMapper,
    "NonNegativeLeastSquaresMapper": NonNegativeLeastSquaresMapper,
    "QuadraticMapper": QuadraticMapper,
    "MinimumNormShiftMapper": MinimumNormShiftMapper,
    "NullSpaceMapper": NullSpaceMapper,
    "CrudeMapper": CrudeMapper,
}
_COUPLED: dict[str, Callable[[Spacecraft], Mapper]] = {
    "DifferentialCompensationMapper": DifferentialCompensationMapper,
    "AdditiveCompensationMapper": AdditiveCompensationMapper,
    "MILPMapper": MILPMapper,
    "ExactCompensationMapper": ExactCompensationMapper,
}
_PULSED: dict[str, Callable[[Spacecraft], Mapper]] = {
    "MinimumPulseMapper": MinimumPulseMapper,
    "TruncatingMapper": TruncatingMapper,
    "SchmittTriggerMapper": SchmittTriggerMapper,
    "CarryingMapper": lambda craft: CarryingMapper(MinimumPulseMapper(craft)),
}
_UNCERTAIN = (
    "RobustCommandMapper",
    "RobustEffectivenessMapper",
    "ConicRobustMapper",
    "ChanceConstrainedMapper",
)


class ComparedMapper(NamedTuple):
    """What became of the commands under one mapper.

    Attributes:
        name: Of the mapper.
        residual: Mean over the commands of the size of what was commanded and not given, in shares of the
            authority per axis.
        worst_residual: The largest of them.
        residual_of_sum: Size of the sum of what was not given over all commands, in the same unit: near zero
            for a mapper that makes up later for what it misses now.
        propellant: Mean firing time of a command, thruster-s; what opens no valve is not counted.
        solve_time: Median time of a single call, s.
    """

    name: str
    residual: float
    worst_residual: float
    residual_of_sum: float
    propellant: float
    solve_time: float


@dataclass(frozen=True, kw_only=True)
class MapperComparison:
    """A table of mappers. `str` gives its text, `figure` a picture.

    Attributes:
        spacecraft: Its name.
        commands: (count, 6), m/s then rad/s.
        unreachable: Share of the commands, 0..1, that no on-times within a period give, feed coupling and
            minimum pulses apart.
        rows: One for each mapper.
        left_out: Why others have no row, by name.
    """

    spacecraft: str
    commands: FloatArray
    unreachable: float
    rows: tuple[ComparedMapper, ...]
    left_out: Mapping[str, str]

    def __getitem__(self, name: str) -> ComparedMapper:
        """The row of a mapper.

        Raises:
            KeyError: A mapper without one.
        """
        return {row.name: row for row in self.rows}[name]

    def __str__(self) -> str:
        """The table, then who was left out."""
        width = max((len(row.name) for row in self.rows), default=0)
        columns = ("residual", "worst", "of sum", "firing, s", "solve, us")
        head = f"{'mapper':{width}}" + "".join(f" {column:>10}" for column in columns)
        return "\n".join(
            [
                f"{self.spacecraft}: {len(self.commands)} commands, {100.0 * self.unreachable:.0f} % out of "
                "reach; residuals in shares of the authority",
                "",
                head,
                *(
                    f"{row.name:{width}} {row.residual:10.2g} {row.worst_residual:10.2g} "
                    f"{row.residual_of_sum:10.2g} {row.propellant:10.3g} {1e6 * row.solve_time:10.3g}"
                    for row in self.rows
                ),
                *(f"left out: {name}: {reason}" for name, reason in self.left_out.items()),
            ]
        )

    def figure(self) -> Figure:
        """Residual, firing time and solve time of each mapper as bars, a figure of matplotlib."""
        with extra("agents", "a figure of a comparison"):
            from matplotlib.backends.backend_agg import FigureCanvasAgg  # only here: needs the agents' extra
            from matplotlib.figure import Figure

        figure = Figure(figsize=(11.0, 0.6 + 0.35 * len(self.rows)), layout="constrained")
        FigureCanvasAgg(figure)
        names = [row.name for row in self.rows]
        for axes, values, label in zip(
            figure.subplots(1, 3, sharey=True),
            (
                [row.residual for row in self.rows],
                [row.propellant for row in self.rows],
                [1e6 * row.solve_time for row in self.rows],
            ),
            (
                "mean residual, share of the authority",
                "mean firing time, thruster-s",
                "median solve time, us",
            ),
            strict=True,
        ):
            axes.barh(names, values)
            axes.set_xlabel(label)
        axes.set_xscale("log")
        axes.invert_yaxis()
        figure.suptitle(f"{self.spacecraft}, {len(self.commands)} commands")
        return figure


def compare_mappers(
    spacecraft: Spacecraft | str | PathLike[str] | Mapping[str, Any],
    commands: ArrayLike | None = None,
    *,
    seed: int = 0,
    count: int = 200,
    slowest: float = 0.05,
) -> MapperComparison:
    """Give the same commands to every mapper that fits a spacecraft.

    Compensations of feed coupling fit where there is a coupling, mappers of pulses where there is a minimum
    pulse. Mappers with a memory take the commands as a sequence in time.

    Args:
        spacecraft: As `thruster_envs.spacecraft.load` takes it.
        commands: (count, 6), m/s then rad/s, one for each control period; by default of random directions
            that the thrusters span, with sizes from 1 % to all of the authority, uniform in the logarithm.
        seed: Of the default commands.
        count: How many of them.
        slowest: Longest median time of a single call, s, up to which a mapper is compared.

    Raises:
        ValueError: Commands of another shape, or none.

    >>> table = compare_mappers("orion", count=20)
    >>> table["ExactCompensationMapper"].residual < table["LPMapper"].residual
    True
    """
    craft = load(spacecraft)
    with warnings.catch_warnings():  # the table says what is out of reach
        warnings.simplefilter("ignore", LostDirectionsWarning)
        chosen = _random_commands(craft, seed, count) if commands is None else _checked(commands)
        unreachable = _size(LPMapper(craft)(chosen).slack, craft) > _REACHED
        rows, left_out = [], {}
        for name, (make, reason) in _candidates(craft).items():
            if make is None:
                left_out[name] = reason
                continue
            try:
                mapper = make(craft)
            except (ValueError, ModuleNotFoundError) as error:
                left_out[name] = str(error)
                continue
            solve_time = _solve_time(mapper, chosen)
            if solve_time > slowest:
                left_out[name] = f"a call takes {solve_time:.2g} s, more than slowest, {slowest:g} s"
                continue
            rows.append(_row(name, mapper, craft, chosen, solve_time))
    return MapperComparison(
        spacecraft=craft.name, commands=chosen, unreachable=float(unreachable.mean()), rows=tuple(rows),
        left_out=left_out,
    )  # fmt: skip


def _candidates(craft: Spacecraft) -> dict[str, tuple[Callable[[Spacecraft], Mapper] | None, str]]:
    """Name to how a mapper is made, or None and the reason."""
    coupled, pulsed = craft.feed.coupling > 0.0, bool(minimum_pulses(craft).any())
    found: dict[str, tuple[Callable[[Spacecraft], Mapper] | None, str]] = {}
    for group, fits, reason in (
        (_ALWAYS, True, ""),
        (_COUPLED, coupled, "the feed has no coupling"),
        (_PULSED, pulsed, "there is no minimum pulse"),
    ):
        found |= {name: (make if fits else None, reason) for name, make in group.items()}
    return found | dict.fromkeys(_UNCERTAIN, (None, "it needs to be told an uncertainty"))


def _row(
    name: str, mapper: Mapper, craft: Spacecraft, commands: FloatArray, solve_time: float
) -> ComparedMapper:
    on_times = mapper(commands).on_times
    fired = np.where(on_times >= minimum_pulses(craft), on_times, 0.0)
    missed = commands - delivered_rate_change(craft.effectiveness(), fired, craft.feed.coupling)
    sizes = _size(missed, craft)
    return ComparedMapper(
        name=name,
        residual=float(sizes.mean()),
        worst_residual=float(sizes.max()),
        residual_of_sum=float(_size(missed.sum(axis=0), craft)),
        propellant=float(fired.sum(axis=-1).mean()),
        solve_time=solve_time,
    )


def _solve_time(mapper: Mapper, commands: FloatArray) -> float:
    """Median time of a single call, s, after one that is not counted; what was carried over is forgotten."""
    mapper(commands[0])
    times: list[float] = []
    while len(times) < _FEWEST or (len(times) < _TIMED and sum(times) < _LONGEST):
        start = time.perf_counter()
        mapper(commands[len(times) % len(commands)])
        times.append(time.perf_counter() - start)
    if isinstance(mapper, MapperWithMemory):
        mapper.forget()
    return float(np.median(times))


def _size(missed: FloatArray, craft: Spacecraft) -> FloatArray:
    """Length of rate changes (..., 6) in shares of the authority; axes without any count by the largest."""
    authority = craft.authority()
    for axes in (slice(0, 3), slice(3, 6)):
        own = authority[axes]
        own[own == 0.0] = own.max() if own.any() else 1.0
    size: FloatArray = np.linalg.norm(missed / authority, axis=-1)
    return size


def _random_commands(craft: Spacecraft, seed: int, count: int) -> FloatArray:
    """(count, 6): in directions that some firing gives."""
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    rng = np.random.default_rng(seed)
    authority = craft.authority()
    columns = craft.effectiveness() / np.where(authority > 0.0, authority, np.inf)[:, np.newaxis]
    left, values, _ = np.linalg.svd(columns)
    spanned = left[:, : np.count_nonzero(values > 1e-9 * values[0])]
    shares = rng.normal(size=(count, 6)) @ spanned @ spanned.T
    shares /= np.linalg.norm(shares, axis=1, keepdims=True)
    commands: FloatArray = authority * shares * _SMALLEST ** rng.random((count, 1))
    return commands


def _checked(commands: ArrayLike) -> FloatArray:
    chosen = np.array(commands, dtype=np.float64)
    require_command_shape(chosen, 6)
    if chosen.ndim != 2 or not len(chosen):
        raise ValueError(f"commands must be (count, 6) with at least one, got the shape {chosen.shape}")
    return chosen
