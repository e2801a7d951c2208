"""Generators of candidate motions, one class each, by name in the registry."""
