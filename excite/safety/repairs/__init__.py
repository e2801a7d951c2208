"""Repairs of candidates that are not safe yet, one class each, by name in the registry."""
