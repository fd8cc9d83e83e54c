"""A classical player of the diagnosis tasks: likelihood ratios of every thruster in every way of failing.

It sees observations only. The residual of a period (measured less expected rate change) is compared with what
each thruster would leave if it lost a share of its thrust, leaked, stood open or were tilted, the size being
fitted; noise is that of the sensors and of the scatter of the pulses commanded. The evidence is summed over
windows of several lengths, since nobody knows the onset (Willsky and Jones 1976).
"""

import numpy as np

from thruster_envs.faults import mode_of
from thruster_envs.spacecraft import load

LOSS, LEAK, OPEN, TILT = range(4)
KINDS = ("loss", "leak", "stuck_on", "misalignment")
#: By how much a hypothesis must beat that of no fault, in log-likelihood; tilt has a number more to fit.
THRESHOLD, TILT_PENALTY = 10.0, 3.0
LARGEST_TILT = 0.8  # rad
#: Smallest sizes that count as a fault.
SMALLEST = np.array([0.15, 0.05, 0.3])
#: Share of a thruster's effect, one deviation: a scatter of 0.1, uniform, is 0.058; the rest stands for the
#: coupling that a fault changes. Share of the square of the rate by which a spin in free motion is misjudged.
SCATTER, GYRO = 0.08, 0.02


def inverse_inertia(vehicle):
    return np.linalg.inv(np.array(vehicle.inertia))


def sideways(vehicle):
    """(2, 6, n): effectiveness of each thruster if it pushed square to its direction, either way."""
    columns = np.zeros((2, 6, vehicle.number_of_thrusters))
    for i, thruster in enumerate(vehicle.thrusters):
        direction = np.array(thruster.direction)
        first = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
        first /= np.linalg.norm(first)
        for k, across in enumerate((first, np.cross(direction, first))):
            force = thruster.thrust * across
            columns[k, :3, i] = force / vehicle.mass
            columns[k, 3:, i] = inverse_inertia(vehicle) @ np.cross(thruster.position, force)
    return columns


class LikelihoodPlayer:
    """Declares, in a batch of worlds, the hypothesis that is likeliest beyond a threshold.

    Args:
        worlds: How many.
        spacecraft: What they fly.
    """

    def __init__(self, worlds, spacecraft="orion"):
        self.vehicle = vehicle = load(spacecraft)
        self.n, self.period = vehicle.number_of_thrusters, vehicle.control_period
        self.effectiveness, self.sideways = vehicle.effectiveness(), sideways(vehicle)
        self.authority = vehicle.authority()
        self.noise = 2.0 * np.repeat([vehicle.sensors.velocity, vehicle.sensors.rate], 3) ** 2
        self.sums = [self._nothing(worlds)]

    def _nothing(self, worlds):
        n = self.n
        return tuple(np.zeros(shape) for shape in ((3, 3, worlds, n), (worlds, n, 2), (worlds, n, 2, 2)))

    def __call__(self, observations):
        """Declarations (worlds, 2) from observations (worlds, size)."""
        self._take_in(np.asarray(observations, dtype=np.float64))
        best = np.full((4, len(observations), self.n), -np.inf)
        size = np.zeros_like(best)
        length = 1
        while length < len(self.sums):
            for which, (evidence, fitted) in enumerate(self._evidence(length)):
                better = evidence > best[which]
                best[which] = np.where(better, evidence, best[which])
                size[which] = np.where(better, fitted, size[which])
            length *= 2
        return self._declare(best, size)

    def _take_in(self, observations):
        n = self.n
        duties = observations[:, 13 : 13 + n]
        measured, expected = (observations[:, at : at + 6] * self.authority for at in (13 + n, 19 + n))
        on_times, residual = self.period * duties, measured - expected
        coupling = self.vehicle.feed.coupling
        together = np.minimum(on_times[:, :, None], on_times[:, None, :]).sum(axis=2) - on_times
        effective = np.maximum(on_times - coupling * together, 0.0)
        spin = 0.2 * np.linalg.norm(observations[:, 9:12], axis=1)
        scatter = self.effectiveness * (SCATTER * effective)[:, None, :]
        covariance = scatter @ scatter.transpose(0, 2, 1) + np.diag(self.noise)
        # A craft that turns smears its impulse over the axes, and its gyroscopic torque is known less well.
        smear = 0.5 * self.period * spin * np.linalg.norm(measured[:, :3], axis=1)
        wobble = GYRO * self.period * spin**2
        covariance[:, [0, 1, 2], [0, 1, 2]] += smear[:, None] ** 2
        covariance[:, [3, 4, 5], [3, 4, 5]] += wobble[:, None] ** 2
        weight = np.linalg.inv(covariance)
        weighted = weight @ self.effectiveness
        square = np.einsum("kn,wkn->wn", self.effectiveness, weighted)
        along = np.einsum("wk,wkn->wn", residual, weighted)
        closed = self.period - on_times
        one = np.zeros((3, 3, len(observations), n))  # hypothesis; offset, first and second order in the size
        one[LOSS] = 0.0 * along, -effective * along, effective**2 * square
        one[LEAK] = 0.0 * along, closed * along, closed**2 * square
        one[OPEN] = (
            -effective * along - 0.5 * effective**2 * square,
            self.period * (along + effective * square),
            self.period**2 * square + 0.0 * along,
        )
        across = np.einsum("wk,wkl,aln->wna", residual, weight, self.sideways) * effective[..., None]
        information = (
            np.einsum("akn,wkl,bln->wnab", self.sideways, weight, self.sideways, optimize=True)
            * effective[..., None, None] ** 2
        )
        self.sums.append(
            tuple(before + new for before, new in zip(self.sums[-1], (one, across, information), strict=True))
        )

    def _evidence(self, length):
        """Log-likelihood ratio and size of each hypothesis over the last periods, (worlds, n) each."""
        one, across, information = (
            last - before for last, before in zip(self.sums[-1], self.sums[-1 - length], strict=True)
        )
        for which in (LOSS, LEAK, OPEN):
            offset, first, second = one[which]
            size = np.clip(first / np.maximum(second, 1e-12), SMALLEST[which], 1.0)
            yield offset + size * first - 0.5 * size**2 * second, size
        tilt = np.linalg.solve(information + 1e-9 * np.eye(2), across[..., None])[..., 0]
        size = np.linalg.norm(tilt, axis=-1)
        share = np.minimum(size, LARGEST_TILT) / np.maximum(size, 1e-12)
        yield (share - 0.5 * share**2) * (tilt * across).sum(axis=-1) - TILT_PENALTY, share * size

    def _declare(self, best, size):
        worlds = best.shape[1]
        flat = best.transpose(1, 0, 2).reshape(worlds, -1)
        likeliest, everyone = flat.argmax(axis=1), np.arange(worlds)
        found = flat[everyone, likeliest] > THRESHOLD
        kind, thruster = likeliest // self.n, likeliest % self.n
        fitted = size[kind, everyone, thruster]
        modes = [mode_of(KINDS[k], one) for k, one in zip(kind, fitted, strict=True)]
        return np.where(found[:, None], np.stack((thruster + 1, modes), axis=1), 0)
