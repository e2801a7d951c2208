"""The noise of the equations: its size, its spectrum, the weights that follow."""
