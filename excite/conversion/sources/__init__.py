"""Readers of recordings, one a file format."""
