"""Postures of a person from markers."""
