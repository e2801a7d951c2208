"""What to measure next, of records made from the equations of motion that cannot tell what they hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.attribution import Scored, Scorer
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.dry_friction.friction_sign import SignChange
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.next_experiment.advice import FILE, Expectation
from excite.diagnosis.next_experiment.candidates import draw_motions
from excite.logs.log import Log, Trial
from excite.motion.files import load_motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import _SHAPES
from excite.safety.check import check_motion
from tests.benchmarks.next_experiment import outcome
from tests.diagnosis.hypotheses import fitted
from tests.diagnosis.poor_logs import RECIPES
from tests.made_log import made_log

RATE = 100.0
MODELLED = ("rigid_body", "viscous_friction", "coulomb_friction")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("iiwa14")


def record(robot: Robot, torque: Array | None = None, stiffness: float = 0.0, reach: float = 0.25) -> Log:
    """Slow, narrow trials: rigid bodies, friction, a constant torque, and a spring at the first joint."""
    rng = np.random.default_rng(5)
    time = np.arange(round(9.0 * RATE)) / RATE
    trials = []
    for name, role in (("a", "identification"), ("b", "identification"), ("c", "validation")):
        phase = 2.0 * np.pi * np.outer(time, [0.25, 0.4])
        size = reach * rng.uniform(0.3, 0.6, (robot.n_joints, 2))
        size[0] *= 0.3
        shift = rng.uniform(0.0, 6.28, (robot.n_joints, 2))
        inner = phase[:, None, :] + shift
        w = 2.0 * np.pi * np.array([0.25, 0.4])
        q = robot.rest + (size * np.sin(inner)).sum(axis=2)
        v, a = (size * w * np.cos(inner)).sum(axis=2), -(size * w**2 * np.sin(inner)).sum(axis=2)
        data = robot.model.createData()
        tau = np.array([pin.rnea(robot.model, data, *rows) for rows in zip(q, v, a, strict=True)])
        tau += 0.4 * v + 0.5 * np.tanh(v / 5e-3) + (0.0 if torque is None else torque)
        tau[:, 0] += stiffness * (q[:, 0] - 0.3)
        trials.append(Trial(name, role, time, q, tau=tau + 0.02 * rng.standard_normal(tau.shape)))
    return made_log(trials, robot.joint_names, RATE, modelled=MODELLED)


class Eccentric(Effect):
    """A mass off the axis of a joint that is not upright: over a narrow motion a spring says the same."""

    name = "eccentric"
    linear = (Parameter("cosine", "N·m"), Parameter("sine", "N·m"))
    confusable_with = ("joint_spring",)

    def locations(self, context: Context) -> tuple[str, ...]:
        return context.joints[:1]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        q = context.q[:, context.row(location)]
        return Shape({context.row(location): np.column_stack([np.cos(q), np.sin(q)])})


@pytest.fixture(autouse=True, scope="module")
def eccentric() -> Iterator[None]:
    """Every record here is of an arm whose first joint may have one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFECTS, Eccentric.name, Eccentric())
        yield


@dataclass(frozen=True, eq=False)
class Doubt:
    baseline: Baseline
    rivals: list[Scored]
    floor: Array


@pytest.fixture(scope="module")
def doubt(robot: Robot) -> Doubt:
    """A spring at the first joint and a mass off its axis, fitted to a record of the spring."""
    log = record(robot, stiffness=3.0)
    samples = arm_samples(robot, log, log.trials)
    floor = spectral_floor(samples)
    baseline = fit_baseline(samples, MODELLED, floor)
    scorer, first = Scorer(baseline, floor, 0.0, np.ones(7)), samples.joints[0]
    alike = [fitted(baseline, EFFECTS[name], first) for name in ("joint_spring", "eccentric")]
    rivals = [scorer.score_fit(baseline.fit, item) for item in alike]
    return Doubt(baseline, rivals, floor)


def test_a_wide_motion_is_expected_to_tell_what_the_record_cannot(doubt: Doubt):
    samples = doubt.baseline.samples
    expectation = Expectation(doubt.baseline, doubt.rivals, doubt.floor)
    inside = [
        expectation.with_motion(offer.sketch)
        for offer in draw_motions(samples, samples.joints[:1], 0, wide=False)
    ]
    outside = [
        expectation.with_motion(offer.sketch)
        for offer in draw_motions(samples, samples.joints[:1], 0, wide=True)
    ]
    assert np.median([r[0, 1] for r in outside]) > 5.0 * max(r[0, 1] for r in inside)
    assert max(r.min() for r in outside) > 4.0


def test_a_rival_is_not_told_from_itself(doubt: Doubt):
    twice = Expectation(doubt.baseline, [doubt.rivals[0], doubt.rivals[0]], doubt.floor)
    for offer in draw_motions(doubt.baseline.samples, doubt.baseline.samples.joints[:1], 0, wide=True)[:3]:
        assert twice.with_motion(offer.sketch)[0, 1] < 0.01


