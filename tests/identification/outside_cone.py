"""What positive definite inertias about the joint frames leave: bodies that cannot exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.inertia import central_inertia_matrices, pseudo_inertia_matrices

_ROUNDING = 1e-9


@dataclass(frozen=True)
class OutsideCone:
    """Segments whose pseudo-inertia is not positive semidefinite, and why.

    Attributes:
        n_segments: segments that were looked at.
        outside: names of those that no density that is not negative gives.
        triangle: names of those that break the triangle inequality about their centre of mass.
        central: names of those whose inertia about the centre of mass is not positive definite, or that have no
            mass.
        least_eigenvalue: least eigenvalue over all pseudo-inertias, each divided by its largest.
    """

    n_segments: int
    outside: tuple[str, ...]
    triangle: tuple[str, ...]
    central: tuple[str, ...]
    least_eigenvalue: float

    @property
    def count(self) -> int:
        """Number of bodies outside the cone."""
        return len(self.outside)


def outside_cone(parameters: Array, names: tuple[str, ...], skipped: tuple[int, ...] = ()) -> OutsideCone:
    """Count the bodies that cannot exist (Wensing, Kim and Slotine 2018).

    The sphere constraint of Jovic et al. 2016 (eq. 13) does not exclude them: it bounds the inertia about the
    joint frame alone, as their conclusion says.

    Args:
        parameters: ``(10·n_segments,)``, pinocchio's order, joint frames.
        names: of the segments.
        skipped: segments that are not counted, such as those the sensors do not see.
    """
    kept = [k for k in range(len(names)) if k not in skipped]
    eigen = np.linalg.eigvalsh(pseudo_inertia_matrices(parameters))[kept]
    relative = eigen[:, 0] / np.maximum(np.abs(eigen).max(axis=1), 1e-300)
    inertia = central_inertia_matrices(parameters)[kept]
    known = np.isfinite(inertia).all(axis=(1, 2))
    principal = np.full((len(kept), 3), np.nan)
    principal[known] = np.linalg.eigvalsh(inertia[known])
    positive = known & (principal[:, 0] > 0.0)
    triangle = ~(principal[:, 0] + principal[:, 1] >= principal[:, 2] * (1.0 - _ROUNDING))

    def named(mask: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(names[k] for k, flag in zip(kept, mask, strict=True) if flag)

    return OutsideCone(
        n_segments=len(kept),
        outside=named(relative < -_ROUNDING),
        triangle=named(triangle),
        central=named(~positive),
        least_eigenvalue=float(relative.min(initial=np.inf)),
    )
