"""Fonod, Henry, Charbonnel and Bornschlegl 2013: thruster faults of a chaser about Mars."""
