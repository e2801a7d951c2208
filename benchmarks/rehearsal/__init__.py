"""Motions that pass the check, run in simulation on robots and grounds that are not as the model says."""
