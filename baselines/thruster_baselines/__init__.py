"""Classical methods for spacecraft whose thrusters fail: mapping, guidance and control.

Importing this package loads nothing else; import the part that you need, for example
`from thruster_baselines.mapping import LPMapper`.
"""
