"""Robots for simulators, each in the simulator's own terms, and proof that it hears every parameter."""
