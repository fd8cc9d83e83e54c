"""How craft move: compiled kernels over batches of attitude, relative orbit, thruster firing and sensing."""
