"""Readers of motions, one a format."""
