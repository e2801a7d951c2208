"""Consistency, fits and constraints against bodies whose properties are known."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.judgement import check_consistency, correlate_signals


def _body(mass=2.0, com=(0.1, -0.2, 0.3), principal=(0.02, 0.03, 0.04)) -> np.ndarray:
    return pin.Inertia(mass, np.array(com), np.diag(principal)).toDynamicParameters()


class TestConsistency:
    def test_a_body_that_exists(self):
        found = check_consistency(np.concatenate([_body(), _body(0.3)]), ("a", "b"))
        assert found.mass_positive and found.inertia_positive_definite and found.triangle_inequality
        assert found.pseudo_inertia_min_eigenvalue > 0.0
        assert found.inconsistent == ()

    def test_triangle_inequality_alone_broken(self):
        """Positive definite inertia that no distribution of mass has."""
        found = check_consistency(np.concatenate([_body(), _body(principal=(0.01, 0.01, 0.05))]), ("a", "b"))
        assert found.inertia_positive_definite and not found.triangle_inequality
        assert found.pseudo_inertia_min_eigenvalue < 0.0
        assert found.inconsistent == ("b",)

    def test_negative_mass(self):
        body = _body()
        body[0] = -0.1
        found = check_consistency(body, ("a",))
        assert not found.mass_positive and not found.triangle_inequality and found.inconsistent == ("a",)

    def test_matrices_are_pinocchios(self):
        body = pin.Inertia.Random()
        ten = body.toDynamicParameters()
        np.testing.assert_allclose(pin.PseudoInertia.FromDynamicParameters(ten).toMatrix(),
                                   pseudo_inertia_matrices(ten)[0], atol=1e-12)  # fmt: skip


def test_correlation_of_a_constant_is_not_known():
    assert correlate_signals(np.full(10, 3.0), np.arange(10.0)) is None
    assert correlate_signals(np.arange(10.0), -2.0 * np.arange(10.0)) == pytest.approx(-1.0)


def test_links_between_the_axes_of_a_joint_are_no_bodies():
    body = np.array([2.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.02, 0.0, 0.0, 0.02])
    both = check_consistency(np.concatenate([np.zeros(10), body]), ("between", "body"))
    assert both == check_consistency(body, ("body",))
    assert both.mass_positive and both.triangle_inequality
    nothing = check_consistency(np.zeros(10), ("between",))
    assert not nothing.mass_positive
