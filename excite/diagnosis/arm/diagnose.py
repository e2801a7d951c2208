"""The diagnosis of a fixed-base arm with joint torques."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import ndtri, stdtrit

from excite.arrays import Array, jackknife_std
from excite.diagnosis.answer.answer import NO_NAME, Absorbed, Diagnosis, Rollout
from excite.diagnosis.answer.candidate import Candidate, Estimate, format_estimate
from excite.diagnosis.answer.gap import Budget, Curves, Gap, Where, gap_of, locate_residual, share_closed
from excite.diagnosis.arm.read import BudgetVerdict
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.attribution import Attribution, Judgement, Scored, Scorer
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.library import NAMELESS
from excite.diagnosis.budget.made import budget_of, sizes_by_trial
from excite.diagnosis.budget.record import fit_initial_baseline, rows_of
from excite.diagnosis.budget.shares import part_time_payload, trials_that_carry
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.joint_torque import TRIALS
from excite.diagnosis.equations.known_drives import known_terms, subtract_known_torques
from excite.diagnosis.equations.noise_floor import (
    bands_by_noise,
    kinematic_noise,
    other_postures,
    position_noise,
    repeat_floor,
    spectral_floor,
    unrepeated_noise_power,
    white_floor,
    without_drift,
)
from excite.diagnosis.equations.own_columns import COULOMB, SCALED, own_rows, own_terms
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standing_joints import held_power, stands_throughout, with_held
from excite.diagnosis.equations.units import at_joint, force_unit
from excite.diagnosis.next_experiment.advice import give_advice
from excite.diagnosis.selection.found import build_gap_model
from excite.diagnosis.simulator.augmented_plant import FoundEffect, found_effects, robot_changes
from excite.diagnosis.simulator.rollout_compare import simulate_effects
from excite.diagnosis.trivial import of_torques
from excite.finding import Finding
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS

_LISTED = 8


def candidate_of(item: Scored, context: Context, gap: Gap, attribution: Attribution) -> Candidate:
    """A scored hypothesis as it stands in the document; gaps on the validation trials."""
    h = item.hypothesis
    after = h.baseline.relative_gap(h.fit.residual, attribution.scale)
    return Candidate(
        effect=item.name,
        location=item.location,
        parameters=at_joint(
            context.baseline.samples.robot,
            item.location,
            h.effect.to_estimates(context, item.location, h.theta, h.fit_with_trial_deviations),
        ),
        evidence=item.evidence,
        gap_after=after,
        share_closed=share_closed(gap.before, after, gap.noise_floor),
    )


def including_absorbed(item: Candidate, scored: Scored) -> tuple[Candidate, ...]:
    """An accepted effect, and those that its form has in it: each with the parameters that are its own."""
    along = scored.hypothesis.effect.along
    if not along:
        return (item,)
    theirs = {name for names in along.values() for name in names}
    own = {name: value for name, value in item.parameters.items() if name not in theirs}
    made = [replace(item, parameters=own)]
    for effect, names in along.items():
        made.append(replace(item, effect=effect.name, parameters={n: item.parameters[n] for n in names}))
    return tuple(made)


def rank_candidates(
    attribution: Attribution, judgement: Judgement, gap: Gap, effects: tuple[Candidate, ...]
) -> tuple[tuple[Candidate, ...], int]:
    """Candidates for the first effect, likeliest first, and how many of them are tied."""
    made = [
        candidate_of(item, Context(item.hypothesis.baseline), gap, attribution)
        for item in attribution.ranking
    ]
    if not effects:
        return tuple(made[:_LISTED]), 0
    # The place may be open where the name is not.
    sure = judgement.probability
    head = [replace(effects[0], probability=sure)]
    if judgement.renamed[0] is not None:
        # Two names for one thing share its probability.
        sure = None if sure is None else 0.5 * sure
        head = [
            replace(head[0], probability=sure),
            replace(head[0], probability=sure, effect=judgement.renamed[0]),
        ]
    found = {(c.effect, c.location): c for c in made}
    for rival, twin, chance in zip(judgement.rivals, judgement.twins, judgement.chances, strict=True):
        item = found[rival.name, rival.location]
        if twin is None:
            head.append(replace(item, probability=chance))
        else:
            head += [replace(item, probability=0.5 * chance, effect=name) for name in (item.effect, twin)]
    known = {(c.effect, c.location) for c in head}
    rest = [c for c in made if (c.effect, c.location) not in known]
    return tuple((head + rest)[:_LISTED]), len(head) if judgement.verdict == "ambiguous" else 0


def diagnose_arm(robot: Robot, log: Log, rng: np.random.Generator, out: Path | None = None) -> Diagnosis:
    """Diagnose a log of a fixed-base arm with joint torques.

    Args:
        robot: the nominal model.
        log: the log, with an identification trial.
        rng: of the bootstrap.
        out: folder for the augmented simulator; none is written without it.

    Returns:
        The diagnosis.

    Raises:
        LogError: no torques, trials too short.
    """

    def roll_out_effects(attribution: Attribution) -> Rollout:
        return simulate_effects(attribution, out)

    return diagnose_torques(TorqueRecord(robot, log, log.header.modelled, out), rng, roll_out_effects)


def diagnose_torques(
    record: TorqueRecord,
    rng: np.random.Generator,
    simulate: Callable[[Attribution], Rollout | None],
) -> Diagnosis:
    """Diagnose repaired trials that have torques, measured or reconstructed.

    Args:
        record: the trials, their model and what to try.
        rng: of the bootstrap.
        simulate: makes the roll-outs from the attribution.

    Returns:
        The diagnosis.
    """
    found = judge_record(record)
    samples, baseline, attribution, judgement = (
        found.samples,
        found.baseline,
        found.attribution,
        found.judgement,
    )
    before, after = (baseline.plain_residual(fit.residual) for fit in (baseline.fit, attribution.final.fit))
    closed = after if attribution.accepted else before
    gap = gap_of(samples, before, closed, _torque_noise_floor(found, before), attribution.scale, rng)
    effects = tuple(
        one
        for item, tied, values in zip(
            attribution.accepted, judgement.tied, found_effects(attribution), strict=True
        )
        for one in including_absorbed(_as_candidate(item, tied, values, found, gap), item)
    )
    listed, n_tied = rank_candidates(attribution, judgement, gap, effects)
    unknown = judgement.verdict == "unknown"
    named = effects[0] if effects and not unknown else None
    location = judgement.structured[0] if unknown else None if named is None else named.location
    return Diagnosis(
        robot=record.robot.name,
        verdict=judgement.verdict,
        effect=None if named is None else named.effect,
        location=location,
        tied_locations=() if named is None else named.tied_locations,
        candidates=listed,
        effects=effects,
        gap=gap,
        where=locate_gap(Context(baseline), found.budget.channel_weights),
        simulation=simulate(attribution),
        n_tied=n_tied,
        next_experiment=give_advice(attribution, judgement, record.out),
        warnings=_collect_warnings(record, found, effects),
        budget=found.budget,
        absorbed=estimate_absorbed_sizes(baseline),
        faults=found.findings,
        trivial={} if record.reconstructed_noise else of_torques(samples, closed),
        changes=robot_changes(attribution),
        curves=trial_curves(samples, before, closed),
    )


def _as_candidate(
    item: Scored, tied: tuple[str, ...], values: FoundEffect, found: GapFit, gap: Gap
) -> Candidate:
    """An accepted effect with its sizes as a simulator takes them up, and its probability in the model of all.

    A size that is a gear's shape has the deviation that this model tells.
    """
    alone = candidate_of(item, Context(item.hypothesis.baseline), gap, found.attribution)
    key = item.name, item.location
    named = next(other for other in found.budget.named if (other.effect, other.location) == key)
    parameters = {
        name: replace(
            one,
            value=values.values.get(name, one.value),
            std=named.values.get(name, (0.0, None))[1] if one.std is None else one.std,
        )
        for name, one in alone.parameters.items()
    }
    return replace(alone, parameters=parameters, tied_locations=tied, probability=named.probability)


def _torque_noise_floor(found: GapFit, before: Array) -> Array:
    """Noise of the torques, by joint [N·m]: what repeats of a command differ by, and what friction holds.

    By the record before any effect, so that no floor depends on what was found.
    """
    samples, baseline, floor = found.samples, found.baseline, found.spectral
    outside = samples.judging_rows
    if samples.repeat_pairs:
        terms = own_terms(("viscous_friction", "coulomb_friction", "torque_bias"))
        own = [own_rows(samples, terms, j, [sign])[0] for j, sign in enumerate(baseline.signs)]
        repeat = repeat_floor(samples, without_drift(samples, before, own))
        if repeat is not None:
            more = unrepeated_noise_power(samples, found.noise, outside)
            floor = other_postures(np.maximum(repeat, 0.5 * floor), more)
    return np.sqrt(floor**2 + held_power(samples, before, floor, outside))


def _collect_warnings(record: TorqueRecord, found: GapFit, effects: tuple[Candidate, ...]) -> tuple[str, ...]:
    """Limits of what is said, one sentence each."""
    warnings = []
    if not record.log.role("validation"):
        warnings.append(
            "the log has no validation trial: everything was judged on the trials it was fitted on"
        )
    if effects and found.judgement.structured:
        warnings.append("a gap above the noise is left at " + ", ".join(found.judgement.structured))
    if found.attribution.stranger is not None:
        warnings.append(in_words(found.attribution.stranger))
    return tuple(warnings)


# Curves of an arm's torques.


def trial_curves(samples: ArmSamples, before: Array, after: Array) -> Curves:
    """Curves of the first validation trial, of the first trial where there is none.

    Args:
        before: ``(n_joints, n_rows)`` measured minus predicted without effects [N·m].
        after: the same with the effects.
    """
    chosen = next((k for k, t in enumerate(samples.trials) if not t.identification), 0)
    trial, here = samples.trials[chosen], samples.trial_of_row == chosen
    measured = np.asarray(samples.to_rows(samples.stack_trials("measured_torque"))[here])
    before, after = (samples.without_slip_weights(values)[:, here].T for values in (before, after))
    return Curves(
        trial=trial.name,
        validation=not trial.identification,
        channels=samples.joints,
        units=tuple(force_unit(samples.robot, name) for name in samples.joints),
        time=trial.time[trial.rows],
        measured=measured,
        before=measured - before,
        after=measured - after,
    )


# Where the gap lies: joint by joint, and what each joint's residual follows.


def locate_gap(context: Context, shares: Mapping[str, float]) -> tuple[Where, ...]:
    """Map of the baseline's residual, largest share first.

    What a residual depends on is told by the identification trials.

    Args:
        context: the baseline.
        shares: by joint, its share of the gap, as the budget has it: one joint has but one.

    Returns:
        One line a joint.
    """
    samples = context.baseline.samples
    use, rest = (samples.identification_rows, context.baseline.plain_residual(context.baseline.fit.residual))
    lines = [
        locate_residual(
            name,
            shares[name],
            rest[j][use],
            {
                what: samples.to_rows(columns)[use]
                for what, columns in _dependence_features(context, j).items()
            },
            [rest[j][samples.trial_of_row == k] for k in range(len(samples.trials))],
            samples.bands.rate_hz,
        )
        for j, name in enumerate(context.joints)
    ]
    return tuple(sorted(lines, key=lambda line: -line.share))


def _dependence_features(context: Context, j: int) -> dict[str, Array]:
    """Functions of one thing each, ``(n_samples, k)``."""
    q, v, a = context.q[:, j], context.v[:, j], context.a[:, j]
    sign, load = context.friction_sign(j), context.baseline.rigid[:, j]
    clock = context.session_time / max(float(context.session_time.max()), 1e-9)
    return {
        "velocity": np.column_stack(
            [sign, v, sign * v**2, *(sign * np.exp(-((v / w) ** 2)) for w in (0.03, 0.1))]
        ),
        "position": np.column_stack(
            [np.ones_like(q), q, *(f(k * q) for k in (1, 2) for f in (np.cos, np.sin))]
        ),
        "load": np.column_stack([load, np.abs(load) * sign, np.abs(load), load**2 * sign]),
        "acceleration": np.column_stack([a, np.abs(a) * sign]),
        "time": np.column_stack([clock, clock**2, clock * sign, clock**2 * sign, clock * v]),
    }


# Friction, rotor inertia and constants that the baseline took from the record, with their intervals.

_UNITS = {word: term.unit for term in DRIVE_TERMS.values() for word in term.effects}


def estimate_absorbed_sizes(baseline: Baseline) -> tuple[Absorbed, ...]:
    """Coefficients of the joints' own columns, as many a joint as ``modelled`` asks for.

    Deviations are those by which the fitted trials disagree, and Student's intervals of so few of them; of one or two
    trials those of white residuals.

    Args:
        baseline: before the first effect.
    """
    equations, joints = baseline.solver.equations, baseline.samples.joints
    trials = len(np.unique(equations.trial[equations.use]))
    within = float(stdtrit(trials - 1, 0.95) if trials >= TRIALS else ndtri(0.95))
    # Those of rotors that are left out have deviations too.
    whole = baseline.with_signs(baseline.signs, [False] * len(joints)).solver.equations
    found = []
    for j, joint in enumerate(joints):
        names = list(_own_column_names(baseline, j))
        if not names:
            continue
        # As columns of a hypothesis, whose deviations are known, and not as the joint's own.
        solver = baseline.solver.with_own(j, equations.own[j][:, :0])
        columns = np.zeros((len(joints), *equations.own[j].shape))
        columns[j] = whole.own[j]
        spread = solver.std_between_trials(solver.fit_columns(columns))
        columns[j] = equations.own[j]
        fit = solver.fit_columns(columns)
        for name, value, std in zip(names, fit.extra, spread, strict=True):
            word = name.partition(" ")[0]
            # Of a scale this is what it would be without the first effect: the constant itself is what is told.
            if word == SCALED:
                continue
            size = Estimate(float(value), float(std), _UNITS[word])
            there = (float(value - within * std), float(value + within * std))
            found.append(
                Absorbed(joint, name, at_joint(baseline.samples.robot, joint, {name: size})[name], there)
            )
    return tuple(found)


def _own_column_names(baseline: Baseline, joint: int) -> Iterator[str]:
    """Of a joint's own columns, in their order: of its motor, of its bristles."""
    terms = own_terms(baseline.modelled)
    yield from (term.words[0] for term in terms)
    if baseline.signs[joint].has_damping and COULOMB in terms:
        yield "viscous_friction of the bristles at standstill"


