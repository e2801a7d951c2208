"""Sections of the page of a diagnosis."""
