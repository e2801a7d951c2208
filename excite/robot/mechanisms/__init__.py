"""Joints that no motor drives: closed loops and couplings, and how their motion follows from the motors'."""
