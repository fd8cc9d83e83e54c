"""Yang 2003: Optimal thruster selection with robust estimation for formation flying applications, MIT.

Lines L... are those of the text of the thesis that this project worked from; ids are those of its list of
experiments.
"""