def test_joints_with_damped_bristles_among_others_change_little(doubt: Doubt):
    base, samples = doubt.baseline, doubt.baseline.samples
    bristles = SignChange(6e-3, 1e-4, np.inf)
    moved = base.with_signs((*base.signs[:-1], bristles))
    moved = moved.with_fit(moved.solver.fit_columns())
    sketch = draw_motions(samples, samples.joints[:1], 0, wide=True)[0].sketch
    few, more = (Expectation(b, doubt.rivals, doubt.floor) for b in (base, moved))
    few, more = (e.with_motion(sketch)[0, 1] for e in (few, more))
    assert more == pytest.approx(few, rel=0.2)


def test_more_noise_makes_less_evidence_expected(doubt: Doubt):
    motion = draw_motions(doubt.baseline.samples, doubt.baseline.samples.joints[:1], 0, wide=True)[0].sketch
    quiet, loud = (Expectation(doubt.baseline, doubt.rivals, f * doubt.floor) for f in (1.0, 30.0))
    quiet, loud = (e.with_motion(motion) for e in (quiet, loud))
    assert loud[0, 1] < 0.7 * quiet[0, 1]


def test_joints_of_a_model_without_shapes_stay_where_they_have_been(doubt: Doubt):
    samples = doubt.baseline.samples
    bare = replace(samples.robot, hash="no shapes")
    collision = samples.robot.description.collision.model_copy(update={"geometry": "authored", "shapes": ()})
    bare = replace(bare, description=samples.robot.description.model_copy(update={"collision": collision}))
    assert "no shapes" not in _SHAPES
    inside = draw_motions(replace(samples, robot=bare), samples.joints[:1], 0, wide=False)
    assert inside
    assert all(offer.candidate is None and not offer.caution for offer in inside)
    for offer in draw_motions(replace(samples, robot=bare), samples.joints[:1], 0, wide=True):
        shown = samples.stack_trials("q")
        assert (offer.sketch.q <= shown.max(axis=0) + 1e-6).all()
        assert (offer.sketch.q >= shown.min(axis=0) - 1e-6).all()
        assert "no shapes" in offer.caution


def test_the_motion_is_written_checked_and_its_reach_is_said(robot: Robot, tmp_path: Path):
    log = record(robot, stiffness=3.0)
    result = diagnose(log, robot, out=tmp_path)
    assert {c.effect for c in result.candidates[: result.n_tied]} == {"joint_spring", "eccentric"}
    advice = result.next_experiment
    assert advice is not None
    assert advice.motion == FILE
    first = robot.joint_names[0]
    assert set(advice.separates) == {f"joint_spring@{first}", f"eccentric@{first}"}
    motion = load_motion(tmp_path / FILE, robot)
    assert check_motion(robot, motion).safe
    shown = np.concatenate([t.q[:, 0] for t in log.trials])
    assert np.ptp(motion.q[:, 0]) > 2.0 * np.ptp(shown)
    assert "leaves the positions of this record" in advice.why


def _biased(robot: Robot, out: Path) -> Diagnosis:
    constant = np.zeros(robot.n_joints)
    constant[1] = 0.4
    return diagnose(record(robot, constant, reach=1.0), robot, out=out)


def test_what_no_motion_tells_apart_gets_no_motion_but_a_reading(robot: Robot, tmp_path: Path):
    result = _biased(robot, tmp_path)
    assert {c.effect for c in result.candidates[: result.n_tied]} == {"torque_bias", "coulomb_asymmetry"}
    advice = result.next_experiment
    assert advice is not None
    assert advice.motion is None
    assert "zero torque" in advice.why
    assert not (tmp_path / FILE).exists()


def test_shapes_that_touch_in_the_record_get_no_motion_but_what_to_do(robot: Robot, tmp_path: Path):
    """Solids of neighbours overlap in a model of which nobody has said so, and no motion can be judged safe."""
    open_pairs = robot.description.collision.model_copy(update={"ignored_pairs": ()})
    bare = replace(
        robot,
        hash="pairs not reviewed",
        description=robot.description.model_copy(update={"collision": open_pairs}),
    )
    advice = diagnose(record(robot, stiffness=3.0), bare, out=tmp_path).next_experiment
    assert advice is not None
    assert advice.motion is None
    assert "collision.ignored_pairs" in advice.why
    assert not (tmp_path / FILE).exists()


@pytest.mark.battery
def test_the_motion_proposed_settles_the_doubt_when_the_robot_runs_it(tmp_path: Path):
    done = outcome(RECIPES[0], np.random.default_rng(3), tmp_path)
    assert done.eligible, done.first
    assert done.safe
    assert done.separated, done.then
