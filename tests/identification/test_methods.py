"""What single methods promise beyond the shared battery, and the constraints that they are made of."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, NoSolutionError, UnknownNameError
from excite.identification.constraints.linear import mirrored_parameters, within_bounds
from excite.identification.estimators.hqp import (
    BoundedNearBase,
    HierarchicalProgram,
    HqpSettings,
    masses_in_range,
    mirrored_pairs,
)
from excite.identification.estimators.least_squares import (
    WeightedLeastSquares,
    WlsSettings,
)
from excite.identification.estimators.projection import ProjectionAnswer
from excite.identification.estimators.settings import ParameterBoundsSettings
from excite.identification.inertia import inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import prior_std
from excite.regressor.base_parameters import base_parameters
from excite.robot.loading import load_robot
from tests.identification.dual_active_set import project
from tests.identification.estimated import estimated
from tests.identification.icosphere import icosphere_corners
from tests.identification.outside_cone import outside_cone
from tests.identification.synthetic import arm_problem, modified_g1_parameters, segment_index, wrench_problem

FEET = ("left_ankle_roll_link", "right_ankle_roll_link")


@pytest.fixture(scope="module")
def arm() -> IdentificationProblem:
    return arm_problem(load_robot("panda"), seed=0)


@pytest.fixture(scope="module")
def standing(g1) -> IdentificationProblem:
    feet = tuple(segment_index(g1, link) for link in FEET)
    true = modified_g1_parameters(g1)
    return wrench_problem(g1, true, seed=1, trials=2, duration=5.0, unmeasured=feet)


class TestHierarchicalProgram:
    def test_paper_levels_hold_on_every_vector(self, standing):
        """Eq. (8)–(14) of Jovic et al. 2016 with its numbers: 10 242 vectors, ε = 0.01; eq. (16) with β = 0.35."""
        settings = HqpSettings()
        found = HierarchicalProgram().estimate(standing, settings)
        moving = [k for k in range(30) if k not in standing.unmeasured]
        vectors = icosphere_corners(5)
        assert vectors.shape == (10242, 3)
        inertia = inertia_matrices(found.parameters)[moving]
        values = np.einsum("vi,sij,vj->sv", vectors, inertia, vectors)
        assert values.min() >= 0.01 * (1.0 - 1e-5)
        ten, nominal = found.parameters.reshape(-1, 10), standing.prior.reshape(-1, 10)
        assert (ten[:, 0] >= -1e-9).all()
        assert (np.abs(ten[:, 0] / nominal[:, 0] - 1.0) <= 0.35 + 1e-6).all()
        for index, segment in enumerate(standing.robot.segments):
            if segment.pair is not None and segment.pair > index:
                assert 0.9 - 1e-6 <= ten[index, 0] / ten[segment.pair, 0] <= 1.0 / 0.9 + 1e-6
        count = outside_cone(found.parameters, tuple(s.link for s in standing.robot.segments)).count
        assert count > 0, "the sphere constraint alone lets bodies through that cannot exist"

    def test_narrow_ranges_give_way_to_the_total_mass(self, standing, g1):
        """Five kilograms more do not fit into β = 0.05: level two yields, level one does not."""
        found = HierarchicalProgram().estimate(standing, HqpSettings(mass_range=0.05))
        assert found.violations["mass_range"] > 0.1
        assert found.violations["total_mass"] < 1e-9
        assert found.parameters[::10].sum() == pytest.approx(modified_g1_parameters(g1)[::10].sum(), rel=0.01)

    def test_contradiction_at_the_first_level_is_reported_with_the_best(self, standing):
        with pytest.raises(NoSolutionError, match="infeasible") as caught:
            HierarchicalProgram().estimate(standing, HqpSettings(total_mass=0.5))
        assert np.isfinite(caught.value.best.parameters).all()
        assert caught.value.exit_code == 3

    @pytest.mark.parametrize("kind", [HierarchicalProgram, BoundedNearBase])
    @pytest.mark.parametrize("lie", ["ignores", "nan", "none"])
    def test_lying_projector_is_caught(self, kind, lie, arm):
        settings = dict(sphere_epsilon=1e-3, bound_width=0.1)
        honest = estimated(kind(projector=project), arm, **settings)

        def liar(target, rows):
            if lie == "none":
                return None
            if lie == "nan":
                return ProjectionAnswer(np.full_like(target, np.nan), np.zeros(len(rows.bound)))
            return ProjectionAnswer(target.copy(), np.zeros(len(rows.bound)))

        try:
            found = estimated(kind(projector=liar), arm, **settings)
        except NoSolutionError as error:
            assert np.isfinite(error.best.parameters).all()
        else:
            np.testing.assert_allclose(arm.Y @ found.parameters, arm.Y @ honest.parameters, atol=1e-3)


class TestBounded:
    def test_bounds_hold_exactly_and_nothing_within_is_nearer(self, arm):
        settings = ParameterBoundsSettings(bound_width=0.1)
        found = BoundedNearBase().estimate(arm, settings)
        free = WeightedLeastSquares().estimate(arm, WlsSettings()).parameters
        assert found.active, "no bound binds"
        spread = prior_std(arm, settings.spreads(arm.robot))
        assert (np.abs(found.parameters - arm.prior) <= 0.1 * spread * (1.0 + 1e-12)).all()
        # Random points within the bounds: none has base parameters nearer to the least-squares ones.
        base = base_parameters(found.regression.factor[:, :-1], arm.parameter_names).matrix
        best = np.linalg.norm(base @ (found.parameters - free))
        rng = np.random.default_rng(0)
        others = found.parameters + 0.02 * spread * rng.standard_normal((500, arm.n_params))
        others = np.clip(others, arm.prior - 0.1 * spread, arm.prior + 0.1 * spread)
        others[:, ::10] = np.maximum(others[:, ::10], 0.0)
        assert np.linalg.norm((others - free) @ base.T, axis=1).min() >= best * (1.0 - 1e-9)

    def test_bounds_that_leave_nothing_are_named(self, arm):
        bounds = np.array([np.full(arm.n_params, 1.0), np.full(arm.n_params, 0.0)])
        with pytest.raises(InputError, match=r"panda_link1|link1"):
            BoundedNearBase().estimate(arm, ParameterBoundsSettings(parameter_bounds=bounds))
        with pytest.raises(InputError, match="shape"):
            within_bounds(arm, np.zeros((2, 3)))


class TestRows:
    def test_mirror_image_is_that_of_pinocchio(self, g1):
        """A left body moved to the world, mirrored point by point, and moved into the right frame."""
        pairs = [(k, s.pair) for k, s in enumerate(g1.segments) if s.pair is not None and s.pair > k]
        left, right = pairs[3]
        rng = np.random.default_rng(0)
        points, mass = rng.normal(size=(20, 3)), rng.uniform(0.1, 1.0, 20)

        def ten(where):
            bodies = [pin.Inertia(m, p, np.zeros((3, 3))) for m, p in zip(mass, where, strict=True)]
            total = sum(bodies, pin.Inertia.Zero())
            return total.toDynamicParameters()

        data = g1.model.createData()
        pin.forwardKinematics(g1.model, data, pin.neutral(g1.model))
        a, b = (data.oMi[g1.segments[k].joint] for k in (left, right))
        base = data.oMi[1]
        there = np.array([base.actInv(a).act(p) for p in points]) * [1.0, -1.0, 1.0]
        back = np.array([base.actInv(b).actInv(p) for p in there])
        np.testing.assert_allclose(mirrored_parameters(g1, left, right) @ ten(points), ten(back), atol=1e-9)

    def test_nominal_g1_is_symmetric_within_ten_percent(self, standing):
        rows = mirrored_pairs(standing, 0.1)
        assert len(rows.bound) == 16 * sum(
            s.pair is not None and s.pair > k for k, s in enumerate(standing.robot.segments)
        )
        assert rows.violations(standing.prior).max() < 0.05

    def test_named_segments_need_not_mirror(self, standing):
        robot = standing.robot
        left = next(k for k, s in enumerate(robot.segments) if s.pair is not None and s.pair > k)
        for one in (left, robot.segments[left].pair):
            settings = HqpSettings(asymmetric=(robot.segments[one].link,))
            rows = mirrored_pairs(standing, 0.1, settings.free_of_symmetry(robot))
            assert len(rows.bound) == len(mirrored_pairs(standing, 0.1).bound) - 16
            assert f"mirror:{robot.segments[left].link}" not in rows.labels
        for settings in (
            HqpSettings(asymmetric=("tail",)),
            HqpSettings(segment_mass_range={"tail": 1}),
        ):
            with pytest.raises(UnknownNameError, match="segment 'tail'"):
                settings.free_of_symmetry(robot)
                settings.mass_ranges(robot)

    def test_mass_range_is_eq_16(self, arm):
        rows = masses_in_range(arm, np.full(len(arm.robot.segments), 0.2))
        heavy = arm.prior.copy()
        heavy[10] *= 1.3
        assert rows.violations(arm.prior).max() == 0.0
        assert rows.violations(heavy).max() == pytest.approx(0.1 * arm.prior[10])


class TestOutsideCone:
    def test_names_what_breaks(self):
        nominal = load_robot("panda").nominal_parameters
        names = tuple("abcdefg")
        assert outside_cone(nominal, names).count == 0
        wrong = nominal.copy()
        # A principal moment above the sum of the others: positive definite, and yet no body.
        wrong[10:14] = 1.0, 0.0, 0.0, 0.0
        wrong[14:20] = 3.0, 0.0, 1.0, 0.0, 0.0, 1.0
        found = outside_cone(wrong, names)
        assert (found.outside, found.triangle, found.central) == (("b",), ("b",), ())
        wrong[20] = -1.0
        found = outside_cone(wrong, names, skipped=(1,))
        assert (found.outside, found.central, found.n_segments) == (("c",), ("c",), 6)
