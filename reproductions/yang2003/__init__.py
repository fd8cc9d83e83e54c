"""Yang 2003: Optimal thruster selection with robust estimation for formation flying applications, MIT.

Lines L... are those of the text of the thesis that this project worked from; ids are those of its list of
experiments.
"""

from functools import partial

from reproductions.record import Reproduction
from reproductions.record import reproduces as _reproduces

__all__ = ["Result", "reproduces"]

reproduces = partial(_reproduces, source="Yang 2003")
Result = partial(Reproduction, source="Yang 2003")
"""One of a family of results, which a module has in `REPRODUCTIONS`."""
