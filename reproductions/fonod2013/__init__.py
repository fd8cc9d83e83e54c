"""Fonod, Henry, Charbonnel and Bornschlegl 2013: thruster faults of a chaser about Mars.

Some of the studies quote *our draft*: a plain simulation that was written while this project was designed,
apart from this code. It is not part of the project, and no command makes its numbers again; they are a check
from outside, as a source's are.
"""

from functools import partial

from reproductions.record import Reproduction
from reproductions.record import reproduces as _reproduces

__all__ = ["Result", "reproduces"]

reproduces = partial(_reproduces, source="Fonod 2013")
Result = partial(Reproduction, source="Fonod 2013")
"""One of a family of results, which a module has in `REPRODUCTIONS`."""
