"""Optimised excitation: the nonlinear program, its parts, and the search over several starts."""
