"""Retrieval of physical parameters: exact constraints, a bound that holds, a search that reaches it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, NoSolutionError
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.physical import PhysicalRetrieval, feasible_set
from excite.identification.estimators.settings import StatedBoundsSettings
from excite.identification.inertia import physical_parameters, standard_parameters
from excite.identification.judgement import check_consistency
from excite.identification.physical import retrieval as relaxation_module
from excite.identification.physical.bounds import InertiaRules
from excite.identification.physical.feasible_set import base_objective, essential_objective
from excite.identification.physical.retrieval import Relaxation, RetrievalSettings
from tests.reproduction import iiwa
from tests.reproduction.iiwa_excitation import excitation

SETTINGS = StatedBoundsSettings()
QUICK = RetrievalSettings(starts=0, nodes=1)
PRINCIPAL = replace(
    iiwa.bounds(), rules=InertiaRules(**vars(iiwa.bounds().rules) | {"principal_triangle": True})
)


@pytest.fixture(scope="module")
def problem():
    """An iiwa that moves as Table 4 says, with as much noise as its authors were left with."""
    rng = np.random.default_rng(0)
    time = np.linspace(0.0, iiwa.PERIOD_S, 150, endpoint=False)
    curve = excitation()
    q, v, a = (curve.evaluate(time, order) for order in range(3))
    parameters = np.zeros(iiwa.N_COLUMNS)
    for row in iiwa.published_base():
        parameters[row.column] = row.base
    tau = iiwa.rows(q, v, a) @ parameters + 0.25 * rng.standard_normal((len(q), iiwa.N_JOINTS))
    return iiwa.problem(q, v, a, tau)


@pytest.fixture(scope="module")
def found(problem):
    return PhysicalRetrieval(iiwa.bounds()).estimate(problem, SETTINGS)


def random_allowed(allowed, rng):
    """A random point of the set: of the box, moved to the nearest that meets all rules."""
    span = allowed.bounds.upper - allowed.bounds.lower
    physical = allowed.bounds.lower + span * rng.uniform(size=span.shape)
    drives = allowed.drive_lower + (allowed.drive_upper - allowed.drive_lower) * rng.uniform(
        size=len(allowed.drive_names)
    )
    return allowed.nearest(allowed.coordinates(physical, drives))


def test_the_estimate_s_figures_are_recomputed_from_the_parameters(problem, found):
    """Residual, distance in deviations of the noise, and active bounds."""
    assert found.residual == pytest.approx(np.sqrt(np.mean(problem.residual(found.parameters) ** 2)))
    seen = np.linalg.lstsq(problem.Y, problem.y, rcond=1e-8)[0]
    floor = np.linalg.norm(problem.residual(seen))
    certificate = found.certificate
    gap = np.sqrt(max(certificate.objective**2 - certificate.lower_bound**2, 0.0))
    # The objective leaves out the parameters that the elimination cancels: its floor is a little higher, its rank less.
    noise = floor / np.sqrt(problem.n_rows - np.linalg.matrix_rank(problem.Y, rtol=1e-8))
    assert found.distance == pytest.approx(gap / noise, rel=0.1, abs=1e-9)
    physical, bounds = physical_parameters(found.parameters[: problem.n_inertial]), iiwa.bounds()
    allowed = feasible_set(problem, bounds, SETTINGS)
    span = bounds.upper - bounds.lower
    near = np.minimum(physical - bounds.lower, bounds.upper - physical) <= 1e-6 * span
    free = [k for k in range(len(bounds.links)) if k in allowed.free]
    named = {label.removeprefix("bounds:").split(".")[0] for label in found.active}
    assert named == {bounds.links[k] for k in free if near[k].any()}
    assert len(found.active) == near[free].sum() > 0
    assert set(found.violations.values()) == {0.0}


def test_coordinates_are_those_of_pinocchio():
    """Eq. (14) of Xu et al. 2020 against pinocchio's inertia about the centre of mass."""
    rng = np.random.default_rng(1)
    bodies = [pin.Inertia.Random() for _ in range(5)]
    standard = np.concatenate([body.toDynamicParameters() for body in bodies])
    physical = physical_parameters(standard)
    for row, body in zip(physical, bodies, strict=True):
        assert row[0] == pytest.approx(body.mass)
        np.testing.assert_allclose(row[1:4], body.lever, atol=1e-12)
        np.testing.assert_allclose(row[4:], body.inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]], atol=1e-12)
    np.testing.assert_allclose(standard_parameters(physical), standard, atol=1e-12)
    random = rng.uniform(0.1, 1.0, (4, 10))
    np.testing.assert_allclose(physical_parameters(standard_parameters(random)), random, atol=1e-12)


