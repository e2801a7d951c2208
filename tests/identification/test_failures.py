"""What goes wrong inside an estimator gives a status and the best point known, never a silent answer."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.linalg import LinAlgError
from typer.testing import CliRunner

from excite.cli.main import app
from excite.errors import NoSolutionError
from excite.identification.constraints.linear import equivalent_boxes
from excite.identification.estimators import (
    least_squares as ls,
)
from excite.identification.estimators import least_squares as map_module
from excite.identification.estimators import (
    least_squares as wls,
)
from excite.identification.estimators.conic import (
    Adaptive,
    DensityRealisable,
    PhysicallyConsistent,
    PhysicallyFeasible,
    QuadraticProgram,
    interior_point,
)
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.hqp import BoundedNearBase, HierarchicalProgram
from excite.identification.estimators.least_squares import (
    LeastSquares,
    MaximumAPosteriori,
    WeightedLeastSquares,
)
from excite.identification.estimators.projection import ProjectionAnswer
from excite.identification.estimators.registry import ESTIMATORS
from excite.identification.inertia import inertia_matrices, pseudo_inertia_matrices
from excite.identification.physical import feasible_set
from excite.identification.problem import IdentificationProblem
from excite.logs.files import save_log
from excite.robot.loading import load_robot
from tests.identification.estimated import estimated
from tests.identification.icosphere import icosphere_corners
from tests.identification.practice_log import arm_log
from tests.identification.synthetic import arm_problem, modified_g1_parameters, segment_index, wrench_problem


def no_point(*_):
    """A solver that finds nothing."""
    return None


def no_numbers(target, rows):
    """A projector whose answer is not a number."""
    return ProjectionAnswer(np.full_like(target, np.nan), np.zeros(len(rows.bound)))


def no_cone(problem):
    """A cone solver that claims, without proof, that there is no point."""
    return replace(interior_point(problem), infeasible=True)


def no_cone_numbers(problem):
    """A cone solver whose answer is not a number."""
    return replace(interior_point(problem), z=np.full_like(problem.target, np.nan))


def broken(*_, **__):
    """A factorisation that does not converge."""
    raise LinAlgError("SVD did not converge")


SETTINGS = dict(sphere_epsilon=1e-4, mirror=None)


@pytest.fixture(scope="module")
def standing(g1) -> IdentificationProblem:
    """A humanoid that is heavier than its model: nominal parameters miss the measured total mass."""
    feet = tuple(segment_index(g1, link) for link in ("left_ankle_roll_link", "right_ankle_roll_link"))
    return wrench_problem(g1, modified_g1_parameters(g1), seed=1, trials=1, duration=5.0, unmeasured=feet)


def linear_violation(problem: IdentificationProblem, parameters: np.ndarray) -> float:
    """Masses and boxes of the centres of mass: the largest violation, written out."""
    moving = np.setdiff1d(np.arange(len(parameters) // 10), problem.unmeasured)
    ten, boxes = parameters.reshape(-1, 10)[moving], equivalent_boxes(problem.robot)[moving]
    mass, first = ten[:, :1], ten[:, 1:4]
    return max(float(part.max()) for part in (-mass, boxes[:, 0] * mass - first, first - boxes[:, 1] * mass))


@pytest.mark.parametrize(
    "estimator",
    [
        pytest.param(QuadraticProgram(no_cone), id="qp, claims"),
        pytest.param(QuadraticProgram(no_cone_numbers), id="qp, nan"),
        pytest.param(HierarchicalProgram(no_point), id="hqp, none"),
        pytest.param(HierarchicalProgram(no_numbers), id="hqp, nan"),
        pytest.param(PhysicallyFeasible(no_cone), id="cls2, claims"),
        pytest.param(PhysicallyFeasible(no_cone_numbers), id="cls2, nan"),
        pytest.param(DensityRealisable(no_cone), id="cls3, claims"),
        pytest.param(DensityRealisable(no_cone_numbers), id="cls3, nan"),
        pytest.param(PhysicallyConsistent(no_cone), id="lmi, claims"),
        pytest.param(PhysicallyConsistent(no_cone_numbers), id="lmi, nan"),
    ],
)
def test_best_point_meets_the_constraints(estimator, standing):
    mass = float(modified_g1_parameters(standing.robot)[::10].sum())
    settings = dict(SETTINGS, total_mass=mass, bound_width=20.0)
    with pytest.raises(NoSolutionError) as caught:
        estimated(estimator, standing, **settings)
    best = caught.value.best
    assert caught.value.exit_code == 3
    assert best.status not in (SolveStatus.SOLVED, SolveStatus.INFEASIBLE), "there is a point"
    assert (best.parameters[::10] > 0.0).all()
    # cls2 knows no total mass, cls2 and cls3 no boxes.
    if estimator.name != "cls2":
        assert best.parameters[::10].sum() == pytest.approx(mass, abs=1e-6)
    if estimator.name not in ("cls2", "cls3"):
        assert linear_violation(standing, best.parameters) < 1e-7
    if estimator.consistent:
        assert np.linalg.eigvalsh(pseudo_inertia_matrices(best.parameters)).min() > -1e-9
    else:
        vectors = icosphere_corners(3)
        inertia = inertia_matrices(best.parameters)
        assert np.einsum("vi,sij,vj->sv", vectors, inertia, vectors).min() > 0.0
    # What fits no better than the nominal model is not the best that is known.
    nominal = np.linalg.norm(standing.residual(standing.prior) * standing.weights)
    assert np.linalg.norm(standing.residual(best.parameters) * standing.weights) < nominal


def test_best_point_of_cls1_keeps_its_bounds(standing):
    bounds = standing.prior + np.maximum(0.1 * np.abs(standing.prior), 1e-4) * np.array([[-1.0], [1.0]])
    for projector in (no_point, no_numbers):
        with pytest.raises(NoSolutionError) as caught:
            estimated(BoundedNearBase(projector), standing, **SETTINGS, parameter_bounds=bounds)
        parameters = caught.value.best.parameters
        assert (parameters >= bounds[0] - 1e-9).all() and (parameters <= bounds[1] + 1e-9).all()


@pytest.mark.parametrize("kind", [LeastSquares, WeightedLeastSquares, MaximumAPosteriori])
def test_closed_forms_without_numbers_are_no_answer(kind, monkeypatch):
    problem = arm_problem(load_robot("panda"), seed=0, duration=2.0)
    ridge = map_module.build_ridge
    for module in (ls, wls):
        monkeypatch.setattr(module, "least_squares", lambda factor, **_: np.full(factor.shape[1] - 1, np.nan))
    monkeypatch.setattr(
        map_module, "build_ridge", lambda *rows: replace(ridge(*rows), target=np.nan * ridge(*rows).target)
    )
    with pytest.raises(NoSolutionError, match="not finite") as caught:
        estimated(kind(), problem, **SETTINGS)
    assert np.isfinite(caught.value.best.parameters).all()
    assert caught.value.best.status is SolveStatus.NOT_FINITE


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small log of an arm."""
    log = replace(arm_log(load_robot("ur10"), 0, trials=2, duration=4.0), robot_text="<robot/>")
    return save_log(log, tmp_path_factory.mktemp("log") / "log")


