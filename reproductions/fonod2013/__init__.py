"""Fonod, Henry, Charbonnel and Bornschlegl 2013: thruster faults of a chaser about Mars.

Some of the studies quote *our draft*: a plain simulation that was written while this project was designed,
apart from this code. It is not part of the project, and no command makes its numbers again; they are a check
from outside, as a source's are.
"""
