"""The checks of a vector environment: one function each, in one module for each thing that users rely on."""
