"""Drawn problems for the safety check, judged a second time by code that shares nothing with it."""
