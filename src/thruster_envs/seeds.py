"""Which seeds are for what: three disjoint sets, stated once.

Training draws its worlds from `TRAIN`. Thresholds are calibrated, curves drawn and settings chosen on
`VALIDATION`. The table is made on `TEST`, which nothing else touches.
"""

from __future__ import annotations

TRAIN = range(1_000_000)
VALIDATION = range(2_000_000, 3_000_000)
TEST = range(3_000_000, 4_000_000)


def first_training_seed(seed: int, worlds: int) -> int:
    """First world seed of a training run, so that runs with different seeds share no world.

    Raises:
        ValueError: A run whose worlds lie outside of `TRAIN`.

    >>> first_training_seed(2, worlds=256)
    512
    """
    first = TRAIN.start + seed * worlds
    if seed < 0 or first + worlds > TRAIN.stop:
        most = len(TRAIN) // worlds - 1
        raise ValueError(
            f"seed is {seed}; with {worlds} worlds, a whole number from 0 to {most} would be right"
        )
    return first
