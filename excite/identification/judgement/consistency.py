"""Whether identified parameters are those of bodies that can exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.inertia import central_inertia_matrices, inertia_matrices, pseudo_inertia_matrices

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Consistency:
    """Physical consistency of a set of segments, recomputed from the parameters themselves.

    Attributes:
        mass_positive: every mass is positive.
        inertia_positive_definite: every inertia about its joint frame's origin is positive definite.
        triangle_inequality: the principal inertias about every centre of mass obey the triangle inequality.
        pseudo_inertia_min_eigenvalue: least eigenvalue of all pseudo-inertias (units mixed: kg, kg·m, kg·m²).
        inconsistent: names of the segments whose pseudo-inertia is not positive semidefinite.
    """

    mass_positive: bool
    inertia_positive_definite: bool
    triangle_inequality: bool
    pseudo_inertia_min_eigenvalue: float
    inconsistent: tuple[str, ...]


def check_consistency(parameters: Array, names: tuple[str, ...]) -> Consistency:
    """Check the mass, inertia and pseudo-inertia of every segment.

    Args:
        parameters: ``(10·n_segments,)``, pinocchio's order, joint frames [SI].
        names: names of the segments.

    Returns:
        The verdicts; a segment with moments and no mass has no centre of mass and fails the triangle
        inequality; one with neither is no body.
    """
    # Links between the axes of one joint have neither mass nor moments: there is no body to judge.
    ten = np.asarray(parameters, dtype=float).reshape(-1, 10)
    there = np.asarray(ten.any(axis=1))
    if not there.all() and there.any():
        return check_consistency(
            ten[there].ravel(), tuple(name for name, is_body in zip(names, there, strict=True) if is_body)
        )
    masses = ten[:, 0]
    inertia = np.linalg.eigvalsh(inertia_matrices(parameters))
    central = central_inertia_matrices(parameters)
    known = np.isfinite(central).all(axis=(1, 2))
    principal = np.full((len(masses), 3), np.nan)
    principal[known] = np.linalg.eigvalsh(central[known])
    slack = principal[:, 0] + principal[:, 1] - principal[:, 2]
    pseudo = np.linalg.eigvalsh(pseudo_inertia_matrices(parameters))
    # Rounding is relative to the body: a hand's inertia is a millionth of a trunk's.
    bad = pseudo[:, 0] < -_ROUNDING * np.abs(pseudo).max(axis=1)
    return Consistency(
        mass_positive=bool((masses > 0.0).all()),
        inertia_positive_definite=bool((inertia[:, 0] > 0.0).all()),
        triangle_inequality=bool(known.all() and (slack >= -_ROUNDING * principal[:, 2]).all()),
        pseudo_inertia_min_eigenvalue=float(pseudo[:, 0].min()),
        inconsistent=tuple(name for name, flag in zip(names, bad, strict=True) if flag),
    )
