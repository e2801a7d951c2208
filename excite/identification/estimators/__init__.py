"""Estimators of parameters from rows, one class each, by name in the registry."""
