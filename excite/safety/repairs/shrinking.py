"""Milder versions of a leg motion, for legs that cannot follow it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from excite.motion.generators.candidate import Candidate
from excite.motion.generators.curves import Curve, SplineCurve
from excite.motion.generators.polynomials import PolynomialCurve

# Shares of a leg motion that are tried in turn; of one on a single leg, for the free foot and for the pelvis, whose
# lean over the other foot brings the thighs together.
_SHRINKS = (0.85, 0.7, 0.55)
_ONE_LEG_SHRINKS = ((0.85, 1.0), (0.7, 1.0), (0.55, 1.0), (0.7, 0.6), (0.55, 0.4))
# Shares of the pitch of a walk's free soles, and of the pelvis's roll, which hips stop or ankles need.
_WALK_SHRINKS = ((0.5, 1.0), (0.5, 0.5), (0.5, 1.4))


def milder_candidates(candidate: Candidate) -> Iterator[Candidate]:
    """The candidate with milder leg motions, in turn; none if it has no leg motion."""
    pelvis, com = candidate.pelvis, candidate.com
    if candidate.zmp is not None:
        # Footprints, pelvis and centre of mass belong together, but for these.
        for pitch, lean in _WALK_SHRINKS:
            feet = {
                name: _scale_curve(curve, [1.0, 1.0, 1.0, 1.0, pitch, 1.0])
                for name, curve in candidate.feet.items()
            }
            yield replace(candidate, feet=feet, pelvis=pelvis and _scale_curve(pelvis, [1.0, lean, 1.0, 1.0]))
    elif candidate.feet:
        for swing, lean in _ONE_LEG_SHRINKS:
            feet = {name: curve.shrunk(swing) for name, curve in candidate.feet.items()}
            # As low as before: the legs have to reach as far.
            yield replace(
                candidate, feet=feet, pelvis=pelvis and _scale_curve(pelvis, [1.0, lean, lean, lean])
            )
    elif pelvis is not None:
        for factor in _SHRINKS:
            yield replace(candidate, pelvis=pelvis.shrunk(factor), com=com and com.shrunk(factor))


def _scale_curve(curve: Curve, factors: list[float]) -> Curve:
    return curve.shrunk(np.array(factors)) if isinstance(curve, PolynomialCurve | SplineCurve) else curve