# What is found in a record of torques: the model of its gap, its budget, and the verdict that is read from
# it.


@dataclass(frozen=True, eq=False)
class GapFit:
    """What was found in the rows, and the noise by which it was judged.

    Attributes:
        samples: the repaired trials at one rate.
        baseline: before the first effect.
        spectral: noise in the rows' band, positions' share in it, ``(n_joints,)`` [N·m].
        noise: what noise of the positions leaves in the rows, ``(n_joints, n_rows)`` [N·m].
        attribution: the effects, in the equations.
        judgement: the verdict on them.
        budget: where each joint's gap goes.
        findings: what limits what the record can tell.
    """

    samples: ArmSamples
    baseline: Baseline
    spectral: Array
    noise: Array
    attribution: Attribution
    judgement: Judgement
    budget: Budget
    findings: tuple[Finding, ...] = ()


def judge_record(record: TorqueRecord) -> GapFit:
    """Find what a record's gap is made of."""
    # Torques that were made of positions are as late and as noisy as these.
    measured = record.reconstructed_noise is None
    bands = bands_by_noise(record.log, record.log.trials) if measured else None
    samples = arm_samples(record.robot, record.log, record.log.trials, bands)
    if known_terms(samples, record.modelled):
        samples = subtract_known_torques(samples, record.modelled, spectral_floor(samples))
    spectral = (record.reconstructed_noise or spectral_floor)(samples)
    # Torques that were not measured are no better further up in the spectrum.
    least = np.minimum(white_floor(samples), spectral) if measured else spectral
    full = fit_initial_baseline(samples, record.modelled, least)
    samples = full.samples
    baseline = fit_baseline(samples, record.modelled, least, like=full)
    columns = [record.log.header.joints.index(name) for name in samples.joints]
    sigma = position_noise(samples, columns, record.log.trials)
    noise = kinematic_noise(baseline, sigma, np.random.default_rng(0))
    spectral = np.hypot(spectral, np.sqrt(((noise * baseline.strict) ** 2).mean(axis=1)))
    tau = samples.to_rows([t.measured_torque for t in samples.trials])[samples.identification_rows]
    # A joint that stands throughout leaves what holds it, in units of next to no torque: no part of the whole gap.
    scale = np.where(stands_throughout(samples), np.inf, np.maximum(tau.std(axis=0), 1e-9))
    together = find_joints_in_unison(full)
    # On one path any list of effects could stand for any other, and what has no name for any that has: there each
    # joint's own motion tells the terms of its drive.
    effects = tuple(effect for effect in record.effects if together is None or effect.term is not None)
    if together is None:
        loaded = part_time_payload(Context(full), rows_of(full, full.modelled, least), full.strict)
        effects = (*effects, *NAMELESS, *(() if loaded is None else (loaded,)))
    found = build_gap_model(full, record.modelled, effects, least, sigma, np.random.default_rng(0))
    model, context = found.model, found.prediction.context
    spectral = with_held(samples, model.residual, spectral)
    budget = budget_of(found, spectral, scale)
    said = (*(() if together is None else (together,)), *find_changed_sizes(model))
    said = (*said, *sizes_by_trial(model, context, found.baseline.strict, spectral))
    scorer = Scorer(baseline, spectral, unrepeated_noise_power(samples, noise * baseline.strict), scale)
    attribution, judgement = BudgetVerdict(found, budget, scorer).decide_verdict()
    named = ((item.hypothesis.effect, item.location) for item in attribution.accepted)
    said = (*said, *trials_that_carry(named))
    return GapFit(samples, baseline, spectral, noise, attribution, judgement, budget, said)


