"""A load at the end effector, and the gains of the drives that a known one gives."""