@pytest.mark.parametrize("link", ["link1", "link2", "link6"])
def test_rules_are_those_of_eq_18(link):
    """Rows against the minima and maxima as eq. (18) writes them."""
    rules, rng = iiwa.bounds().rules, np.random.default_rng(2)
    verdicts = []
    for spread in np.repeat([0.02, 0.3, 3.0], 60):
        xx, yy, zz = np.exp(spread * rng.standard_normal(3))
        if link == "link1":
            zz *= 0.25
        if link == "link2":
            yy *= 0.25
        least = min(xx, yy, zz)
        xy, xz, yz = 0.12 * least * rng.uniform(-1.0, 1.0, 3)
        expected = xx <= yy + zz and yy <= xx + zz and zz <= xx + yy
        expected &= max(xx, yy, zz) <= 100.0 * least and max(abs(xy), abs(xz), abs(yz)) <= 0.1 * least
        if link == "link1":
            expected &= 3.0 * zz <= min(xx, yy)
        if link == "link2":
            expected &= 3.0 * yy <= min(xx, zz)
        assert ((rules.rows(link) @ [xx, xy, yy, xz, yz, zz]).min() >= 0.0) == expected
        verdicts.append(expected)
    assert 0 < sum(verdicts) < len(verdicts)


def test_published_solution_meets_the_published_constraints():
    """Eq. (16) to (18) at Tables 6 and 7's μ̂, to the last printed digit."""
    assert max(iiwa.judge(iiwa.published_parameters("xu2020")).values()) < 1e-12


def test_broken_constraints_are_named():
    good = iiwa.published_parameters("xu2020")
    other = iiwa.judge(iiwa.published_parameters("ref37"))
    assert other["mass"] == pytest.approx(1.0 - 0.3543) and other["com"] > 0.0
    drives = good.copy()
    drives[70] = 2.0
    assert iiwa.judge(drives)["drive"] == pytest.approx(1.0)
    assert iiwa.judge(good)["total_mass"] == 0.0
    heavy = physical_parameters(good[:70])
    heavy[:, 0] = 6.0
    assert iiwa.judge(np.concatenate([standard_parameters(heavy), good[70:]]))["total_mass"] > 15.0


class TestRetrieval:
    def test_constraints_hold_exactly(self, found):
        """Eq. (16) to (18), recomputed from the standard parameters, without any tolerance."""
        assert set(iiwa.judge(found.parameters).values()) == {0.0}
        assert set(found.violations.values()) == {0.0}
        assert found.status is SolveStatus.SOLVED

    def test_objective_is_eq_15(self, problem):
        truth = iiwa.published_parameters("xu2020")
        base = PhysicalRetrieval(iiwa.bounds(), QUICK, essential=False).estimate(problem, SETTINGS)
        assert base.certificate.objective == pytest.approx(
            np.linalg.norm(problem.residual(base.parameters)), rel=1e-9
        )
        assert base.certificate.objective < np.linalg.norm(problem.residual(truth))

    def test_nothing_allowed_is_below_the_bound(self, problem, found):
        """The certificate against random members of the set and the published solution."""
        allowed = feasible_set(problem, iiwa.bounds(), SETTINGS)
        objective = self._objective(problem)
        rng = np.random.default_rng(3)
        values = [objective.value(allowed.standard(random_allowed(allowed, rng))) for _ in range(30)]
        values.append(objective.value(iiwa.published_parameters("xu2020")))
        assert found.certificate.lower_bound <= found.certificate.objective < min(values)
        assert found.certificate.gap <= RetrievalSettings().gap

    def test_every_start_ends_at_the_same_objective(self, found):
        optima = np.array(found.certificate.optima)
        assert len(optima) >= 2
        np.testing.assert_allclose(optima, found.certificate.objective, rtol=1e-3)

    def test_multipliers_that_lie_give_a_bound_that_holds(self, problem, found, monkeypatch):
        """The bound is recomputed for whatever multipliers: bad ones make it loose, never wrong."""
        allowed = feasible_set(problem, iiwa.bounds(), SETTINGS)
        honest = relaxation_module.solve_cone_program
        task = Relaxation(self._objective(problem), allowed, np.zeros(allowed.size), allowed.interior)
        box = allowed.bounds.lower[:, 1:4], allowed.bounds.upper[:, 1:4]
        tight = task.solve(*box).bound
        rng = np.random.default_rng(4)

        def lying(program):
            answer = honest(program)
            return replace(answer, linear=answer.linear * rng.uniform(0.0, 2.0, len(answer.linear)))

        monkeypatch.setattr(relaxation_module, "solve_cone_program", lying)
        loose = task.solve(*box).bound
        assert task.objective.floor <= loose < tight <= found.certificate.objective

    @staticmethod
    def _objective(problem):
        triangle = np.linalg.qr(np.column_stack([problem.Y @ np.eye(84), problem.y]), mode="r")
        columns = [row.column for row in iiwa.published_base()]
        triangle = np.linalg.qr(triangle[:, [*columns, 84]], mode="r")
        return essential_objective(triangle, iiwa.grouping(), problem.n_rows)

    def test_same_seed_same_bytes(self, problem):
        effort = RetrievalSettings(starts=1, nodes=3)
        first, second = (
            PhysicalRetrieval(iiwa.bounds(), effort).estimate(problem, SETTINGS) for _ in range(2)
        )
        assert first.parameters.tobytes() == second.parameters.tobytes()

    def test_bodies_can_exist_where_the_rules_ask_for_it(self, problem):
        parameters = PhysicalRetrieval(PRINCIPAL, QUICK).estimate(problem, SETTINGS).parameters
        verdict = check_consistency(parameters[:70], PRINCIPAL.links)
        assert verdict.triangle_inequality and verdict.pseudo_inertia_min_eigenvalue > 0.0

    def test_weighed_mass_is_met(self, problem):
        settings = StatedBoundsSettings(total_mass=22.5)
        parameters = PhysicalRetrieval(iiwa.bounds(), QUICK).estimate(problem, settings).parameters
        assert parameters[:70:10].sum() == pytest.approx(22.5, rel=2e-6)


