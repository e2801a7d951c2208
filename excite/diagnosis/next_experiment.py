"""What to measure next: of a few safe motions the one on which rivals' predictions differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.diagnosis.attribution import Scored
from excite.diagnosis.baseline import Baseline, fit_baseline, own_names, own_signals
from excite.diagnosis.effects.effect import Context
from excite.diagnosis.equations import Solver
from excite.diagnosis.hypotheses import Hypothesis, at_rows
from excite.diagnosis.next_experiment_paths import GENERATOR, accelerations, retraced
from excite.diagnosis.refinement import torque_of
from excite.diagnosis.samples import ArmSamples, ArmTrial
from excite.errors import RobotError
from excite.logs.signals.butterworth import settling_samples
from excite.motion.files import save_motion
from excite.motion.generators.registry import plan_candidates
from excite.motion.motion import Motion
from excite.regressor.kernels import inverse_dynamics
from excite.robot.collision import collision_shapes
from excite.robot.robot import Array, Robot
from excite.safety.check import check_motion
from excite.safety.filter import filter_candidate

FILE = "next_experiment.parquet"
_CANDIDATES = 6
_LONGEST_S = 30.0
# Expected nats below which a motion is not worth running.
_WORTH = 30.0
_OLD_TRIALS = 2
_PATHS = 1


@dataclass(frozen=True, eq=False)
class Proposal:
    """A motion and what it is expected to tell.

    Attributes:
        motion: the motion.
        evidence: expected log-likelihood ratio between the two rivals that it tells apart least well [nats].
    """

    motion: Motion
    evidence: float


def propose(baseline: Baseline, rivals: Sequence[Scored], floor: Array, seed: int) -> Proposal | None:
    """The safe motion with the largest expected evidence between rivals.

    Candidates are the record's own paths at other speeds and, where the model has shapes, motions of the
    generators, aimed at the rivals' joints, within the positions, velocities and accelerations that the log has
    shown, and through the safety filter. The expected evidence of a motion is that
    of two fits of one rival's noiseless prediction, on the new motion and on a part of the record: with the rival
    itself, and with the other one.

    Args:
        baseline: the baseline before the first effect.
        rivals: hypotheses that the record cannot tell apart, two or more.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
        seed: of the generators.

    Returns:
        The proposal; None where no motion tells the rivals apart, or none is safe.
    """
    hypotheses = [r.hypothesis for r in rivals]
    found = [
        Proposal(motion, expected_evidence(baseline, hypotheses, motion, floor))
        for motion in _motions(baseline.samples, rivals, seed)
    ]
    worth = sorted((p for p in found if p.evidence > _WORTH), key=lambda p: -p.evidence)
    return next((p for p in worth if _safe(baseline.samples.robot, p.motion)), None)


def _safe(robot: Robot, motion: Motion) -> bool:
    """The independent verdict; a model without shapes cannot be judged, and keeps to the record's own path."""
    try:
        collision_shapes(robot)
    except RobotError:
        return motion.metadata.generator == GENERATOR
    return check_motion(robot, motion).safe


def _motions(samples: ArmSamples, rivals: Sequence[Scored], seed: int) -> list[Motion]:
    """Safe motions to choose from: generated ones, or the record's own paths where the model has no shapes."""
    robot = within_record(samples)
    targets = sorted({j for r in rivals for j in _joints(r, samples)}, key=samples.joints.index)
    again = retraced(samples, _PATHS)
    try:
        collision_shapes(robot)
    except RobotError:
        return again
    drawn = plan_candidates(robot, _CANDIDATES, np.random.SeedSequence(seed), targets=targets)
    outcomes = [filter_candidate(robot, candidate).motion for candidate in drawn]
    return [*again, *(m for m in outcomes if m is not None)]


def written(proposal: Proposal, out: Path) -> str:
    """Write the motion into a folder and return its file's name."""
    out.mkdir(parents=True, exist_ok=True)
    save_motion(proposal.motion.renamed(Path(FILE).stem), out / FILE)
    return FILE


