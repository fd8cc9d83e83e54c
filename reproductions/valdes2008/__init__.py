"""Valdes 2008: dynamic neural network-based fault diagnosis of pulsed plasma thrusters, Concordia University.

Lines L... are those of the text of the thesis that this project worked from; ids are those of its list of
experiments. Figures survive there by their captions alone: what stands only in a plot is not compared. All
"msec" of its chapter 4 are microseconds.
"""

from functools import partial

from reproductions.record import Reproduction
from reproductions.record import reproduces as _reproduces

__all__ = ["Result", "reproduces"]

reproduces = partial(_reproduces, source="Valdes 2008")
Result = partial(Reproduction, source="Valdes 2008")
"""One of a family of results, which a module has in `REPRODUCTIONS`."""
