"""Residual generators for thruster faults in translation, designed on a linear model of the relative motion.

An observer of position and velocity is fed with the commanded thrust and the measured position; its residual,
measured minus expected position, m, is zero but for noise as long as thrusters do what is commanded.
`pade_design` is that of Fonod et al. 2013, eqs. 3-25, with three Pade states for the modulator's delay;
`observer_design` has a delay of whole periods or none. Axes are those of eq. 29: x along-track, y against the
orbit's normal, z towards the planet; thrust is per mass, m/s^2. What the source claims and what holds:
docs/derivations/residual_design.md.

Left out: orbital disturbances, delays of single thrusters, the rotation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thruster_envs.configuration import require
from thruster_envs.extras import extra
from thruster_envs.protocols import FloatArray

__all__ = [
    "Decoupling",
    "DelayModel",
    "ResidualDesign",
    "assigned_gain",
    "closed_form_gain",
    "decoupling",
    "delay_model",
    "observer_design",
    "pade_design",
    "relative_motion",
]

SOURCE_EIGENVALUES = (-0.49, -0.50, -0.51)
"""Of the observer with Pade's states, rad/s, three times each: "close to -0.5" in the source."""

OBSERVER_EIGENVALUES = (-0.49, -0.51)
"""Of the observer without them, three times each."""

_POSITION = np.hstack([np.eye(3), np.zeros((3, 3))])


@dataclass(frozen=True, slots=True)
class DelayModel:
    """Relative motion under a command that comes late, z' = A z + B u + F f + D d, y = C z (eq. 13).

    The state is position, velocity, and three states of the delay. The common delay is `delay`; that it is
    another one is the unknown input d.

    Attributes:
        dynamics: (9, 9), A.
        command: (9, 3), B, of the commanded force over mass.
        fault: (9, 3), F, of a force over mass that was not commanded.
        delay_variation: (9, 3), D.
        measurement: (3, 9), C.
        delay: Nominal, s.
    """

    dynamics: FloatArray
    command: FloatArray
    fault: FloatArray
    delay_variation: FloatArray
    measurement: FloatArray
    delay: float


@dataclass(frozen=True, slots=True)
class ResidualDesign:
    """A discrete observer: state' = T state + E [u; y], residual = O state + P [u; y].

    Attributes:
        transition: (s, s), T.
        entry: (s, 6), E, for the commanded force over mass, m/s^2, then the measured position, m.
        output: (3, s), O.
        feedthrough: (3, 6), P.
        late: By how many periods the command is held back before it enters.
        period: s.
        motion: (s, s), the matrix of the continuous observer.
        fault: (s, 3), how a force over mass that was not commanded enters the continuous observer's error.
    """

    transition: FloatArray
    entry: FloatArray
    output: FloatArray
    feedthrough: FloatArray
    late: int
    period: float
    motion: FloatArray
    fault: FloatArray

    @property
    def states(self) -> int:
        """How many there are."""
        return int(self.transition.shape[0])

    def steady_state(self) -> FloatArray:
        """(s, 6): the state in which the observer rests under a constant input [u; y]."""
        return np.asarray(np.linalg.solve(np.eye(self.states) - self.transition, self.entry), np.float64)

    def fault_response(self, samples: int) -> FloatArray:
        """What a constant unit force over mass, 1 m/s^2 along an axis from time 0, does to the residual.

        Args:
            samples: How many, one per period from time 0 on.

        Returns:
            (samples, 3, 3): residual, m; axis of the residual, axis of the force.
        """
        transition, entry = _held(self.motion, self.fault, self.period)
        state, response = np.zeros((self.states, 3)), np.empty((samples, 3, 3))
        for k in range(samples):
            response[k] = state[:3]
            state = transition @ state + entry
        return response

    def axis_channel(self) -> tuple[FloatArray, FloatArray]:
        """How a force over mass on one axis, held over a period, enters the residual of that axis.

        Of the axis against the orbit's normal, which is coupled to no other; the others differ by the orbital
        coupling, which is nothing over some seconds.

        Returns:
            (s / 3, s / 3) transition and (s / 3,) entry of a state whose first component is the residual, m.
        """
        axis = slice(1, None, 3)
        transition, entry = _held(self.motion[axis, axis], self.fault[axis, 1:2], self.period)
        return transition, entry[:, 0]


