"""Motions, their files, and the generators that make them."""
