"""When a parameter is known too poorly to be used by itself."""

from __future__ import annotations

import math

from excite.shown import percent

POOR_RSD = 30.0
"""Relative standard deviation above which a parameter is warned of [percent]."""

PATIENCE = 10.0
"""A parameter that would need more than this many times the motion run so far is left to the noise."""

# Even so much more motion would leave the value as uncertain as it is large: deviations fall with its root [percent].
_NOT_SHOWN = 100.0 * math.sqrt(PATIENCE)

NOT_SHOWN = "not shown by these motions"
"""What is said in place of a relative standard deviation that is no figure to compare any more."""


def said_rsd(rsd_percent: float | None) -> str:
    """A relative standard deviation for a person [percent]; None is one that is not known.

    >>> said_rsd(3.14), said_rsd(4880455121.0), said_rsd(None)
    ('3.1 %', 'not shown by these motions', 'not shown by these motions')
    """
    return NOT_SHOWN if rsd_percent is None or not rsd_percent <= _NOT_SHOWN else percent(rsd_percent)