def within_record(samples: ArmSamples) -> Robot:
    """The robot with limits no wider than what the record has shown, and a fifth more of speed."""
    robot, index = samples.robot, list(samples.index)
    fastest = np.abs(samples.stacked("v")[:, index]).max(axis=0)
    q = samples.stacked("q")[:, index]
    limits = robot.limits
    middle, half = 0.5 * (q.max(axis=0) + q.min(axis=0)), 0.6 * (q.max(axis=0) - q.min(axis=0))
    lower, upper = limits.position_lower.copy(), limits.position_upper.copy()
    lower[index] = np.maximum(lower[index], middle - half)
    upper[index] = np.minimum(upper[index], middle + half)
    velocity, acceleration = limits.velocity.copy(), limits.acceleration.copy()
    velocity[index] = np.minimum(velocity[index], 1.2 * fastest)
    acceleration[index] = np.minimum(acceleration[index], accelerations(samples, 1.2))
    rest = robot.rest.copy()
    rest[index] = middle
    narrow = replace(
        limits, position_lower=lower, position_upper=upper, velocity=velocity, acceleration=acceleration
    )
    return replace(robot, limits=narrow, rest=rest)


def expected_evidence(
    baseline: Baseline, rivals: Sequence[Hypothesis], motion: Motion, floor: Array
) -> float:
    """Least expected log-likelihood ratio between any two rivals on a motion [nats].

    Args:
        baseline: the baseline before the first effect.
        rivals: fitted hypotheses.
        motion: the motion.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
    """
    new = _with_motion(baseline, motion)
    context = Context(new)
    solver = new.solver
    columns = [at_rows(context, h.effect.shape(context, h.location, h.theta)) for h in rivals]
    fresh = new.samples.trial_of_row == len(new.samples.trials) - 1
    count = 2.0 * new.samples.bands.rows_hz / new.samples.bands.rate_hz * fresh.sum()
    least = np.inf
    for a, truth in enumerate(rivals):
        made = torque_of(replace(truth, baseline=new))
        rows = new.samples.rows(new.samples.split(made)).T * new.root_weight
        predicted = Solver(replace(solver.equations, y=rows))
        for b, other in enumerate(columns):
            if a != b:
                fit = predicted.fit(other.extra, other.offset)
                power = (fit.residual[:, fresh] ** 2).mean(axis=1)
                nats = 0.5 * count * float(np.log1p(power / floor**2).sum())
                least = min(least, nats)
    return float(least)


def _joints(item: Scored, samples: ArmSamples) -> list[str]:
    """Joints that a hypothesis is about: its own, else the one that it changes most."""
    return [item.location] if item.location in samples.joints else [samples.joints[item.place]]


def _with_motion(baseline: Baseline, motion: Motion) -> Baseline:
    """The baseline on the motion and on a part of the record, torques as it predicts them."""
    samples = baseline.samples
    old = [k for k, t in enumerate(samples.trials) if t.identification][:_OLD_TRIALS]
    totals = samples.split(baseline.total)
    trials = [replace(samples.trials[k], tau=totals[k], repeats=None) for k in old]
    fresh = _trial(samples, motion)
    joined = replace(samples, trials=(*trials, replace(fresh, tau=_predicted(baseline, fresh))))
    return fit_baseline(joined, baseline.modelled, np.maximum(baseline.solver.equations.floor, 1e-9))


def _predicted(baseline: Baseline, trial: ArmTrial) -> Array:
    """Torques of the fitted rigid bodies and friction on a trial ``(n, n_joints)`` [N·m]."""
    samples = replace(baseline.samples, trials=(trial,))
    names = own_names(baseline.modelled)
    index = list(samples.index)
    rigid = inverse_dynamics(samples.robot.model, trial.q, trial.v, trial.a, baseline.phi)[:, index]
    own = [own_signals(samples, names, j, baseline.widths[j]) @ o for j, o in enumerate(baseline.fit.own)]
    return rigid + np.column_stack(own)


def _trial(samples: ArmSamples, motion: Motion) -> ArmTrial:
    """A motion as a trial, at the record's rate."""
    longest = motion.time[0] + min(motion.duration, _LONGEST_S)
    short = motion.resampled(samples.robot, samples.rate_hz)
    n = int(np.searchsorted(short.time, longest, side="right"))
    edge = max(3, settling_samples(samples.rate_hz, samples.bands.rows_hz))
    step = max(1, round(samples.rate_hz / samples.bands.rate_hz))
    time = short.time[:n] - short.time[0]
    start = max(float(t.session_s[-1]) for t in samples.trials)
    return ArmTrial(
        name=motion.name,
        identification=True,
        repeats=None,
        time=time,
        session_s=start + time,
        q=short.q[:n],
        v=short.v[:n],
        a=short.a[:n],
        tau=np.zeros((n, len(samples.joints))),
        rows=np.arange(edge, n - edge, step),
    )
