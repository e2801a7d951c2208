"""Readers of motion laboratories' files."""
