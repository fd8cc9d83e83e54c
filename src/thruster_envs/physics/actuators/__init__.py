"""The mathematics of each kind of actuator that stores momentum, one module each."""
