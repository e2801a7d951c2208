"""Whether the stated interval of the share closed holds on motions that the diagnosis has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.arm_case import N_TRIALS, PAUSE_S, TRIAL_S, arm_of
from benchmarks.blind.case import _prepare_robot, log_session, noise_of, recordings_of
from benchmarks.blind.draw import ROBOTS, draft_case
from excite.arrays import Array
from excite.diagnosis.answer.gap import gap_of
from excite.diagnosis.arm.diagnose import judge_record
from excite.diagnosis.arm.record import TorqueRecord
from excite.diagnosis.attribution import Attribution
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.noise_floor import (
    kinematic_noise,
    other_postures,
    position_noise,
    repeat_floor,
    unrepeated_noise_power,
)
from excite.diagnosis.equations.own_columns import own_signals, own_terms
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standing_joints import HELD, held_power, standing_share
from excite.doctor.examine import examine
from excite.logs.log import Log, Trial
from excite.regressor.kernels import inverse_dynamics
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.execution import execute_motion
from excite.simulation.sensing import log_header
from excite.simulation.virtual_robot import Recording
from tests.benchmarks.table import Row

SEED, CASES, PAIRS = 606707, 40, 8


@dataclass(frozen=True, eq=False)
class Case:
    """A diagnosis, and its residuals on all motions: of its log, then further ones.

    Attributes:
        samples: all trials with noise; the first ``n_logged`` are the log's.
        n_logged: trials of the log.
        before: ``(n_joints, n_rows)`` residual of the baseline [N·m].
        after: the same with the accepted effects.
        clean: ``(3, n_trials, n_joints)`` power of the same without noise, before and after, and the part of the
            latter where joints stand, which nothing can close [(N·m)²].
        noise: ``(n_joints, n_rows)`` draw of what the positions' noise adds [N·m].
        repeat: ``(n_joints,)`` floor of the repeated trials [N·m].
        scale: ``(n_joints,)`` deviation of the torques in the identification trials [N·m].
    """

    samples: ArmSamples
    n_logged: int
    before: Array
    after: Array
    clean: Array
    noise: Array
    repeat: Array
    scale: Array

    def stated(self, pair: tuple[int, ...]) -> tuple[float, float] | None:
        """The interval that two validation trials make the diagnosis state."""
        trials = self.samples.trials
        fitted = [k for k in range(self.n_logged) if trials[k].identification]
        chosen = sorted((*fitted, *pair))
        keep = np.isin(self.samples.trial_of_row, chosen)
        part = replace(self.samples, trials=tuple(trials[k] for k in chosen))
        floor = other_postures(
            self.repeat,
            unrepeated_noise_power(part, self.noise[:, keep], ~self.samples.identification_rows[keep]),
        )
        left, rows = self.after[:, keep], ~self.samples.identification_rows[keep]
        floor = np.sqrt(floor**2 + held_power(part, left, floor, rows))
        rng = np.random.default_rng(2)
        return gap_of(part, self.before[:, keep], left, floor, self.scale, rng).interval

    def truth(self, pair: tuple[int, ...]) -> float:
        """The share closed on all motions but a pair and the fitted ones, without noise."""
        others = [
            k for k, trial in enumerate(self.samples.trials) if not trial.identification and k not in pair
        ]
        old, new, held = ((power[others] / self.scale**2).mean() for power in self.clean)
        return float(1.0 - (new - held) / (old - held))

    def pairs(self) -> list[tuple[int, int]]:
        """The log's validation trials, and the further ones by twos."""
        own = [k for k in range(self.n_logged) if not self.samples.trials[k].identification]
        rest = list(range(self.n_logged, len(self.samples.trials)))
        return [(own[0], own[1]), *zip(rest[::2], rest[1::2], strict=True)]


def coverage(seed: int = SEED, cases: int = CASES) -> tuple[float, float, int, int]:
    """Share of stated 90 % intervals that hold the share closed on other motions, without noise.

    Returns:
        The share, the intervals' median width, their number and that of the diagnoses that they are of.
    """
    held, widths, diagnoses = [], [], 0
    for case in cases_of(seed, cases):
        diagnoses += 1
        for pair in case.pairs():
            interval = case.stated(pair)
            if interval is not None:
                held.append(interval[0] <= case.truth(pair) <= interval[1])
                widths.append(interval[1] - interval[0])
    return float(np.mean(held)), float(np.median(widths)), len(held), diagnoses