@dataclass(frozen=True, slots=True)
class Decoupling:
    """How far a residual can be made blind to a varying delay and still see thruster faults.

    Attributes:
        weight_rank: Rank of C D. It is 0, so that any weight of the residual meets the first condition of
            decoupling (eq. 20), which therefore decides nothing.
        alignment: (eigenvalues,), cosine between the eigenvector that decoupling asks for and the nearest
            assignable one; 1 would be needed.
        ratio_error: Largest relative difference, over frequencies, between the transfer from d to the
            residual and -4 s / (delay s + 2) times that from a fault.
        rank_of_both: Rank of the transfers from fault and d side by side, the largest over frequencies. It is
            3, that of the fault's alone: both act through the same three channels, and a residual without
            one is without the other.
    """

    weight_rank: int
    alignment: FloatArray
    ratio_error: float
    rank_of_both: int


def relative_motion(mean_motion: float) -> FloatArray:
    """(6, 6): free motion of position and velocity by Hill's equations, in the axes of eq. 29."""
    n = mean_motion
    matrix = np.zeros((6, 6))
    matrix[:3, 3:] = np.eye(3)
    matrix[3, 5], matrix[5, 3] = 2.0 * n, -2.0 * n
    matrix[4, 1], matrix[5, 2] = -n * n, 3.0 * n * n
    return matrix


def delay_model(mean_motion: float, delay: float, mass: float = 1.0) -> DelayModel:
    """Hill's equations with a first-order Pade model of the common delay (eqs. 3-13).

    Args:
        mean_motion: Of the orbit, rad/s.
        delay: Nominal, s.
        mass: kg; with 1 kg, commands are forces over mass.

    Raises:
        ValueError: A delay or mass that is not positive.
    """
    require(0.0 < delay < math.inf, "delay", delay, "a positive number of s")
    require(0.0 < mass < math.inf, "mass", mass, "a positive number of kg")
    force = np.vstack([np.zeros((3, 3)), np.eye(3) / mass])
    dynamics = np.zeros((9, 9))
    dynamics[:6, :6] = relative_motion(mean_motion)
    dynamics[:6, 6:] = force * (4.0 / delay)
    dynamics[6:, 6:] = -2.0 / delay * np.eye(3)
    return DelayModel(
        dynamics=dynamics,
        command=np.vstack([-force, np.eye(3)]),
        fault=np.vstack([force, np.zeros((3, 3))]),
        delay_variation=np.vstack([-4.0 / delay * force, 2.0 / delay * np.eye(3)]),
        measurement=np.hstack([_POSITION, np.zeros((3, 3))]),
        delay=float(delay),
    )


