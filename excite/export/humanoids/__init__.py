"""Sequences for humanoids and quadrupeds, and motions of people."""
