"""Recordings of a robot: reading, cleaning, filtering, resampling."""