# Whether the trials to learn from and those to judge by are of one machine: sizes refitted on the latter.

# Blocks of the trials that judge by which they tell how sure they are.
_BLOCKS = 3
# Share of a size from which a difference is another machine, not what a model leaves: a load turned by half a turn
# and a band tightened by half lie above it.
_LARGE = 0.3


def find_changed_sizes(model: Model) -> tuple[Finding, ...]:
    """Terms whose sizes in the trials that judge are others than in those that were learnt from.

    All else in the model is kept as it was learnt. A difference counts where blocks on both sides agree that it is
    there, it is a good part of the size itself, and without it as much more is left of the joints that feel the term as
    an effect has to be missed by: a friction of next to nothing may differ by all of itself.

    Args:
        model: the model of the gap.
    """
    design = model.design
    if design.judging_grams is design.fitted or len(design.judging_grams.count) < _BLOCKS or not model.chosen:
        return ()
    refits = _refit_on_judging_trials(model)
    if refits is None:
        return ()
    there, spread = refits
    first = model.layout.begin[0]
    here = model.x[first:]
    both = np.hypot(jackknife_std(model.left_out[:, first:]), spread)
    made = []
    for k, begin in zip(model.chosen, model.layout.begin, strict=True):
        term = design.terms[k]
        if term.known:
            continue
        where = slice(begin - first, begin - first + term.n_free)
        change = there[where] - here[where]
        clear = np.abs(change) > THRESHOLDS.differs * both[where]
        large = np.linalg.norm(change) > _LARGE * np.linalg.norm(here[where])
        if not (clear.any() and large) or _power_of_size_change(model, k, change) < THRESHOLDS.trifle:
            continue
        old, new = term.to_beta(here[where]), term.to_beta(there[where])
        names = [p.name for p in term.effect.linear]
        shown = [i for i in term.kept if abs(float(new[i] - old[i])) > 0.0][:4]
        said = ", ".join(f"{names[i]} {old[i]:.3g} against {new[i]:.3g}" for i in shown)
        made.append(
            Finding(
                kind="other_machine",
                text=(
                    "the trials to learn from and those to judge by are not of one machine: "
                    f"{term.name.replace('_', ' ')} at {term.location} has {said}"
                ),
                figures={
                    f"{names[i]}.{side}": float(v[i])
                    for i in shown
                    for side, v in (("learnt", old), ("judged", new))
                },
                places=(term.location,),
                severity="limits",
                remedy="judge each set of trials by its own identification, or give them sessions of their own",
            )
        )
    return tuple(made)


