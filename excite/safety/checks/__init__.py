"""Checks of a motion, one class each, listed in the registry."""
