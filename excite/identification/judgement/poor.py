"""When a parameter is known too poorly to be used by itself."""

from __future__ import annotations

POOR_RSD = 30.0
"""Relative standard deviation above which a parameter is warned of [percent]."""