def _power_of_size_change(model: Model, k: int, change: Array) -> float:
    """Power that a change of a term's size makes in the trials that judge, as a share of what is left there."""
    grams, at = model.design.judging_grams, model.design.place[k]
    left = (model.residual_power(grams) * grams.count[:, None]).sum(axis=0)
    made = sum(
        float(model.weight[j] * (change @ grams.total[j][np.ix_(c, c)] @ change)) for j, c in at.items()
    )
    return made / max(sum(float(model.weight[j] * left[j]) for j in at), 1e-300)


def _refit_on_judging_trials(model: Model) -> tuple[Array, Array] | None:
    """Sizes of all terms on the trials that judge, and their deviations by blocks; None where these tell too little."""
    first, grams = model.layout.begin[0], model.design.judging_grams
    size = model.layout.size - first
    n = len(grams.count)
    normal, right = np.zeros((n, size, size)), np.zeros((n, size))
    for g, c, p, w in zip(grams.of, model.layout.columns, model.layout.numbers, model.weight, strict=True):
        ours = p >= first
        numbers = p[ours] - first
        columns, rest = c[ours], c[~ours]
        normal[:, numbers[:, None], numbers] += w * g[:, columns[:, None], columns]
        right[:, numbers] += w * (g[:, columns, -1] - g[:, columns[:, None], rest] @ model.x[p[~ours]])
    total, sums = normal.sum(axis=0), right.sum(axis=0)
    # What these trials hardly show stays as it was learnt.
    keep = 1e-3 * model.normal[first:, first:].diagonal()
    prior = np.diag(keep)
    learnt = keep * model.x[first:]
    there = np.linalg.solve(total + prior, sums + learnt)
    without = np.linalg.solve(total - normal + prior, (sums - right + learnt)[..., None])[..., 0]
    return there, jackknife_std(without)


