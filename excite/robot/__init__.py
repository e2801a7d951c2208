"""A robot from its URDF or MJCF: limits, links, shapes."""
