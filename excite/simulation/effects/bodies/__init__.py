"""Injected effects of bodies and their placement."""
