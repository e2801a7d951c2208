"""Triangular factors of tall regressors."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array


def r_factor(rows: Array) -> Array:
    """The R of ``rows = Q R``: ``(min(m, n), n)``, upper triangular, for rows of shape ``(m, n)``.

    It stands for the rows in every least-squares question, and its condition number is theirs, where that of
    the Gram matrix ``rowsᵀ rows`` would be its square.
    """
    return np.asarray(np.linalg.qr(rows, mode="r"))
