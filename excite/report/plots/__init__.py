"""Figures, one kind each."""
