"""Robots as bodies and joints, on the way into files and out of them again."""
