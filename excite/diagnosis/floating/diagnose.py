"""The diagnosis of a floating-base log: contact wrenches against what the motion needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.answer import Diagnosis, NextExperiment, Verdict
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.answer.gap import Gap
from excite.diagnosis.floating.answer import gap_of, locate_gap, trial_curves
from excite.diagnosis.floating.effect import link_names, segment_of
from excite.diagnosis.floating.hypotheses import Fitted, Placed, explained_state, nominal_fit, refine_fit
from excite.diagnosis.floating.problem import NOISE_SLACK, Problem, build_problem, noise_floor
from excite.diagnosis.floating.record import prepare_record
from excite.diagnosis.floating.registry import NAMELESS
from excite.diagnosis.floating.search import (
    DECISIVE,
    FORM_DOUBT,
    Ranked,
    Step,
    explained_share,
    find_tied_rivals,
    is_unexplained,
    search_effects,
    tied_places,
)
from excite.diagnosis.floating.simulator import NO_ROLLOUTS, simulate_effects
from excite.diagnosis.floating.spectrum import BAND_HZ, NOT_NOISE, in_band, repeat_levels
from excite.diagnosis.floating.state import State, cross_rows
from excite.logs.columns import WRENCH_AXES
from excite.logs.log import Log
from excite.robot.robot import Robot

# From hypotheses to a verdict.

# Power left, over the noise's, from which one wrong reading that would leave none is the likelier.
_WRONG_FORM = 4.0


@dataclass(frozen=True, eq=False)
class Attribution:
    """The verdict and what it rests on.

    Attributes:
        verdict: ``none``, ``effect``, ``ambiguous`` or ``unknown``.
        baseline: the baseline's fit.
        steps: for each accepted effect, all its rivals given the others, best first.
        rivals: names that the data cannot tell from the first accepted effect, itself first.
        tied: places that the data cannot tell from each accepted effect's, itself first.
        overdispersion: power that the accepted effects leave over that expected.
        explained: share of the power above the noise that they explain.
    """

    verdict: Verdict
    baseline: Fitted
    steps: tuple[Step, ...]
    rivals: tuple[Ranked, ...]
    tied: tuple[tuple[str, ...], ...]
    overdispersion: float
    explained: float

    @property
    def accepted_fit(self) -> Fitted:
        """The fit with all accepted effects."""
        return self.steps[-1][0].fitted if self.steps else self.baseline


def attribute_gap(problem: Problem) -> Attribution:
    """Find effects until the noise is reached or nothing explains what is left, and judge what they leave."""
    baseline = nominal_fit(problem)
    n = len(problem.nominal_rows)
    steps = search_effects(problem, baseline)
    current = steps[-1][0].fitted if steps else baseline
    over = max(1.0, current.power / n)
    explained = explained_share(problem, current)
    tied = tuple(tied_places(step, n) for step in steps)
    close = find_tied_rivals(steps[0], n) if steps else ()
    verdict = _decide_verdict(problem, baseline, steps, close)
    if verdict in {"effect", "ambiguous"} and _has_nameless_rival(problem, current):
        verdict = "unknown"
    wrong = problem.record.robot.sensors and steps and current.power > _WRONG_FORM * n
    patched = current.power > NOISE_SLACK * n and _has_tied_namesakes(steps, tied)
    if patched or (wrong and misread_channels(problem, baseline)):
        verdict = "unknown"
    return Attribution(verdict, baseline, steps, close, tied, over, explained)


def _fit_partial(problem: Problem, full: Fitted) -> tuple[Fitted, ...]:
    """Fits of the first effects of a fit, one more each; the last is the fit itself."""
    counts = range(1, len(full.placed))
    first = tuple(refine_fit(problem, full.placed[:k], full.theta[:k], full) for k in counts)
    return (*first, full) if full.placed else ()


def _decide_verdict(
    problem: Problem, baseline: Fitted, steps: tuple[Step, ...], close: tuple[Ranked, ...]
) -> Verdict:
    loud = baseline.power > NOISE_SLACK * len(problem.nominal_rows)
    if not steps:
        return "unknown" if loud or not problem.repeatability.repeatable else "none"
    accepted = steps[-1][0].fitted
    if is_unexplained(problem, accepted) or not _is_repeatable(problem, accepted):
        return "unknown"
    return "ambiguous" if len(close) > 1 else "effect"


def _has_tied_namesakes(steps: tuple[Step, ...], tied: tuple[tuple[str, ...], ...]) -> bool:
    """Whether two effects of one name are at places that the data cannot tell apart: one thing of another form."""
    names = [step[0].last_placed.effect.name for step in steps]
    return any(
        names[i] == names[k] and bool(set(tied[i]) & set(tied[k]))
        for k in range(len(steps))
        for i in range(k)
    )


def _has_nameless_rival(problem: Problem, fitted: Fitted) -> bool:
    """Whether an effect may as well be something that no word is for."""
    over = max(1.0, fitted.power / len(problem.nominal_rows))
    for k, item in enumerate(fitted.placed):
        if item.effect.form_name in NAMELESS:
            other = Placed(NAMELESS[item.effect.form_name], item.location)
            placed = (*fitted.placed[:k], other, *fitted.placed[k + 1 :])
            if refine_fit(problem, placed, fitted.theta, fitted).power < fitted.power + 2.0 * DECISIVE * over:
                return True
    return False


def _is_repeatable(problem: Problem, fitted: Fitted) -> bool:
    """Whether repeated trials differ by no more than noise once a fit's effects are taken out."""
    white = problem.whitening(explained_state(problem, fitted).residual)
    levels = repeat_levels(problem.whitening, white)
    return levels is None or float(levels[: len(levels) // 2].mean()) < NOT_NOISE


# Where a gap is that no effect explains: a link that a free force acts on, or a sensor's channel that reads
# wrong.

# How far from its joint a link is expected to be touched, where all moment about the joint were noise.
_REACH_M = 0.02
# Links that leave this share more than the best are told from it by nothing but the noise model's faults; at the
# joint itself, where the force hardly is, by its form's as well.
_LEAST_MARGIN = 0.02
# Power over the noise's up to which a channel's free reading leaves nothing.
_NOISE = 1.5
# Whitened size of what a unit of an inertial parameter makes, below which the record does not show it.
_SHOWN = 0.3


@dataclass(frozen=True, eq=False)
class _Open:
    """What a fit leaves, as many samples of it as the band has numbers.

    Attributes:
        state: the motion of these samples, and all readings.
        few: which of the record's samples they are.
        white: ``(k, 6)`` whitened residual in band.
        columns: ``(k, 6, r)`` what inertial parameters add to it, turned to those that the record shows, each with a
            unit prior; identified anew beside each hypothesis, since without it they have imitated it.
        colour: ``(6, 6)`` Cholesky factor of the noise.
    """

    state: State
    few: slice
    white: Array
    columns: Array
    colour: Array

    def fit_wrenches(self, arms: Array) -> tuple[Array, Array]:
        """What wrenches of any size along ``arms (k, 6, m)`` leave, ``(k, 6 − m)``, and the parameters ``(r,)``."""
        # Directions that no such wrench has.
        others = np.linalg.qr(np.linalg.solve(self.colour, arms), mode="complete")[0][:, :, arms.shape[2] :]
        others = others.transpose(0, 2, 1)
        target = (others @ self.white[:, :, None])[:, :, 0]
        design = (others @ self.columns).reshape(target.size, -1)
        gram = design.T @ design + np.eye(design.shape[1])
        delta = np.asarray(np.linalg.solve(gram, design.T @ target.ravel()), dtype=float)
        return target - (design @ delta).reshape(target.shape), delta

    def beside_force(self, link: str, lever: Array) -> tuple[Array, Array]:
        """What a free force at a point of a link leaves, ``(k, 3)``, and the parameters beside it."""
        point = self.state.poses.point(segment_of(self.state, link) + 1, lever)
        return self.fit_wrenches(self.state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point))


def unknown_places(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Places of what a fit leaves, best first: sensors' channels where one leaves no more than noise, links where not.

    A channel that reads wrong makes one number an instant, free at each, of the six of the wrench; a force on a link
    makes three. The moment must be that of the force about a point of the link, which is near its joint, or the
    joint itself: links are listed that either leaves untold from the best.
    """
    left = _open_residual(problem, fitted)
    channels = _find_misread_sensors(problem, fitted, left)
    if channels:
        return channels
    at_joint, near = {}, {}
    for link in link_names(left.state):
        at_joint[link], delta = left.beside_force(link, np.zeros(3))
        lever = _estimate_force_point(left.state, link, (left.white - left.columns @ delta) @ left.colour.T)
        near[link], _ = left.beside_force(link, lever)
    return tuple(dict.fromkeys(_tied_places(near, _LEAST_MARGIN) + _tied_places(at_joint, FORM_DOUBT)))


def misread_channels(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Channels of sensors one of which, were its reading free at each instant, would leave no more than noise.

    The likeliest first; none where each leaves more.
    """
    return _find_misread_sensors(problem, fitted, _open_residual(problem, fitted))


def _find_misread_sensors(problem: Problem, fitted: Fitted, left: _Open) -> tuple[str, ...]:
    state = explained_state(problem, fitted)
    rest = {
        f"{name}.{axis}": left.fit_wrenches(arms[left.few][:, :, [k]])[0]
        for name, arms in state.reading_levers.items()
        for k, axis in enumerate(WRENCH_AXES)
    }
    found = _tied_places(rest, _LEAST_MARGIN)
    return found if _beside_reading(problem, fitted, found[0]) < _NOISE else ()


def _open_residual(problem: Problem, fitted: Fitted) -> _Open:
    record, state = problem.record, explained_state(problem, fitted)
    few = slice(None, None, max(1, int(record.rate_hz / (2.0 * BAND_HZ))))
    colour = np.asarray(np.linalg.cholesky(problem.nominal.white_noise), dtype=float)
    factor = np.linalg.inv(colour)
    white = in_band(record, state.residual)[few] @ factor.T
    thin = state.replace(q=state.q[few])
    if not record.inertials_free:
        return _Open(thin, few, white, np.zeros((*white.shape, 0)), colour)
    columns = problem.error_columns
    columns = in_band(record, columns.reshape(len(columns), -1)).reshape(columns.shape)[few]
    columns = factor @ columns
    white = white + columns @ (fitted.delta[problem.index] / problem.scales)
    u, s, _ = np.linalg.svd(columns.reshape(-1, columns.shape[2]), full_matrices=False)
    shown = s > _SHOWN
    return _Open(thin, few, white, (u[:, shown] * s[shown]).reshape(*white.shape, -1), colour)


def _beside_reading(problem: Problem, fitted: Fitted, channel: str) -> float:
    """Power that a free reading of a channel leaves over the noise's, mean over the wrench's components.

    It is taken out before the band's filter: a reading that is cut off changes as fast as its lever arm.
    """
    record, state = problem.record, explained_state(problem, fitted)
    name, _, axis = channel.partition(".")
    scale = noise_floor(problem)
    arm = state.reading_levers[name][:, :, WRENCH_AXES.index(axis)] / scale
    arm /= np.linalg.norm(arm, axis=1, keepdims=True)

    def project_across(values: Array) -> Array:
        white = values / scale[:, None]
        white = white - arm[:, :, None] * np.einsum("ni,nij->nj", arm, white)[:, None, :]
        return in_band(record, white.reshape(len(white), -1)).reshape(white.shape)

    left = project_across(state.residual[:, :, None])[:, :, 0].ravel()
    if record.inertials_free:
        design = project_across(problem.error_columns)
        left = left + (design @ (fitted.delta[problem.index] / problem.scales)).ravel()
        rows = design.reshape(len(left), -1)
        gram = rows.T @ rows + np.eye(rows.shape[1])
        left = left - rows @ np.linalg.solve(gram, rows.T @ left)
    # Five numbers of six are left.
    return float((left**2).sum()) / (5.0 * record.n_samples)


def _tied_places(rest: dict[str, Array], margin: float) -> tuple[str, ...]:
    """Places that leave hardly more than the best place, by a share ``margin`` at least, best first."""
    left = {place: float((values**2).sum()) for place, values in rest.items()}
    order = sorted(left, key=lambda name: left[name])
    best = order[0]
    # As many numbers as make the kurtosis Gaussian.
    effective = 3.0 * left[best] ** 2 / float((rest[best] ** 4).sum())
    limit = left[best] * (1.0 + max(margin, 2.0 * DECISIVE / effective))
    return tuple(place for place in order if left[place] <= limit)


def _estimate_force_point(state: State, link: str, residual: Array) -> Array:
    """``(3,)`` point of a link, in its joint's frame, about which residual wrenches ``(n, 6)`` turn least [m].

    What is left beside a force r × f is taken for noise, and a point is looked for near the joint.
    """
    joint = segment_of(state, link) + 1
    base, own = state.poses.rotation[:, 1], state.poses.rotation[:, joint]
    to_link = np.einsum("nji,njk->nik", own, base)
    origin = np.einsum("nji,nj->ni", base, state.poses.translation[:, joint] - state.poses.translation[:, 1])
    moment = residual[:, 3:] - cross_rows(origin, residual[:, :3])
    force, moment = (np.einsum("nij,nj->ni", to_link, x) for x in (residual[:, :3], moment))
    # Σ |m − r × f|² has the normal equations Σ (f·f − f fᵀ) r = Σ f × m.
    gram = (force**2).sum() * np.eye(3) - force.T @ force
    right = cross_rows(force, moment).sum(axis=0)
    noise = float((moment**2).sum()) / (3.0 * len(moment))
    return np.linalg.solve(gram + noise / _REACH_M**2 * np.eye(3), right)


_N_CANDIDATES = 8


@dataclass(frozen=True, eq=False)
class Analysis:
    """A record with its verdict and what is fitted to the identification trials alone.

    Attributes:
        problem: all trials, in which the gap is measured.
        learnt: the identification trials, which alone the verdict, names and sizes come from.
        found: the verdict.
    """

    problem: Problem
    learnt: Problem
    found: Attribution

    @property
    def named_fit(self) -> Fitted:
        """That of the effects that are named; the baseline's where there are none."""
        named = self.found.verdict in {"effect", "ambiguous"}
        return self.found.accepted_fit if named else self.found.baseline


def analyse_log(log: Log, robot: Robot | None = None) -> Analysis:
    """Prepare a log and find what explains it, without the validation trials.

    Args and errors as of :func:`diagnose_floating`.
    """
    record = prepare_record(log, robot)
    # Samples are more than the band of the likelihood needs.
    learnt = build_problem(record.learning_trials().halve_rate())
    return Analysis(build_problem(record), learnt, attribute_gap(learnt))


def diagnose_floating(
    log: Log,
    robot: Robot | None = None,
    rng: np.random.Generator | None = None,
    out: Path | None = None,
) -> Diagnosis:
    """Diagnose a log with base pose, joints and contact wrenches.

    Args:
        robot: its nominal robot with the log's sensors; None reads the one that the log names.
        rng: of the bootstrap and of the roll-outs' replicas; None is seeded with zero.
        out: folder for the augmented simulator; none is written without it.

    Raises:
        LogError: the log lacks base pose or wrenches, or a trial is too short.
    """
    return diagnosis_of(analyse_log(log, robot), rng, out)


def diagnosis_of(
    analysis: Analysis, rng: np.random.Generator | None = None, out: Path | None = None
) -> Diagnosis:
    """What an analysis says, with the gap's interval from a bootstrap, and roll-outs; arguments as above."""
    problem, learnt, found = analysis.problem, analysis.learnt, analysis.found
    rng = rng or np.random.default_rng(0)
    accepted = analysis.named_fit
    gap = gap_of(problem, found.baseline, accepted, rng)
    first = found.steps[0] if found.steps and accepted.placed else ()
    tied = found.tied[0] if first else ()
    if found.verdict == "unknown" and problem.record.robot.sensors:
        tied = unknown_places(learnt, found.baseline)
    return Diagnosis(
        robot=problem.record.robot.name,
        verdict=found.verdict,
        effect=_effect_name(first[0]) if first else None,
        location=first[0].last_placed.location if first else (tied[0] if tied else None),
        tied_locations=tied,
        candidates=_make_candidates(learnt, found, gap),
        effects=_accepted_effects(learnt, found, gap) if accepted.placed else (),
        gap=gap,
        where=locate_gap(learnt, found.baseline),
        simulation=simulate_effects(problem, found.baseline, accepted, rng, out)
        if problem.record.robot.sensors
        else NO_ROLLOUTS,
        n_tied=len(found.rivals) if found.verdict == "ambiguous" else 0,
        next_experiment=_next_experiment(found),
        warnings=_collect_warnings(problem, found),
        curves=trial_curves(problem, found.baseline, accepted),
    )


def _effect_name(item: Ranked) -> str:
    return item.last_placed.effect.effect_name(item.fitted.theta[-1])


def _make_candidates(problem: Problem, found: Attribution, gap: Gap) -> tuple[Candidate, ...]:
    """The leading hypotheses for the first effect, those that cannot be told apart first."""
    if not found.steps:
        return ()
    step = found.steps[0]
    chosen = _one_each(found.rivals, step)
    weights = _hypothesis_probabilities(chosen)
    return tuple(
        _make_candidate(problem, found, item, step, gap, float(weight))
        for item, weight in list(zip(chosen, weights, strict=True))[:_N_CANDIDATES]
    )


def _one_each(first: Sequence[Ranked], step: Sequence[Ranked]) -> list[Ranked]:
    """The hypotheses ``first``, then those of a step whose effects are not among them, each at its likeliest place."""
    chosen, seen = list(first), {item.last_placed.effect.name for item in first}
    for item in step:
        if item.last_placed.effect.name not in seen:
            seen.add(item.last_placed.effect.name)
            chosen.append(item)
    return chosen


def _hypothesis_probabilities(chosen: Sequence[Ranked]) -> Array:
    """Of hypotheses of which one is true, ``(n,)``."""
    evidence = np.array([item.evidence for item in chosen])
    weights = np.exp(np.maximum(evidence - evidence.max(), -700.0))
    return np.asarray(weights / weights.sum())


def _make_candidate(
    problem: Problem, found: Attribution, item: Ranked, step: tuple[Ranked, ...], gap: Gap, weight: float
) -> Candidate:
    own = [other for other in step if other.last_placed.effect.name == item.last_placed.effect.name]
    close = tuple(other.last_placed.location for other in own if other.evidence > item.evidence - DECISIVE)
    tied = found.tied[0] if found.tied and item is step[0] else close
    closed = _closed_share(problem, found, item.fitted, gap)
    return _report_effect(problem, item.fitted, -1, item.evidence, closed, tied, weight)


def _report_effect(
    problem: Problem,
    fitted: Fitted,
    k: int,
    evidence: float,
    closed: tuple[float, float],
    tied: tuple[str, ...],
    weight: float,
) -> Candidate:
    """An effect of a fit, by its place among them, with its parameters there."""
    placed, theta = fitted.placed[k], fitted.theta[k]
    return Candidate(
        effect=placed.effect.effect_name(theta),
        location=placed.location,
        parameters=placed.effect.report_parameters(problem.nominal, placed.location, theta, fitted.std[k]),
        evidence=float(evidence),
        gap_after=closed[1],
        share_closed=closed[0],
        tied_locations=tied,
        probability=weight,
    )


def _closed_share(problem: Problem, found: Attribution, fitted: Fitted, gap: Gap) -> tuple[float, float]:
    """Share of the power above the noise that a fit closes, whitened, and the gap that this leaves."""
    n = len(problem.nominal_rows)
    open_power = found.baseline.power - n
    share = 0.0 if open_power <= 0.0 else float(np.clip(1.0 - (fitted.power - n) / open_power, 0.0, 1.0))
    left = (1.0 - share) * max(gap.before**2 - gap.noise_floor**2, 0.0)
    return share, float(np.sqrt(gap.noise_floor**2 + left))


def _accepted_effects(problem: Problem, found: Attribution, gap: Gap) -> tuple[Candidate, ...]:
    """The accepted effects in the order in which they were added, at the parameters of the joint fit."""
    weights = [float(_hypothesis_probabilities(_one_each((), step))[0]) for step in found.steps]
    partial = _fit_partial(problem, found.accepted_fit)
    closed = [_closed_share(problem, found, fitted, gap) for fitted in partial]
    return tuple(
        _report_effect(problem, found.accepted_fit, k, step[0].evidence, closed[k], found.tied[k], weights[k])
        for k, step in enumerate(found.steps)
    )


def _next_experiment(found: Attribution) -> NextExperiment | None:
    if found.verdict != "ambiguous":
        return None
    rivals = tuple(f"{_effect_name(item)}@{item.last_placed.location}" for item in found.rivals)
    reasons = "; ".join(
        sorted({f"{_effect_name(item)}: {item.last_placed.effect.reads_as}" for item in found.rivals})
    )
    return NextExperiment(why=f"tell {' from '.join(rivals)} ({reasons})", separates=rivals)


def _collect_warnings(problem: Problem, found: Attribution) -> tuple[str, ...]:
    notes = []
    if problem.record.inertials_free:
        notes.append(
            "inertial parameters are identified: payloads and link inertias are part of them, and what "
            "they can imitate (with force plates, joint offsets, link lengths and a tilted base) is invisible"
        )
    if problem.repeatability.level is None:
        notes.append("no repeated trial: the noise is taken from above the motion's band alone")
    if not problem.repeatability.repeatable:
        notes.append("repeated trials differ by more than noise: something outside the log acts on the robot")
    if problem.record.robot.sensors and not problem.unloaded.sensors:
        notes.append(
            "no foot is ever in the air: a constant sensor bias looks like a constant external force"
        )
    if not any(problem.record.validation):
        notes.append("no validation trial: the gap is that of the trials that were fitted")
    if found.verdict in {"effect", "ambiguous"} and found.overdispersion > NOISE_SLACK:
        notes.append(f"{found.overdispersion:.1f} times the noise's power is left unexplained")
    return tuple(notes)
