"""Sections of the report, one a kind of result."""
