"""Collision geometry: shapes, hulls of meshes, pairs that may be ignored."""