def cases_of(seed: int, cases: int) -> Iterator[Case]:
    """Diagnoses that name an effect, of cases with something hidden and sound records.

    Without friction that drifts: further motions come later in the session, when joints are warmer.
    """
    for number, child in enumerate(np.random.SeedSequence(seed).spawn(cases)):
        rng = np.random.default_rng(child)
        plan = replace(draft_case(number, rng, ROBOTS), faults=())
        if plan.kind in {"none", "unknown"} or "friction_drift" in dict(plan.effects):
            continue
        arm = arm_of(load_robot(plan.robot), plan.fixed, rng)
        made = _prepare_robot(arm, plan, rng)
        virtual, modelled = made.virtual, made.modelled
        recordings = recordings_of(virtual, arm)
        sigma = noise_of(recordings, plan.noise)
        more: list[Recording] = []
        memory: dict = {}
        while len(more) < 2 * PAIRS:
            for motion in arm_of(load_robot(plan.robot), plan.fixed, rng).motions[: 2 * PAIRS - len(more)]:
                name, start = f"trial_{len(recordings) + len(more):02d}", len(recordings) + len(more)
                session = start * (TRIAL_S + PAUSE_S)
                run = execute_motion(virtual, replace(motion, name=name), session_s=session, memory=memory)
                for reading in virtual.readings:
                    run = reading(run)
                more.append(run)
        noisy, headers = log_session([*recordings, *more], arm, plan.noise, plan.faults, sigma, rng)
        n_logged = len(recordings)
        roles = [
            "validation" if N_TRIALS <= k < n_logged - 1 or k >= n_logged else "identification"
            for k in range(len(noisy))
        ]
        noisy = tuple(
            replace(t, role=r, repeats=noisy[0].name if k == n_logged - 1 else None)
            for k, (t, r) in enumerate(zip(noisy, roles, strict=True))
        )
        clean = tuple(
            replace(t, q=r.q, tau=r.tau_motor) for t, r in zip(noisy, [*recordings, *more], strict=True)
        )
        header = log_header(virtual.robot, headers[:n_logged]).model_copy(update={"modelled": modelled})
        log = Log(header=header, trials=noisy[:n_logged], robot_text=virtual.robot.urdf)
        case = _diagnosed(virtual.robot, log, noisy, clean)
        if case is not None:
            yield case


def _diagnosed(robot: Robot, log: Log, noisy: tuple[Trial, ...], clean: tuple[Trial, ...]) -> Case | None:
    chart = examine(robot, log)
    judged = judge_record(TorqueRecord(robot, chart.log, log.header.modelled))
    samples, baseline, found = judged.samples, judged.baseline, judged.attribution
    if not found.accepted:
        return None
    columns = [log.header.joints.index(name) for name in samples.joints]
    sigma = position_noise(samples, columns, chart.log.trials)
    repeated = repeat_floor(samples, baseline.plain_residual(found.final.fit.residual))
    floor = found.floor if repeated is None else np.maximum(repeated, 0.5 * found.floor)
    everywhere = arm_samples(robot, log, noisy)
    quiet = arm_samples(robot, log, clean)
    before, after = residuals_on(found, everywhere)
    of_trial = quiet.trial_of_row
    old, new = residuals_on(found, quiet)
    power = np.array(
        [
            [(rest[:, of_trial == k] ** 2).mean(axis=1) for k in range(len(clean))]
            for rest in (old, new, new * (standing_share(quiet) > HELD))
        ]
    )
    noise = kinematic_noise(_on(baseline, everywhere), sigma, np.random.default_rng(0))
    return Case(everywhere, len(log.trials), before, after, power, noise, floor, found.scale)


def residuals_on(found: Attribution, samples: ArmSamples) -> tuple[Array, Array]:
    """Residuals of the baseline and of what was found, parameters as they are, on other samples.

    Args:
        found: the attribution.
        samples: those it was made on, and others behind them.

    Returns:
        ``(n_joints, n_rows)`` each [N·m].
    """
    joints = range(len(samples.joints))
    tau = samples.to_rows([t.tau for t in samples.trials], joints)
    first = _on(found.baseline, samples)
    added, drive, sum_ = (np.zeros_like(first.total) for _ in range(3))
    for item in found.accepted:
        h = item.hypothesis
        there = _on(h.baseline, samples, added, drive)
        here = h.effect.shape(Context(h.baseline), item.location, h.theta)
        shape = h.effect.shape(Context(there), item.location, h.theta)
        then = np.zeros_like(added)
        for j, old in here.columns.items():
            # Columns may be normalised by what the record holds, which further trials change.
            new = shape.columns[j][: len(old)]
            by = (old * new).sum(axis=0) / np.maximum((new**2).sum(axis=0), 1e-300)
            then[:, j] += shape.columns[j] @ (by * h.fit.extra)
        for j, offset in shape.offset.items():
            then[:, j] += offset
        sum_ += then
        added, drive = (added + then, drive) if h.effect.moves else (added, drive + then)
    final = _on(found.final, samples).total + sum_
    before, after = (tau - samples.to_rows(samples.by_trial(total), joints) for total in (first.total, final))
    return before.T, after.T


def _on(
    baseline: Baseline, samples: ArmSamples, added: Array | float = 0.0, drive: Array | float = 0.0
) -> Baseline:
    """The baseline with its predictions on other samples."""
    q, v, a = (samples.stack_trials(name) for name in ("q", "v", "a"))
    rigid = inverse_dynamics(samples.robot.model, q, v, a, baseline.phi)[:, list(samples.index)] + added
    terms = own_terms(baseline.modelled)
    own = [
        own_signals(samples, terms, j, baseline.signs[j]) @ o for j, o in enumerate(baseline.fit.own_coefs)
    ]
    total = rigid + np.column_stack(own) + drive
    nothing = np.zeros_like(total)
    return replace(
        baseline,
        samples=samples,
        rigid=rigid,
        total=total,
        added=nothing + added,
        added_drive=nothing + drive,
    )


def rows() -> list[Row]:
    """Figures of the intervals."""
    covered, width, n, diagnoses = coverage()
    return [
        Row.holds(
            f"stated 90 % interval of the share closed ({n}, of {diagnoses} diagnoses): holds on other motions",
            "85 … 95 %",
            f"{100.0 * covered:.0f} %",
            0.85 <= covered <= 0.95,
        ),
        Row("the same: median width", "", f"{width:.3f}", None),
    ]
