"""Robots for simulators: what is written is read by readers of the tests' own."""