# Whether a motion moves the joints one by one, or all on one line: which place a gap has is then not told.


def independent_joints(q: Array) -> float:
    """How many joints move independently in positions ``(n, n_joints)``: the exponential of an entropy.

    Of the shares that the principal directions of the joints' motion have, each joint's by its own deviation (Roy,
    Vetterli 2007, effective rank).
    """
    moved = q - q.mean(axis=0)
    size = moved.std(axis=0)
    moved = moved[:, size > 1e-6] / size[size > 1e-6]
    if not moved.shape[1]:
        return 0.0
    share = np.linalg.svd(moved.T @ moved, compute_uv=False)
    share = share[share > 0.0] / share.sum()
    return float(np.exp(-(share * np.log(share)).sum()))


def find_joints_in_unison(baseline: Baseline) -> Finding | None:
    """The finding that joints move in unison, with what is determined all the same; None where they do not.

    Args:
        baseline: what is modelled, fitted.
    """
    samples = baseline.samples
    q = samples.motor_signal("q")
    count = independent_joints(q)
    if len(samples.joints) < 3 or count >= THRESHOLDS.unison:
        return None
    scales = torque_scales(baseline)
    said = ", ".join(f"{name} {value:.3g}" for name, value in scales.items())
    return Finding(
        kind="unison",
        text=(
            f"the joints move in unison: {count:.1f} of {len(samples.joints)} directions are independent, so what "
            "acts at one joint looks like what acts at another, or like a body; what is determined is each joint's "
            f"torque over the model's along that one path ({said})"
        ),
        figures={"independent": count, **{f"torque_scale.{name}": value for name, value in scales.items()}},
        places=samples.joints,
        severity="limits",
        remedy="record motions that move the joints one after the other, or at different rates",
    )


