"""Triangular factors."""

from __future__ import annotations

import numpy as np

from excite.regressor.base_parameters import r_factor


def test_a_factor_stands_for_its_rows_without_squaring_their_condition() -> None:
    # An ill-conditioned matrix whose singular values are known: the Gram matrix would lose the smallest.
    random = np.random.default_rng(0)
    left, right = (np.linalg.qr(random.normal(size=shape))[0] for shape in ((40, 5), (5, 5)))
    values = 10.0 ** -np.arange(0.0, 14.0, 3.0)
    rows = left @ (values[:, None] * right)
    factor = r_factor(rows)
    assert factor.shape == (5, 5)
    np.testing.assert_array_equal(factor, np.triu(factor))
    np.testing.assert_allclose(np.linalg.svd(factor, compute_uv=False), values, rtol=1e-3)
