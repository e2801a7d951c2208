"""Injected effects of gears: play, elasticity."""