SOLVERS = {
    "qp": (QuadraticProgram, no_cone),
    "hqp": (HierarchicalProgram, no_numbers),
    "cls1": (BoundedNearBase, no_point),
    "cls2": (PhysicallyFeasible, no_cone),
    "cls3": (DensityRealisable, no_cone_numbers),
    "lmi": (PhysicallyConsistent, broken),
    "adaptive": (Adaptive, broken),
}
STEPS = {
    "ls": (ls, "least_squares", broken),
    "wls": (wls, "least_squares", broken),
    "map": (map_module, "build_ridge", broken),
    "physical": (feasible_set, "solve_cone_program", no_point),
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in ("ls", "qp", "lmi") else [pytest.mark.slow])
        for name in ESTIMATORS
    ],
)
def test_the_command_ends_with_3_and_writes_the_best_that_is_known(name, folder, tmp_path, monkeypatch):
    if name in SOLVERS:
        kind, solver = SOLVERS[name]
        start = kind.__init__
        monkeypatch.setattr(kind, "__init__", lambda self: start(self, solver))
    else:
        monkeypatch.setattr(*STEPS[name])
    out = tmp_path / "out"
    asked = ["identify", "ur10", str(folder), "--method", name, "--cutoff", "5"]
    run = CliRunner().invoke(app, [*asked, "--json", "--out", str(out)])
    assert isinstance(run.exception, NoSolutionError), run.output
    assert run.exception.exit_code == 3
    assert "\n" not in str(run.exception)
    document = json.loads((out / "identification.json").read_text())
    assert document == json.loads(run.stdout)
    kinds = [finding["kind"] for finding in document["findings"]]
    assert "no_solution" in kinds
    assert not document["status"].startswith("solved")
    values = [
        value
        for link in document["standard_parameters"].values()
        for value in (link["mass"], *link["inertia"])
    ]
    assert all(isinstance(value, float) and np.isfinite(value) for value in values)
    assert not list(out.glob("*.urdf")), "a model was made of parameters that are no answer"
