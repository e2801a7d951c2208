"""Non-linear parameters of all terms of a model of the gap, searched together at last."""