def test_elimination_is_that_of_section_2a(problem):
    """Rounds of plain least squares on the columns themselves, with eq. (6) and (7) as written."""
    columns = [row.column for row in iiwa.published_base()]
    y, tau = problem.Y[:, columns], problem.y
    kept = list(range(57))
    while True:
        e = y[:, kept]
        inverse = np.linalg.inv(e.T @ e)
        values = inverse @ e.T @ tau
        rest = tau - e @ values
        rsd = 100.0 * np.sqrt(rest @ rest / (len(tau) - len(kept)) * np.diag(inverse)) / np.abs(values)
        bad = (np.abs(values) < 0.01) & (rsd > 40.0)
        if not bad.any():
            break
        kept.pop(int(np.argmax(np.where(bad, rsd, -1.0))))
    triangle = np.linalg.qr(np.column_stack([y, tau]), mode="r")
    found = essential_objective(triangle, np.eye(57), len(tau))
    assert found.kept.tolist() == kept and len(kept) < 57
    assert found.floor == pytest.approx(np.linalg.norm(rest), rel=1e-9)
    assert base_objective(triangle, np.eye(57)).floor <= found.floor


class TestFaults:
    def test_bounds_of_another_robot(self, problem):
        other = replace(iiwa.bounds(), links=tuple(f"arm{k}" for k in range(7)))
        with pytest.raises(InputError, match="links of iiwa14"):
            PhysicalRetrieval(other).estimate(problem, SETTINGS)

    def test_contradiction(self, problem):
        rules = InertiaRules(**vars(iiwa.bounds().rules) | {"slender": {"link1": "x"}, "slenderness": 200.0})
        with pytest.raises(NoSolutionError, match="nothing between"):
            PhysicalRetrieval(replace(iiwa.bounds(), rules=rules)).estimate(problem, SETTINGS)

    @pytest.mark.parametrize(
        ("old", "new", "field"),
        [
            ("schema: excite.physical_bounds/1", "schema: other/1", "schema"),
            ("  link3.m: {bounds: [1, 6]", "  link9.m: {bounds: [1, 6]", "link9.m"),
            ("  link3.m: {bounds: [1, 6]", "  link3.m: {bounds: [6, 1]", "link3.m"),
            ("  link3.m: {bounds: [1, 6]", "  link3.m: {bounds: [0, 6]", "link3.m"),
            ("  link3.m: {bounds: [1, 6]", "  link3.m: {bounds: heavy", "link3.m"),
            ("total_mass: [16.0, 26.0]", "total_mass: [26.0, 16.0]", "total_mass"),
            ("diagonal_ratio: 100.0", "diagonal_rato: 100.0", "rules.diagonal_rato"),
            ("{link1: z,", "{link1: w,", "rules.slender.link1"),
            ("parameters:", "values:", "values: extra inputs"),
        ],
    )
    def test_bad_file_is_refused_by_field(self, tmp_path, old, new, field):
        text = iiwa.BOUNDS.read_text(encoding="utf-8")
        assert old in text
        path = tmp_path / "bounds.yaml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(InputError, match=field):
            iiwa.bounds(path)

    def test_missing_file(self, tmp_path):
        with pytest.raises(InputError, match="no such file"):
            iiwa.bounds(tmp_path / "none.yaml")

    @pytest.mark.parametrize(("name", "value"), [("starts", -1), ("gap", float("nan")), ("nodes", 0)])
    def test_bad_effort(self, name, value):
        with pytest.raises(InputError, match=name):
            RetrievalSettings(**{name: value})


def test_rules_without_numbers_are_the_triangle_inequality_alone():
    rows = InertiaRules(diagonal_ratio=None, off_diagonal_share=None).rows("any")
    assert rows.shape == (3, 6)