def assigned_gain(dynamics: ArrayLike, measurement: ArrayLike, eigenvalues: Sequence[float]) -> FloatArray:
    """Observer gain that gives A - L C these eigenvalues, each as often as there are outputs (eqs. 22-25).

    Left eigenvectors of an eigenvalue are rows m' K with K = -C (lambda I - A)^-1 and any m. Of the first
    ones asked for, the rows of C, the nearest such rows are taken; unit vectors m complete each eigenvalue.

    Args:
        dynamics: (s, s), A.
        measurement: (p, s), C.
        eigenvalues: s / p of them, rad/s, negative, no two alike.

    Returns:
        (s, p), L.

    Raises:
        ValueError: Eigenvalues that are not negative, too many or too few.
    """
    a, c = np.asarray(dynamics, dtype=np.float64), np.asarray(measurement, dtype=np.float64)
    outputs, states = c.shape
    require(
        len(set(eigenvalues)) * outputs == states and max(eigenvalues) < 0.0,
        "eigenvalues",
        tuple(eigenvalues),
        f"{states // outputs} different negative numbers of rad/s",
    )
    left, chosen = np.empty((states, states)), np.empty((states, outputs))
    for k, value in enumerate(eigenvalues):
        rows = _assignable(a, c, value)
        m = np.eye(outputs)
        if k == 0:
            m = c @ rows.T @ np.linalg.inv(rows @ rows.T)
        vectors = m @ rows
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
        here = slice(k * outputs, (k + 1) * outputs)
        left[here], chosen[here] = vectors / length, m / length
    return np.asarray(np.linalg.solve(left, chosen), np.float64)


def closed_form_gain(
    mean_motion: float, delay: float, eigenvalues: Sequence[float] = SOURCE_EIGENVALUES, mass: float = 1.0
) -> FloatArray:
    """What `assigned_gain` gives for `delay_model`, by comparison of coefficients.

    With w = v - 2 n G p, where G p = (p_z, 0, -p_x), the axes come apart but for 2 n G in the position's
    rate, which the measured position takes away. Each axis then is a chain of three states with the
    stiffness k of Hill's equations, and (s - a)(s - b)(s - c) = s^3 + c2 s^2 + c1 s + c0 gives the gains.

    Returns:
        (9, 3).
    """
    n, rate = mean_motion, 2.0 / delay
    _, c2, c1, c0 = np.poly(np.asarray(eigenvalues, dtype=np.float64))
    swap = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    stiffness = np.diag([0.0, -n * n, 3.0 * n * n])
    position = c2 - rate
    velocity = c1 - rate * position
    late = (c0 - rate * velocity) * mass / (2.0 * rate)
    first = position * np.eye(3) + 2.0 * n * swap
    return np.vstack([first, velocity * np.eye(3) + stiffness + 2.0 * n * swap @ first, late * np.eye(3)])


def pade_design(
    mean_motion: float,
    period: float = 0.1,
    delay: float = 0.1,
    eigenvalues: Sequence[float] = SOURCE_EIGENVALUES,
    mass: float = 1.0,
) -> ResidualDesign:
    """The source's residual generator: nine states, fed with commands as they are given.

    Args:
        mean_motion: Of the orbit, rad/s.
        period: Between two samples, s.
        delay: Nominal, s.
        eigenvalues: Three, rad/s, each given three times.
        mass: kg; with 1 kg, commands are forces over mass.

    Raises:
        ValueError: A value that cannot be.

    >>> pade_design(8.5e-4).states
    9
    """
    model = delay_model(mean_motion, delay, mass)
    gain = assigned_gain(model.dynamics, model.measurement, eigenvalues)
    return _discrete(model.dynamics, model.command, model.measurement, model.fault, gain, period, 0)


def observer_design(
    mean_motion: float,
    period: float = 0.1,
    late: int = 1,
    eigenvalues: Sequence[float] = OBSERVER_EIGENVALUES,
) -> ResidualDesign:
    """An observer of six states, fed with the commanded force over mass of `late` periods ago.

    Args:
        mean_motion: Of the orbit, rad/s.
        period: Between two samples, s.
        late: The modulator's delay in periods; 0 leaves it out of the model.
        eigenvalues: Two, rad/s, each given three times.

    Raises:
        ValueError: A value that cannot be.

    >>> observer_design(8.5e-4).states, observer_design(8.5e-4).late
    (6, 1)
    """
    require(late >= 0, "late", late, "a whole number of periods, 0 or more")
    dynamics = relative_motion(mean_motion)
    force = np.vstack([np.zeros((3, 3)), np.eye(3)])
    gain = assigned_gain(dynamics, _POSITION, eigenvalues)
    return _discrete(dynamics, force, _POSITION, force, gain, period, late)


