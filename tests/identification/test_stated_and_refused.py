"""What methods say: the exact words of refusals, what an error carries, limits of single segments, summaries."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from excite.errors import InputError, NoSolutionError, UnknownNameError
from excite.identification.constraints.linear import equivalent_boxes
from excite.identification.estimators.conic import (
    LmiSettings,
    PhysicallyConsistent,
    QpSettings,
    QuadraticProgram,
)
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.hqp import (
    HierarchicalProgram,
    HqpSettings,
    InertiaFloor,
    paper_levels,
)
from excite.identification.estimators.least_squares import (
    LeastSquares,
    LsSettings,
    MaximumAPosteriori,
    WeightedLeastSquares,
    WlsSettings,
)
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.physical import PhysicalRetrieval
from excite.identification.estimators.projection import ActiveSetProjector
from excite.identification.estimators.registry import DEFAULT_METHOD, ESTIMATORS, method_summaries
from excite.identification.estimators.scaled_problem import scaled_parameters
from excite.identification.estimators.settings import PullSettings, StatedBoundsSettings, known_segments
from excite.identification.inertia import inertia_matrices
from excite.identification.physical.bounds import KnownBounds
from excite.identification.physical.default_bounds import default_bounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import condense_problem, iterate_weights, prior_std
from excite.robot.loading import load_robot
from tests.identification.synthetic import arm_problem


@pytest.fixture(scope="module")
def arm() -> IdentificationProblem:
    return arm_problem(load_robot("panda"), seed=8, duration=1.0, noise=0.02, error=0.01)


# --- Settings


@pytest.mark.parametrize(
    ("method", "name", "value", "text"),
    [
        ("qp", "total_mass", 0.0, "settings: total_mass: is 0.0; choose 0.001 … 10000 kg"),
        ("ls", "total_mass", 1e5, "settings: total_mass: is 100000.0; choose 0.001 … 10000 kg"),
        ("hqp", "sphere_epsilon", -1.0, "settings: sphere_epsilon: is -1.0; choose 0 … 1000 kg·m²"),
        ("qp", "alpha", 0.0, "settings: alpha: is 0.0; choose 1e-12 … 1e+12"),
        ("qp", "alpha", None, "settings: alpha: is None; choose 1e-12 … 1e+12"),
        ("wls", "weight_iterations", 101, "settings: weight_iterations: is 101; choose 0 … 100"),
        ("hqp", "mass_range", -0.01, "settings: mass_range: is -0.01; choose 0 … 1e+06"),
        ("hqp", "mass_range", True, "settings: mass_range: is True; choose 0 … 1e+06"),
        ("adaptive", "alpha", 0.0, "settings: alpha: is 0.0; choose 1e-12 … 1e+12"),
        ("adaptive", "inertia_floor", None, "settings: inertia_floor: is None; choose 0 … 0.9"),
        ("adaptive", "inertia_floor", 0.91, "settings: inertia_floor: is 0.91; choose 0 … 0.9"),
        ("adaptive", "terms", "none", "settings: terms: is 'none'; choose chosen or stated"),
        ("ls", "ls_reference", "one", "settings: ls_reference: is 'one'; choose zero or nominal"),
        (
            "lmi",
            "regulariser",
            "x",
            "settings: regulariser: is 'x'; choose euclidean or pullback",
        ),
        ("ls", "mirror", 0.2, "settings: mirror: is not used by method 'ls'; choose hqp, or leave it out"),
        (
            "wls",
            "symmetry",
            0.1,
            "settings: symmetry: is not used by method 'wls'; choose one of qp, lmi, or leave it out",
        ),
    ],
)
def test_a_refusal_says_what_is_wrong_and_what_to_do(method, name, value, text):
    with pytest.raises(InputError) as caught:
        estimator_settings(method, **{name: value})
    assert str(caught.value) == text


@pytest.mark.parametrize(
    ("name", "low", "high"), [("segment_spread", 1e-6, 1e6), ("segment_mass_range", 0.0, 1e6)]
)
def test_shares_of_single_segments_have_limits(name, low, high):
    for value in (low, high):
        assert getattr(estimator_settings("hqp", **{name: {"hand": value}}), name) == {"hand": value}
    for value in (low - 1e-7, high * (1.0 + 1e-9), np.nan, "1"):
        with pytest.raises(InputError) as caught:
            estimator_settings("hqp", **{name: {"fine": 1.0, "hand": value}})
        assert caught.value.field == f"{name}.hand" and caught.value.source == "settings"
        assert caught.value.remedy == f"choose {low:g} to {high:g}"
    with pytest.raises(InputError) as caught:
        estimator_settings("hqp", **{name: {"x" * 100: -1.0}})
    assert caught.value.field == f"{name}." + "x" * 60, "a name that fills the line is cut"


def test_unknown_segments_are_named_with_those_that_have_a_mass(arm):
    robot = arm.robot
    links = [segment.link for segment in robot.segments]
    assert known_segments(robot, ()) == links and known_segments(robot, links[2:4]) == links
    with pytest.raises(UnknownNameError) as caught:
        known_segments(robot, [links[0], "nose"])
    heavy = [link for link, mass in zip(links, robot.nominal_parameters[::10], strict=True) if mass > 0.0]
    assert "unknown segment 'nose'" in str(caught.value)
    assert all(link in str(caught.value) for link in heavy[:1])


CONSISTENT = {"adaptive", "cls3", "lmi", "physical"}


def test_summaries_say_of_each_method_what_it_is():
    found = {item.name: item for item in method_summaries()}
    assert list(found) == list(ESTIMATORS)
    assert {name for name, item in found.items() if item.consistent} == CONSISTENT
    assert {name for name, item in found.items() if item.default} == {"adaptive"} == {DEFAULT_METHOD}
    assert {name for name, kind in ESTIMATORS.items() if kind.adapts} == {"adaptive"}
    assert found["map"].settings == ("alpha",)
    for name, item in found.items():
        kind = ESTIMATORS[name]
        assert (item.title, item.use, item.guarantees) == (kind.title, kind.use, kind.guarantees)
        assert not {"prior_spread", "segment_spread", "total_mass"} & set(item.settings)
        known = {declared.name for declared in fields(kind.settings_class)}
        assert len(item.settings) == len(known) - 3
        document = json.loads(json.dumps(item.to_json()))
        assert document["settings"] == list(item.settings)
        assert document["name"] == name and document["consistent"] is item.consistent


# --- Least squares in closed form


def test_least_squares_leaves_what_numpy_leaves(arm):
    """Residuals of ``ls`` in the rows' units, of ``wls`` divided by each channel's noise."""
    left = arm.y - arm.Y @ np.linalg.lstsq(arm.Y, arm.y, rcond=1e-9)[0]
    for reference in ("zero", "nominal"):
        found = LeastSquares().estimate(arm, LsSettings(ls_reference=reference))
        assert found.residual == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-8)
        assert (found.method, found.status, found.distance) == ("ls", SolveStatus.SOLVED, 0.0)
    stated = WeightedLeastSquares().estimate(arm, WlsSettings(weight_iterations=0))
    rows, y = arm.Y * arm.weights[:, None], arm.y * arm.weights
    left = y - rows @ np.linalg.lstsq(rows, y, rcond=1e-9)[0]
    assert stated.residual == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-8)
    iterated = WeightedLeastSquares().estimate(arm, WlsSettings())
    assert iterated.residual == pytest.approx(1.0, abs=0.1), "weights that follow the residuals make them one"
    assert (iterated.method, iterated.status) == ("wls", SolveStatus.SOLVED)


@pytest.mark.parametrize("reference", ["zero", "nominal"])
def test_the_solution_of_ls_is_the_shortest(reference, arm):
    scales = prior_std(arm, 0.5) if reference == "nominal" else np.ones(arm.n_params)
    centre = arm.prior if reference == "nominal" else np.zeros(arm.n_params)
    found = LeastSquares().estimate(arm, LsSettings(ls_reference=reference)).parameters
    moved = (found - centre) / scales
    # What the rows do not see is not moved.
    _, size, right = np.linalg.svd(arm.Y * scales, full_matrices=True)
    unseen = right[(size > 1e-9 * size[0]).sum() :]
    assert len(unseen) > 5 and np.abs(unseen @ moved).max() < 1e-6 * np.linalg.norm(moved)


@pytest.mark.parametrize("alpha", [1e-3, 1.0, 1e4])
def test_the_most_probable_parameters_are_those_of_the_normal_equations(alpha, arm):
    found = MaximumAPosteriori().estimate(arm, PullSettings(alpha=alpha, prior_spread=0.3))
    rows = found.regression
    weights = 1.0 / (rows.std * np.sqrt(rows.noise.inflation))[arm.channel]
    scales = prior_std(arm, 0.3)
    a = np.vstack([arm.Y * weights[:, None] * scales, np.sqrt(alpha) * np.eye(arm.n_params)])
    b = np.concatenate([arm.residual(arm.prior) * weights, np.zeros(arm.n_params)])
    expected = np.linalg.lstsq(a, b, rcond=None)[0]
    assert np.allclose((found.parameters - arm.prior) / scales, expected, atol=1e-8)
    assert (found.method, found.distance, found.active, found.violations) == ("map", 0.0, (), {})


# --- Quadratic programs


def test_qp_says_that_no_point_is_there_and_what_it_breaks(arm):
    boxes = equivalent_boxes(arm.robot)
    hidden = tuple(range(1, len(arm.robot.segments)))
    blind = replace(arm, Y=np.where(np.arange(arm.n_params) < 10, arm.Y, 0.0), unmeasured=hidden)
    with pytest.raises(NoSolutionError, match=r"^method qp found no solution \(infeasible\)") as caught:
        QuadraticProgram().estimate(blind, QpSettings(total_mass=0.5, com_boxes=boxes))
    best = caught.value.best
    assert best.status is SolveStatus.INFEASIBLE and caught.value.remedy == best.status.value
    assert best.violations["total_mass"] > 0.0 and best.distance == np.inf


def test_hqp_starts_where_all_vectors_hold_and_cuts_what_does_not(arm):
    settings = HqpSettings(sphere_epsilon=0.05, mirror=None)
    rows = iterate_weights(condense_problem(arm))
    scaled = scaled_parameters(rows, settings)
    first, _ = paper_levels(rows, settings, scaled)
    family = first.family
    assert isinstance(family, InertiaFloor)
    lifted = family.lifted(scaled.center)
    start = scaled.coordinates(lifted)
    assert np.linalg.eigvalsh(inertia_matrices(lifted))[:, 0].min() > 0.99 * 0.05
    others = np.arange(arm.n_params) % 10 < 4
    assert np.allclose(lifted[others], arm.prior[others]), "masses and first moments stay"
    cuts = family.violated(np.zeros(len(start)))
    assert len(cuts.bound) and np.allclose(np.linalg.norm(cuts.matrix, axis=1), 1.0)
    assert (cuts.matrix @ np.zeros(len(start)) < cuts.bound).all(), "nominal violates its cuts"
    assert (cuts.matrix @ start > cuts.bound - 1e-9).all(), "the start meets them"


def test_hqp_carries_what_it_was_told_and_recomputes_the_rest(arm):
    mass = float(arm.prior[::10].sum()) * 1.02
    settings = HqpSettings(sphere_epsilon=1e-4, total_mass=mass, mirror=None)
    found = HierarchicalProgram(ActiveSetProjector()).estimate(arm, settings)
    assert (found.total_mass, found.method, found.status) == (mass, "hqp", SolveStatus.SOLVED)
    assert found.parameters[::10].sum() == pytest.approx(mass, abs=1e-5)
    nominal = arm.prior[::10]
    assert (np.abs(found.parameters[::10] - nominal) <= 0.35 * nominal + 1e-6).all()
    assert found.distance < 1e-3 and max(found.violations.values()) < 1e-6


@pytest.mark.parametrize("epsilon", [1e-4, 0.05])
def test_hqp_without_a_solver_hands_over_a_point_that_meets_level_one(arm, epsilon):
    """With 0.05 kg·m² the nominal model itself does not: it is lifted until it does."""
    settings = HqpSettings(sphere_epsilon=epsilon, mirror=None)
    with pytest.raises(NoSolutionError, match=r"\(not optimal\)") as caught:
        HierarchicalProgram(lambda target, rows: None).estimate(arm, settings)
    best = caught.value.best
    assert best.status is SolveStatus.NOT_OPTIMAL, "a point that is known refutes that there is none"
    assert max(best.violations[kind] for kind in ("non_negative", "com_box")) < 1e-6
    assert np.linalg.eigvalsh(inertia_matrices(best.parameters))[:, 0].min() > 0.9 * epsilon
    weighted = arm.residual(best.parameters) / best.regression.std[arm.channel]
    assert best.residual == pytest.approx(np.sqrt(np.mean(weighted**2)))
    if epsilon < 0.01:
        nominal = arm.residual(arm.prior) / best.regression.std[arm.channel]
        assert best.residual <= np.sqrt(np.mean(nominal**2)) * 1.5


# --- Coordinates that do not count


# --- Distances between bodies, and bodies within bounds


def test_segments_that_are_not_seen_keep_their_nominal_bodies(arm):
    """The last segment hidden; the distance couples the parameters of each body."""
    n = arm.n_params
    blind = replace(arm, Y=np.where(np.arange(n) // 10 == 2, 0.0, arm.Y), unmeasured=(2,))
    found = PhysicallyConsistent().estimate(blind, LmiSettings(alpha=1.0, regulariser="pullback")).parameters
    assert np.array_equal(found[20:30], arm.prior[20:30])
    assert not np.allclose(found[:20], arm.prior[:20])


class TestPhysical:
    def test_contradictions_are_told_by_how_much(self, arm):
        """All masses together more than their bounds allow."""
        links = [segment.link for segment in arm.robot.segments]
        masses = {f"{link}.m": (1.0, 2.0) for link in links}
        settings = StatedBoundsSettings(bounds=KnownBounds(parameters=masses, total_mass=(100.0, 101.0)))
        with pytest.raises(NoSolutionError, match="leave nothing between them") as caught:
            PhysicalRetrieval().estimate(arm, settings)
        best = caught.value.best
        assert (best.method, best.status, best.distance) == ("physical", SolveStatus.INFEASIBLE, np.inf)
        assert best.residual == pytest.approx(np.sqrt(np.mean(arm.residual(best.parameters) ** 2)))
        broken = {kind: value for kind, value in best.violations.items() if value > 1e-9}
        assert broken and {"mass", "total_mass"} & set(broken)
        for kind, value in broken.items():
            unit = {"mass": "kg", "total_mass": "kg", "com": "m"}.get(kind, "kg·m²")
            assert f"{kind} by {value:.3g} {unit}" in str(caught.value)
        assert ": at best " in caught.value.what and caught.value.what.endswith(" outside")

    def test_bounds_of_another_robot_are_told_apart(self, arm):
        other = replace(
            default_bounds(arm.robot, StatedBoundsSettings()), links=tuple("abcdefg"), source="there.yaml"
        )
        with pytest.raises(InputError) as caught:
            PhysicalRetrieval(other).estimate(arm, StatedBoundsSettings())
        links = ", ".join(segment.link for segment in arm.robot.segments)
        assert (
            str(caught.value)
            == f"there.yaml: bounds links a, b, c, d, e, f, g; the links of panda are {links}"
        )
