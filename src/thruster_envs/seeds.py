"""Which seeds are for what: three disjoint sets, stated once.

Training draws its worlds from `TRAIN`. Thresholds are calibrated, curves drawn and settings chosen on
`VALIDATION`. The table is made on `TEST`, which nothing else touches.
"""

from __future__ import annotations

from thruster_envs.configuration import require, shown

TRAIN = range(1_000_000)
VALIDATION = range(2_000_000, 3_000_000)
TEST = range(3_000_000, 4_000_000)


def first_training_seed(seed: int, worlds: int) -> int:
    """First world seed of a training run, so that runs with different seeds share no world.

    Raises:
        ValueError: A run whose worlds lie outside of `TRAIN`, or that has none.

    >>> first_training_seed(2, worlds=256)
    512
    """
    if not 1 <= worlds <= len(TRAIN):
        raise ValueError(f"worlds must be from 1 to {len(TRAIN)}, got {shown(worlds)}")
    first = TRAIN.start + seed * worlds
    most = len(TRAIN) // worlds - 1
    require(0 <= seed <= most, "seed", seed, f"with {worlds} worlds, a whole number from 0 to {most}")
    return first
