"""When a parameter is known too poorly to be used by itself."""

from __future__ import annotations

POOR_RSD = 30.0
"""Relative standard deviation above which a parameter is warned of [percent]."""

PATIENCE = 10.0
"""A parameter that would need more than this many times the motion run so far is left to the noise."""
