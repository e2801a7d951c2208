"""Strict reading of URDF: its tree, inertias, geometry and numbers."""
