"""Sections of the page of a log that was looked through."""