def torque_scales(baseline: Baseline) -> dict[str, float]:
    """Measured torque per torque of the nominal rigid bodies, by joint, beside friction and a constant."""
    samples, scales = baseline.samples, {}
    use = samples.identification_rows
    tau = samples.to_rows([t.tau for t in samples.trials])[use]
    nominal = tau - (baseline.solver.equations.y / baseline.root_weight).T[use]
    sign = samples.to_rows(np.column_stack([np.tanh(t) for t in _normalised_speeds(baseline)]))[use]
    speed = samples.to_rows(np.column_stack(_normalised_speeds(baseline)))[use]
    for j, name in enumerate(samples.joints):
        columns = np.column_stack([nominal[:, j], np.ones(len(tau)), sign[:, j], speed[:, j]])
        if nominal[:, j].std() > THRESHOLDS.load * tau[:, j].std():
            scales[name] = float(np.linalg.lstsq(columns, tau[:, j], rcond=1e-10)[0][0])
    return scales


def _normalised_speeds(baseline: Baseline) -> list[Array]:
    """Velocity of each joint over the width of its friction's change of sign."""
    v = baseline.samples.motor_signal("v")
    return [speed / sign.width for speed, sign in zip(v.T, baseline.signs, strict=True)]


# Physics that no name of a diagnosis stands for, in words: what an unknown gap is like all the same.


def in_words(item: Scored) -> str:
    """What it says of the robot, for people."""
    h = item.hypothesis
    context = Context(h.baseline)
    values = h.effect.to_estimates(context, item.location, h.theta, h.fit_with_trial_deviations)
    values = at_joint(h.baseline.samples.robot, item.location, values)
    told = ", ".join(f"{name} {format_estimate(value)}" for name, value in values.items())
    return f"the gap at {item.location} is that of a stop, or of a body that the joint runs into ({told}); {NO_NAME}"
