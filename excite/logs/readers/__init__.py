"""Readers of trial files, one a format."""
