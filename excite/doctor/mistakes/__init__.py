"""Mistakes of whoever wrote a log, one each: what it would look like, and how it is undone."""
