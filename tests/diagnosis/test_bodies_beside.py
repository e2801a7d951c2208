"""A body that is named is the likeliest beside what else is named, whatever stood beside it in the search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.budget.bodies import fit_likeliest_bodies, make_body_term
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import fit_model
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.record import fit_initial_baseline, rows_of
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.selection.found import choose_bodies
from excite.logs.files import load_log, save_log
from excite.logs.robot import nominal_robot
from tests.diagnosis.two_joints import URDF, moved, two_joint_log

MODELLED = ("rigid_body_fixed", "viscous_friction", "coulomb_friction")
BALL = pin.Inertia(0.5, np.array([0.2, 0.0, 0.05]), 1e-4 * np.eye(3))


@pytest.fixture(scope="module")
def baseline(tmp_path_factory: pytest.TempPathFactory) -> Baseline:
    """Two joints that carry half a kilogram of which the model knows nothing."""
    rng, made = np.random.default_rng(4), []
    for name, role in (("a", "identification"), ("b", "validation")):
        trial = moved(name, role, 12.0, rng, np.eye(2))
        assert trial.tau is not None
        made.append(replace(trial, tau=trial.tau + carried(trial.time, trial.q)))
    folder = tmp_path_factory.mktemp("loaded")
    log = load_log(save_log(two_joint_log(tuple(made), modelled=list(MODELLED)), folder))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    return fit_initial_baseline(samples, MODELLED, spectral_floor(samples))


def carried(time: np.ndarray, q: np.ndarray) -> np.ndarray:
    bare, loaded = (pin.buildModelFromXML(URDF) for _ in range(2))
    loaded.inertias[2] = loaded.inertias[2] + BALL
    v = np.gradient(q, time, axis=0)
    a = np.gradient(v, time, axis=0)
    both = [[pin.rnea(m, m.createData(), *row) for row in zip(q, v, a, strict=True)] for m in (loaded, bare)]
    return np.array(both[0]) - np.array(both[1])


def at(rows_design: Design, beside: tuple[Term, ...], maker: TermMaker) -> Term:
    design = Design(rows_design.rows, beside)
    made = make_body_term(
        fit_model(design, range(len(beside)), left_out=False), maker, EFFECTS["payload"], "lower"
    )
    assert made is not None
    return made


def test_a_body_without_the_constant_that_it_stood_beside_is_another(baseline: Baseline) -> None:
    """Half a newton metre that is not there cancels a part of the ball's weight."""
    maker, empty = (
        TermMaker(Context(baseline), baseline.strict),
        Design(rows_of(baseline, MODELLED, np.full(2, 0.01)), ()),
    )
    constant = maker.make_term(EFFECTS["torque_bias"], "second", ())
    assert constant is not None
    held = replace(
        constant, known=True, scale=np.ones(1), columns={1: 0.5 * constant.columns[1] / constant.scale}
    )
    bent, alone = at(empty, (held,), maker), at(empty, (), maker)
    model = fit_model(Design(empty.rows, (held, bent)), (0, 1))
    (found,) = fit_likeliest_bodies(model, [1], maker)
    moment = {name: term.to_beta(np.ones(1)) for name, term in (("bent", bent), ("found", found))}
    centre = {name: beta[1:4] / beta[0] for name, beta in moment.items()}
    np.testing.assert_allclose(centre["found"], BALL.lever, atol=0.01)
    assert np.linalg.norm(centre["bent"] - BALL.lever) > 0.03
    np.testing.assert_allclose(found.direction, alone.direction, atol=1e-9)
    # Beside all others it is what it was.
    again, other = fit_likeliest_bodies(model, [1, 0], maker)
    np.testing.assert_allclose(
        again.direction / again.direction[0], bent.direction / bent.direction[0], atol=1e-3
    )
    assert other is held


def test_one_body_is_chosen_where_free_numbers_of_several_links_share_it(baseline: Baseline) -> None:
    """Of both links, ten numbers each, the one that carries something enters first, as heavy as it is."""
    maker = TermMaker(Context(baseline), baseline.strict)
    rows = rows_of(baseline, MODELLED, spectral_floor(baseline.samples))
    free = [maker.make_term(EFFECTS["payload"], link, ()) for link in ("upper", "lower")]
    chosen = choose_bodies([term for term in free if term is not None], baseline, rows)
    assert chosen[0].location == "lower"
    model = fit_model(Design(rows, tuple(chosen)), range(len(chosen)))
    assert chosen[0].to_beta(model.term_parameters(0))[0] == pytest.approx(BALL.mass, rel=0.1)
