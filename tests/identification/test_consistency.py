"""Consistency, fits and constraints against bodies whose properties are known."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.estimators.hqp import quadratic_row
from excite.identification.estimators.projection import distance_to_optimum
from excite.identification.inertia import inertia_matrices, pseudo_inertia_matrices
from excite.identification.judgement import check_consistency, correlate_signals
from tests.identification.dual_active_set import project
from tests.identification.icosphere import icosphere_corners


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


class TestSphere:
    @pytest.mark.parametrize(("level", "count"), [(0, 12), (1, 42), (5, 10242)])
    def test_corners(self, level, count):
        points = icosphere_corners(level)
        assert len(points) == count
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0)
        assert len(np.unique(points.round(9), axis=0)) == count

    def test_rows_are_the_quadratic_form(self):
        """Eq. (14) of Jovic et al. 2016."""
        ten = pin.Inertia.Random().toDynamicParameters()
        vectors = icosphere_corners(1)
        expected = np.einsum("vi,ij,vj->v", vectors, inertia_matrices(ten)[0], vectors)
        rows = np.array([quadratic_row(v) for v in vectors])
        np.testing.assert_allclose(rows @ ten[4:], expected, rtol=1e-9, atol=1e-12)


class TestProjection:
    def test_known_corner(self):
        half = LinearConstraints(np.eye(2), np.array([1.0, -5.0]), ("a:x", "a:y"))
        equal = LinearConstraints(np.array([[1.0, 1.0]]) / np.sqrt(2), np.array([0.0]), ("b:sum",), 1)
        rows = stack_constraints([half, equal], 2)
        answer = project(np.array([0.0, 2.0]), rows)
        np.testing.assert_allclose(answer.z, [1.0, -1.0], atol=1e-12)
        assert distance_to_optimum(np.array([0.0, 2.0]), rows, answer) < 1e-7

    def test_bound_is_never_below_the_distance(self):
        rng = np.random.default_rng(0)
        rows = LinearConstraints(rng.standard_normal((6, 4)), -np.ones(6), ("a:b",) * 6)
        target = 3.0 * rng.standard_normal(4)
        best = project(target, rows)
        for _ in range(50):
            z = best.z * rng.uniform(0.0, 1.0)
            if rows.violations(z).max() > 0.0:
                continue
            multipliers = np.abs(rng.standard_normal(6))
            bound = distance_to_optimum(target, rows, type(best)(z, multipliers))
            assert bound >= np.linalg.norm(z - best.z) - 1e-9

    def test_contradiction(self):
        rows = LinearConstraints(np.array([[1.0], [-1.0]]), np.array([1.0, 1.0]), ("a:x", "a:y"))
        assert project(np.zeros(1), rows) is None


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