def decoupling(
    model: DelayModel,
    eigenvalues: Sequence[float] = SOURCE_EIGENVALUES,
    frequencies: ArrayLike = (0.01, 0.1, 0.5, 1.0, 5.0, 20.0, 100.0),
) -> Decoupling:
    """Compute that exact decoupling from a varying delay is impossible.

    Args:
        model: With its units: in newtons the alignment is another than per mass, and neither is 1.
        eigenvalues: Of the observer, rad/s.
        frequencies: At which transfers are compared, rad/s.

    >>> decoupling(delay_model(8.5e-4, delay=0.1)).rank_of_both
    3
    """
    a, c = model.dynamics, model.measurement
    gain = assigned_gain(a, c, eigenvalues)
    both = np.hstack([model.fault, model.delay_variation])
    error, rank = 0.0, 0
    for frequency in np.asarray(frequencies, dtype=np.float64):
        s = 1j * frequency
        transfer = c @ np.linalg.solve(s * np.eye(a.shape[0]) - a + gain @ c, both)
        fault, variation = transfer[:, :3], transfer[:, 3:]
        expected = -4.0 * s / (model.delay * s + 2.0) * fault
        error = max(error, float(np.abs(variation - expected).max() / np.abs(expected).max()))
        scaled = np.hstack([fault / np.abs(fault).max(), variation / np.abs(variation).max()])
        rank = max(rank, int(np.linalg.matrix_rank(scaled, tol=1e-9)))
    alignment = []
    for value in eigenvalues:
        rows = _assignable(a, c, value)
        basis = np.linalg.qr(rows.T)[0]
        wanted = c / np.linalg.norm(c, axis=1, keepdims=True)
        alignment.append(float(np.linalg.norm(wanted @ basis, axis=1).min()))
    return Decoupling(
        weight_rank=int(np.linalg.matrix_rank(c @ model.delay_variation)),
        alignment=np.array(alignment),
        ratio_error=error,
        rank_of_both=rank,
    )


def _assignable(dynamics: FloatArray, measurement: FloatArray, eigenvalue: float) -> FloatArray:
    """(p, s): rows that span the left eigenvectors which a gain can give to an eigenvalue (eq. 23)."""
    shifted = eigenvalue * np.eye(dynamics.shape[0]) - dynamics
    return np.asarray(-np.linalg.solve(shifted.T, measurement.T).T, np.float64)


def _held(motion: FloatArray, entry: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Transition and entry over a period for an input that is held constant."""
    with extra("baselines", "a ResidualDesign"):
        from scipy.linalg import expm  # only here: SciPy is slow to import

    size, inputs = entry.shape
    block = np.zeros((size + inputs, size + inputs))
    block[:size, :size], block[:size, size:] = motion, entry
    step = np.asarray(expm(block * period), np.float64)
    return step[:size, :size], step[:size, size:]


def _discrete(
    dynamics: FloatArray,
    command: FloatArray,
    measurement: FloatArray,
    fault: FloatArray,
    gain: FloatArray,
    period: float,
    late: int,
) -> ResidualDesign:
    """The observer of this gain by Tustin's rule."""
    with extra("baselines", "a ResidualDesign"):
        from scipy.signal import cont2discrete  # only here: SciPy is slow to import

    require(0.0 < period < math.inf, "period", period, "a positive number of s")
    motion = dynamics - gain @ measurement
    feedthrough = np.hstack([np.zeros((3, 3)), np.eye(3)])
    observer = (motion, np.hstack([command, gain]), -measurement, feedthrough)
    transition, entry, output, through, _ = cont2discrete(observer, period, "bilinear")
    return ResidualDesign(
        transition=transition,
        entry=entry,
        output=output,
        feedthrough=through,
        late=int(late),
        period=float(period),
        motion=motion,
        fault=fault,
    )
