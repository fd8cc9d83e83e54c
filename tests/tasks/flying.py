"""A batch of worlds of a task, without any view around it."""

import numpy as np

from thruster_envs.views.worlds import Worlds


def begin(task, worlds=1, seed=0, limit=None, options=None):
    """Worlds that have just begun, with seeds from ``seed`` on."""
    batch = Worlds(task, worlds, max_episode_steps=limit)
    everyone = np.arange(worlds)
    batch.seed(everyone, [seed + world for world in range(worlds)])
    batch.reset(everyone, options)
    return batch


def actions(duties):
    """Actions (worlds, 1, n) from duties (worlds, n)."""
    return (2.0 * np.asarray(duties) - 1.0)[:, np.newaxis]
