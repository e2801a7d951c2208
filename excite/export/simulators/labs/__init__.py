"""Configurations of simulators for learning, which are Python: how they are written and how they are read."""
