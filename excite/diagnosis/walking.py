"""Drives of a robot that walks: what its servos make of the commands, and what its torques do to its limbs.

Two equations of each joint, neither of which knows the forces at the feet:

- the servo's law ``τ(t) = k_p (q_cmd(t − d) − q) − k_d v + c``, where commands and torques are logged: gains that are
  not applied, and commands that arrive late;
- the joint's rows with contact forces taken out (:mod:`excite.regressor.contact_forces`): torque that does not arrive,
  friction, zeros of encoders. Joints of one kind, left and right, share what the model has; a joint's own is an effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array
from excite.diagnosis.answer.answer import Absorbed, Diagnosis, NextExperiment, Verdict
from excite.diagnosis.answer.candidate import Candidate, Estimate, RobotChanges
from excite.diagnosis.answer.gap import ChannelGap, Gap, Where, share_closed
from excite.diagnosis.selection import sampler
from excite.diagnosis.servo.gains import stated_servo
from excite.doctor.inertial_prior import count_effective_samples, likely_spread
from excite.errors import LogError
from excite.identification.problem import IdentificationProblem, build_problem
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass
from excite.regressor.tree import read_tree
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings

# Steps are sharp: of a simulated trot rows filtered at 5, 10, 20 and 40 Hz leave the true robot 15, 11, 6 and 3 % of
# its torques. Logs that are too slow for it take less.
_CUTOFF_HZ = 40.0
# Stretches by which sizes are told anew, each left out once.
_BLOCKS = 10
# Contacts that change more often than this are steps: a trot changes sixteen a second, a foot moved alone one in three.
_STEPS_HZ = 2.0
# Commands are looked for that much earlier [s].
_LATEST_S = 0.1
# Share of a torque's power that a servo's law explains where the joint has such a servo.
_FOLLOWS = 0.8
# An effect is clear where judging rows of its joint are left with more than a tenth more power without it.
_CLEAR = 1.0 / 1.1
# Deviations that a size has to be off by.
_SURE = 4.0


@dataclass(frozen=True)
class Kind:
    """An effect of one drive.

    Attributes:
        term: of the equations.
        effect: its name.
        parameter: of its size.
        unit: of the size.
        spread: standard deviation expected beforehand; of friction as a share of the joint's torque.
        least: sizes below matter to no simulator, likewise.
    """

    term: str
    effect: str
    parameter: str
    unit: str
    spread: float
    least: float


# By drive term (:data:`~excite.rows.drive_terms.DRIVE_TERMS`). Least sizes are what drives of one robot differ by from
# another's of its make: gains by some per cent, zeros by a degree.
ROW_KINDS = {
    kind.term: kind
    for kind in (
        Kind("lost", "torque_gain", "lost_share", "1", 0.3, 0.06),
        Kind("encoder", "encoder_offset", "offset", "rad", 0.05, 0.015),
        Kind("coulomb", "coulomb_friction", "level", "N·m", 0.2, 0.05),
        Kind("viscous", "viscous_friction", "coefficient", "N·m·s/rad", 0.2, 0.05),
        Kind("offset", "torque_bias", "bias", "N·m", 0.2, 0.05),
        Kind("late", "actuator_lag", "time_constant", "s", 0.02, 0.003),
        # Rotors are the model's: no drive's own is named.
        Kind("armature", "armature", "inertia", "kg·m²", 0.02, np.inf),
    )
}
_OF_SERVOS = {
    "kp": Kind("kp", "servo_gain", "gain", "1", 0.0, 0.05),
    "delay": Kind("delay", "command_delay", "delay", "s", 0.0, 0.004),
}
_NAMES_OF_SERVOS = {kind.effect for kind in _OF_SERVOS.values()}


def walks(log: Log) -> bool:
    """Whether a log is of a robot that steps, whose contact forces nobody measures; moving foot by foot is standing."""
    if log.header.base != "floating" or log.header.sensors:
        return False
    steps = sum(int((flags[1:] != flags[:-1]).sum()) for t in log.trials for flags in t.contacts.values())
    return steps > _STEPS_HZ * sum(float(t.time[-1] - t.time[0]) for t in log.trials)


def diagnose_walking(robot: Robot, log: Log) -> Diagnosis:
    """Diagnose the drives of a robot that walks, from commands, positions, torques, IMU and contact flags.

    Args:
        robot: the nominal model.
        log: the log; without torques the servo's gains have to be stated, and torques are what it asks for.

    Returns:
        The diagnosis; channels are joints.

    Raises:
        LogError: what the log has tells nothing of drives.
    """
    servos = tuple(_servos(log)) if log.header.torque in {"motor_side", "link_side"} else ()
    if log.header.torque == "none":
        log = _with_asked_torques(log)
    cutoff = min(_CUTOFF_HZ, 0.2 * log.header.rate_hz)
    settings = ProblemSettings(cutoff_hz=cutoff, drive_terms=tuple(ROW_KINDS))
    limbs = _Limbs.of(build_problem(robot, log, settings, role=None), log)
    effects = tuple(sorted([*_servo_effects(robot, servos), *limbs.effects()], key=lambda one: -one.evidence))
    rivals = tuple(limbs.rivals()) if limbs.chosen else ()
    at_servos = any(one.effect in _NAMES_OF_SERVOS for one in effects)
    gap = _with_servos(limbs.gap, servos) if at_servos else limbs.gap
    first = effects[0] if effects else None
    verdict: Verdict = "none"
    if first is not None:
        verdict = "ambiguous" if rivals and first.effect not in _NAMES_OF_SERVOS else "effect"
    elif any(servo.explained <= _FOLLOWS for servo in servos):
        verdict = "unknown"
    return Diagnosis(
        robot=robot.name,
        verdict=verdict,
        effect=first.effect if first else None,
        location=first.location if first else None,
        tied_locations=(first.location,) if first and first.location else (),
        candidates=(*effects[:1], *rivals, *effects[1:]),
        effects=effects,
        gap=gap,
        where=limbs.where(),
        n_tied=1 + len(rivals) if verdict == "ambiguous" else 0,
        next_experiment=_next(log),
        warnings=tuple(_limits(log, servos)),
        absorbed=tuple(_told_of_servos(servos)),
        changes=tuple(_changes(effects[:k]) for k in range(len(effects) + 1)),
    )


def _changes(effects: Sequence[Candidate]) -> RobotChanges:
    """Friction into the robot's description, beside what it has; the rest has no place there."""
    sizes = {(one.effect, one.location or ""): next(iter(one.parameters.values())).value for one in effects}
    viscous, coulomb = (
        {joint: value for (effect, joint), value in sizes.items() if effect == name}
        for name in ("viscous_friction", "coulomb_friction")
    )
    rest = tuple(
        f"{effect} at {joint}: {value:.4g}"
        for (effect, joint), value in sizes.items()
        if "friction" not in effect
    )
    return RobotChanges(viscous, coulomb, beyond=rest)


# What servos make of commands.


@dataclass(frozen=True, eq=False)
class _Servo:
    """The law that the torques of a joint follow.

    Attributes:
        joint: its joint.
        stated: gains that the log states, kp and kd, NaN where it does not.
        fitted: kp [N·m/rad], kd [N·m·s/rad], constant [N·m], delay [s].
        std: standard deviations of these.
        explained: share of the torque's power that the law explains.
        gap: of the torque [N·m or N]: what the stated law leaves, without a delay, what this one leaves, and the
            torque's own deviation.
        saturated: share of samples at the largest torque.
    """

    joint: str
    stated: Array
    fitted: Array
    std: Array
    explained: float
    gap: tuple[float, float, float]
    saturated: float


def _servos(log: Log) -> Iterator[_Servo]:
    """The servo of each joint, where commands are logged and the servo is one of positions."""
    if any(t.q_cmd is None or t.tau is None for t in log.trials):
        return
    said = log.header.controller
    if said and said.get("mode", "position") != "position":
        return
    stated = stated_servo(said, log.header.joints)
    for j, joint in enumerate(log.header.joints):
        if joint in log.header.no_torque:
            continue
        ways = [
            [gram for trial in log.trials for gram in _law_grams(trial, j, follows=follows)]
            for follows in stated.follows
        ]
        grams = min(ways, key=lambda way: _law(np.sum(way, axis=0)).left)
        whole = np.sum(grams, axis=0)
        fitted, left, power = _law(whole)
        parts = np.array([_law(whole - one).sizes for one in grams])
        std = np.sqrt((len(parts) - 1) * parts.var(axis=0))
        tau = np.concatenate([np.abs(t.tau[:, j]) for t in log.trials if t.tau is not None])
        count, told = float(whole[0][2, 2]), np.array([stated.kp[j], stated.kd[j], np.nan])
        usual = np.where(np.isnan(told), fitted[:3], told)
        meant = whole[0][3, 3] - 2.0 * usual @ whole[0][:3, 3] + usual @ whole[0][:3, :3] @ usual
        gap = [float(np.sqrt(max(x, 0.0) / count)) for x in (meant, left, power)]
        fitted[3] *= (step := _step(log))
        std[3] = np.hypot(std[3], 0.3) * step
        yield _Servo(
            joint,
            np.array([stated.kp[j], stated.kd[j]]),
            fitted,
            std,
            1.0 - left / max(power, 1e-300),
            (gap[0], gap[1], gap[2]),
            float((tau > 0.995 * tau.max()).mean()),
        )


def _step(log: Log) -> float:
    return float(np.median(np.diff(log.trials[0].time)))


def _law_grams(trial: Trial, j: int, *, follows: bool) -> Iterator[Array]:
    """By stretch and delay, ``(n_delays, 4, 4)`` products of the errors of position and velocity, one, and torque.

    ``follows`` says whether the servo damps the velocity's error; else it damps the velocity itself.
    """
    command, measured = trial.q_cmd, trial.tau
    if command is None or measured is None:
        return
    step = float(np.median(np.diff(trial.time)))
    delays = np.arange(1 + round(_LATEST_S / step))
    # The law is linear: filtered alike on both sides it holds, and the noise of velocities is less.
    cutoff = min(_CUTOFF_HZ, 0.2 / step)
    told = np.column_stack(
        [trial.q[:, j], trial.q[:, j] if trial.v is None else trial.v[:, j], measured[:, j]]
    )
    q, v, tau = lowpass(told, 1.0 / step, cutoff).T
    v = np.gradient(q, trial.time) if trial.v is None else v
    wanted = lowpass(command[:, [j]], 1.0 / step, cutoff)[:, 0]
    rows = np.arange(delays[-1], len(q))
    for part in np.array_split(rows, max(2, _BLOCKS // 2)):
        asked = np.column_stack([wanted, follows * np.gradient(wanted, trial.time)])
        moved, beside = np.column_stack([q, v])[part], np.column_stack([np.ones(len(part)), tau[part]])
        columns = [np.column_stack([asked[part - d] - moved, beside]) for d in delays]
        yield np.array([x.T @ x for x in columns])


class _Law(NamedTuple):
    """A servo's law: gains, constant and delay in samples ``(4,)``; what it leaves, and the torque's power."""

    sizes: Array
    left: float
    power: float


def _law(grams: Array) -> _Law:
    """Law of least squares over all delays."""
    left, sizes = [], []
    for gram in grams:
        x = np.linalg.lstsq(gram[:3, :3], gram[:3, 3], rcond=1e-12)[0]
        sizes.append(x)
        left.append(gram[3, 3] - x @ gram[:3, 3])
    best = int(np.argmin(left))
    between = 0.0
    if 0 < best < len(left) - 1:
        before, here, after = left[best - 1 : best + 2]
        between = 0.5 * (before - after) / max(before - 2.0 * here + after, 1e-300)
    mean = grams[best][2, 3] ** 2 / max(grams[best][2, 2], 1e-300)
    law = np.array([*sizes[best], best + between])
    return _Law(law, float(left[best]), float(grams[best][3, 3] - mean))


def _servo_effects(robot: Robot, servos: Sequence[_Servo]) -> Iterator[Candidate]:
    """Gains that are not the stated ones, or not those of the joint's kind, and delays, of one drive or of all."""
    follow = [servo for servo in servos if servo.explained > _FOLLOWS]
    if not follow:
        return
    kinds = _kinds(robot)
    gain, delay = _OF_SERVOS["kp"], _OF_SERVOS["delay"]
    late = np.array([servo.fitted[3] for servo in follow])
    common = float(np.median(late))
    ratios = []
    for servo in follow:
        alike = [other.fitted[0] for other in follow if kinds[other.joint] == kinds[servo.joint]]
        usual = servo.stated[0] if servo.stated[0] > 0.0 else float(np.median(alike))
        ratios.append((servo.fitted[0] / usual, servo.std[0] / usual))
    applied = float(np.median([ratio for ratio, _ in ratios]))
    spread = np.median([[std, servo.std[3]] for (_, std), servo in zip(ratios, follow, strict=True)], axis=0)
    if abs(applied - 1.0) > max(gain.least, _SURE * spread[0]):
        yield _effect(gain, "command", applied, spread[0], 1.0)
    else:
        applied = 1.0
    if common > max(delay.least, _SURE * spread[1]):
        yield _effect(delay, "command", common, spread[1], 0.0)
    else:
        common = 0.0
    for servo, (ratio, std) in zip(follow, ratios, strict=True):
        if abs(ratio - applied) > max(gain.least, _SURE * std):
            yield _effect(gain, servo.joint, ratio, std, applied)
        if abs(servo.fitted[3] - common) > max(delay.least, _SURE * servo.std[3]):
            yield _effect(delay, servo.joint, servo.fitted[3], servo.std[3], common)


def _effect(kind: Kind, place: str, value: float, std: float, usual: float) -> Candidate:
    size = Estimate(float(value), float(std), kind.unit)
    evidence = 0.5 * ((value - usual) / max(std, 1e-12)) ** 2
    return Candidate(
        kind.effect, place, {kind.parameter: size}, float(min(evidence, 1e6)), 0.0, 0.0, (place,)
    )


def _with_servos(gap: Gap, servos: Sequence[_Servo]) -> Gap:
    """The gap with a channel ``JOINT.servo`` for each servo: its torque beside what the stated law asks for."""
    follow = [servo for servo in servos if servo.explained > _FOLLOWS]
    parts = np.array([np.array(servo.gap[:2]) / max(servo.gap[2], 1e-12) for servo in follow]) ** 2
    old, n = np.array([gap.before, gap.after, gap.noise_floor]) ** 2, len(gap.per_channel)
    added = np.array([parts[:, 0].sum(), parts[:, 1].sum(), parts[:, 1].sum()])
    before, after, floor = (float(x) for x in np.sqrt((n * old + added) / (n + len(follow))))
    channels = {
        f"{servo.joint}.servo": ChannelGap(servo.gap[0], servo.gap[1], servo.gap[1]) for servo in follow
    }
    whole = {**gap.per_channel, **channels}
    return Gap(before, after, floor, share_closed(before, after, floor), whole)


def _told_of_servos(servos: Sequence[_Servo]) -> Iterator[Absorbed]:
    for servo in servos:
        for k, name, unit in ((0, "kp", "N·m/rad"), (1, "kd", "N·m·s/rad"), (3, "command_delay", "s")):
            value, std = float(servo.fitted[k]), float(servo.std[k])
            between = (value - 1.645 * std, value + 1.645 * std)
            yield Absorbed(servo.joint, name, Estimate(value, std, unit), between)


def _kinds(robot: Robot) -> dict[str, tuple[float, ...]]:
    """What joints of one kind have in common, left and right, fore and aft: depth, mass of the link, largest torque."""
    tree = read_tree(robot.model)
    kinds: dict[str, tuple[float, ...]] = {}
    for index, name in enumerate(tree.names):
        if name in robot.joint_names:
            depth, parent = 0, index
            while parent > 0:
                depth, parent = depth + 1, int(tree.parents[parent])
            mass = tree.phi[10 * (index - 1)]
            limit = robot.model.effortLimit[tree.idx_v[index]]
            kinds[name] = (depth, float(f"{mass:.2g}"), float(f"{limit:.3g}"))
    return kinds


def _with_asked_torques(log: Log) -> Log:
    """The log with the torques that the stated servo asks for; raises LogError."""
    servo = stated_servo(log.header.controller, log.header.joints)
    if np.isnan([*servo.kp, *servo.kd]).any():
        raise LogError(
            "neither torques nor the servo's gains are known",
            field="controller",
            remedy="state kp and kd of the policy's servos, or log their torque estimates as tau.*",
        )

    def asked(trial: Trial) -> Trial:
        if trial.q_cmd is None:
            raise LogError("has no commands", source=trial.name, field="q_cmd", remedy="log q_cmd.*")
        v = np.gradient(trial.q, trial.time, axis=0) if trial.v is None else trial.v
        return replace(trial, tau=servo.kp * (trial.q_cmd - trial.q) - servo.kd * v)

    header = log.header.model_copy(update={"torque": "motor_side"})
    return replace(log, header=header, trials=tuple(asked(t) for t in log.trials))


# What torques do to limbs.


class _Sized(NamedTuple):
    """Sizes of columns in units of their deviations, and their covariance."""

    size: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class _Limbs:
    """Rows of all joints, contact forces taken out, and the effects in them.

    Sizes are a posteriori means of a linear model with normal priors; which effects there are is what the selection of
    all records ascends to. Noise is that of a model with every column, in effective samples.

    Attributes:
        problem: its rows.
        columns: ``(n_rows, n)`` baseline first, then one an effect, in units of the prior's deviations.
        scales: ``(n,)`` these deviations.
        names: of the columns.
        n_base: number of the baseline's.
        target: ``(n_rows,)`` torque less that of the nominal robot.
        weight: ``(n_rows,)`` root of effective samples a row over the noise's deviation.
        learn: rows that are fitted on, by stretch.
        judge: ``(n_rows,)`` whether a row judges.
    """

    problem: IdentificationProblem
    columns: Array
    scales: Array
    names: tuple[tuple[str, str], ...]
    n_base: int
    target: Array
    weight: Array
    learn: tuple[Array, ...]
    judge: NDArray[np.bool_]

    @classmethod
    def of(cls, problem: IdentificationProblem, log: Log) -> _Limbs:
        """What the rows of a log's trials tell; terms of the problem are :data:`ROW_KINDS`."""
        n, drives = problem.n_inertial, problem.parameter_names[problem.n_inertial :]
        place = {name: n + k for k, name in enumerate(drives)}
        torque = np.concatenate([t.tau for t in log.trials if t.tau is not None])
        speed = np.concatenate([np.gradient(t.q, t.time, axis=0) for t in log.trials])
        load = dict(zip(log.header.joints, torque.std(axis=0), strict=True))
        fast = dict(zip(log.header.joints, np.maximum(speed.std(axis=0), 1e-3), strict=True))
        kinds = _kinds(problem.robot)
        blocks, scales, names = [], [], []
        if "rigid_body" in log.header.modelled:
            spread = likely_spread(read_tree(problem.robot.model))
            used = np.flatnonzero((spread > 0.0) & np.abs(problem.Y[:, :n]).any(axis=0))
            blocks.append(problem.Y[:, used])
            scales += list(spread[used])
            names += [("", "")] * len(used)
        # What joints of one kind share is the model's: friction, rotors, contacts that are not where it has them.
        for term in ROW_KINDS:
            for kind in dict.fromkeys(kinds.values()):
                alike = [place[f"{term}.{j}"] for j in problem.channel_names if kinds[j] == kind]
                if not alike:
                    continue
                column = problem.Y[:, alike].sum(axis=1, keepdims=True)
                blocks.append(column)
                scales.append(max(_scale(term, load[j], fast[j]) for j in problem.channel_names))
                names.append(("", ""))
        n_base = len(names)
        for term, kind_of in ROW_KINDS.items():
            for joint in problem.channel_names:
                alone = sum(kinds[j] == kinds[joint] for j in problem.channel_names) < 2
                if alone or not np.isfinite(kind_of.least):
                    continue
                column = problem.Y[:, [place[f"{term}.{joint}"]]]
                blocks.append(column)
                scales.append(_scale(term, load[joint], fast[joint]))
                names.append((term, joint))
        columns = np.hstack(blocks) * scales
        prior = problem.prior.copy()
        prior[n:] = 0.0
        target = problem.y - problem.Y @ prior
        validation = np.array([t.role == "validation" for t in log.trials])
        judge = validation[problem.trial] if validation.any() else np.ones(len(target), dtype=bool)
        fitted = (
            np.flatnonzero(~validation[problem.trial]) if not validation.all() else np.arange(len(target))
        )
        limbs = cls(
            problem,
            columns,
            np.array(scales),
            tuple(names),
            n_base,
            target,
            1.0 / _noise(problem, target),
            tuple(np.array_split(fitted, _BLOCKS)),
            judge,
        )
        return replace(limbs, weight=1.0 / _noise(problem, limbs.left(range(len(names)))))

    @cached_property
    def parts(self) -> list[tuple[Array, Array]]:
        """By stretch to learn on, weighted products of columns with each other and with the target."""
        made = []
        for rows in self.learn:
            x, y = self.columns[rows] * self.weight[rows, None], self.target[rows] * self.weight[rows]
            made.append((x.T @ x, x.T @ y))
        return made

    def fitted(self, chosen: Sequence[int], *, without: int | None = None) -> _Sized:
        """Columns fitted, a stretch left out."""
        kept = [part for k, part in enumerate(self.parts) if k != without]
        a = np.sum([part[0] for part in kept], axis=0)[np.ix_(chosen, chosen)] + np.eye(len(chosen))
        h = np.sum([part[1] for part in kept], axis=0)[list(chosen)]
        factor = cho_factor(a)
        return _Sized(cho_solve(factor, h), cho_solve(factor, np.eye(len(chosen))))

    def left(self, chosen: Sequence[int]) -> Array:
        """``(n_rows,)`` target less what chosen columns explain of it."""
        return np.asarray(self.target - self.columns[:, chosen] @ self.fitted(chosen).size)

    @cached_property
    def baseline(self) -> list[int]:
        """Columns that all models have."""
        return list(range(self.n_base))

    def _selection(self, barred: set[int]) -> sampler.Problem:
        """Which effects there are, all else integrated out; each pays for the choice among all."""
        gram, right = (np.sum(part, axis=0) for part in zip(*self.parts, strict=True))
        n, k = self.n_base, len(right) - self.n_base
        seen = np.linalg.solve(gram[:n, :n] + np.eye(n), np.column_stack([gram[:n, n:], right[:n]]))
        each, free = np.arange(k), np.full(k, 1e30)
        return sampler.Problem(
            gram=np.ascontiguousarray(gram[n:, n:] - gram[n:, :n] @ seen[:, :-1]),
            right=right[n:] - gram[n:, :n] @ seen[:, -1],
            precision=np.ones(k),
            constant=np.zeros(k),
            low=-free,
            high=free,
            mass=np.zeros(k),
            first=each,
            width=np.ones(k, dtype=np.int64),
            group=each,
            log_prior=np.where([n + i in barred for i in each], -np.inf, -np.log(k)),
            begin=each,
            n_atoms=np.ones(k, dtype=np.int64),
            needs=np.full(k, -1),
        )

    @cached_property
    def chosen(self) -> dict[int, float]:
        """Columns of effects and the evidence of each, most first; none that is small or leaves judging rows more."""
        barred: set[int] = set()
        while True:
            problem = self._selection(barred)
            mode = sampler.climb(problem, np.full(len(problem.first), -1))
            chosen = [self.n_base + int(a) for a in mode if a >= 0]
            gains = {k: self._gains(problem, [other for other in chosen if other != k])[k] for k in chosen}
            sizes = self.sizes([*self.baseline, *chosen])[0][self.n_base :]
            idle = {k for k, size in zip(chosen, sizes, strict=True) if not self._matters(k, size, gains)}
            if not idle:
                return dict(sorted(gains.items(), key=lambda item: -item[1]))
            barred |= idle

    def _gains(self, problem: sampler.Problem, others: Sequence[int]) -> dict[int, float]:
        """By column, evidence of an effect beside others."""
        state = np.full(len(problem.first), -1)
        inside = np.array(others, dtype=np.int64) - self.n_base
        state[inside] = inside
        return dict(enumerate(sampler.gains_beside(problem, state).tolist(), start=self.n_base))

    def _matters(self, k: int, size: float, chosen: Mapping[int, float]) -> bool:
        """Whether a size is one, and its joint's judging rows are clearly better for it."""
        term, joint = self.names[k]
        kind = ROW_KINDS[term]
        least = kind.least / kind.spread * self.scales[k]
        rest = [other for other in chosen if other != k]
        rows = self.judge & self.problem.rows_of(joint)
        with_it, without = (
            float((self.left([*self.baseline, *some])[rows] ** 2).sum()) for some in ([*rest, k], rest)
        )
        return abs(size) > least and with_it < _CLEAR * without

    def sizes(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Sizes in their units, with deviations: the larger of the equations' and of stretches left out."""
        whole, covariance = self.fitted(chosen)
        without = np.array([self.fitted(chosen, without=k).size for k in range(len(self.parts))])
        spread = np.sqrt((len(without) - 1) * without.var(axis=0))
        std = np.maximum(spread, np.sqrt(np.diagonal(covariance)))
        return whole * self.scales[chosen], std * self.scales[chosen]

    def effects(self) -> Iterator[Candidate]:
        """What was chosen."""
        columns = [*self.baseline, *self.chosen]
        sizes, stds = (x[self.n_base :] for x in self.sizes(columns))
        before = self.gap.before
        for (k, evidence), size, std in zip(self.chosen.items(), sizes, stds, strict=True):
            alone = self._gap([*self.baseline, k])
            share = share_closed(before, alone, self.gap.noise_floor)
            yield replace(
                self.candidate(k, float(size), float(std), evidence), gap_after=alone, share_closed=share
            )

    def candidate(self, k: int, size: float, std: float, evidence: float) -> Candidate:
        """An effect; torque that is lost reads as a gain of what is logged over what is delivered."""
        term, joint = self.names[k]
        kind = ROW_KINDS[term]
        parameters = {kind.parameter: Estimate(size, std, kind.unit)}
        if term == "lost":
            arrives = max(1.0 - size, 1e-3)
            parameters = {
                "gain": Estimate(1.0 / arrives, std / arrives**2, "1"),
                "delivered": Estimate(arrives, std, "1"),
            }
        return Candidate(kind.effect, joint, parameters, evidence, 0.0, 0.0, (joint,))

    def rivals(self) -> Iterator[Candidate]:
        """What could stand in the place of the first effect, beside the others, at odds of one to twenty."""
        first, *others = self.chosen
        for k, evidence in self._gains(self._selection(set()), others).items():
            if k not in self.chosen and evidence > self.chosen[first] - np.log(20.0):
                sizes, stds = self.sizes([*self.baseline, *others, k])
                yield self.candidate(k, float(sizes[-1]), float(stds[-1]), evidence)

    def _gap(self, columns: Sequence[int]) -> float:
        rows, left = self.judge, self.left(columns)
        shares = [
            (left[rows & self.problem.rows_of(j)] ** 2).mean()
            / max(self.problem.y[self.problem.rows_of(j)].var(), 1e-12)
            for j in self.problem.channel_names
        ]
        return float(np.sqrt(np.mean(shares)))

    @cached_property
    def gap(self) -> Gap:
        """Before any effect and with those chosen; the floor is what a model with every column leaves."""
        names, rows = self.problem.channel_names, self.judge
        models = (self.baseline, [*self.baseline, *self.chosen], list(range(len(self.names))))
        before, after, floor = (self._gap(columns) for columns in models)
        floor = min(before, after, floor)
        lefts = [self.left(columns) for columns in models]
        channels = {}
        for joint, unit in zip(names, self.problem.channel_units, strict=True):
            own = rows & self.problem.rows_of(joint)
            was, now, least = (float(np.sqrt((left[own] ** 2).mean())) for left in lefts)
            channels[joint] = ChannelGap(was, now, min(was, now, least), unit)
        return Gap(before, after, floor, share_closed(before, after, floor), channels)

    def where(self) -> tuple[Where, ...]:
        """Joints by their part of the gap."""
        power = {
            name: max(one.before**2 - one.noise_floor**2, 0.0) for name, one in self.gap.per_channel.items()
        }
        total = max(sum(power.values()), 1e-300)
        cutoff = self.problem.filters.cutoff_hz if self.problem.filters else 0.0
        lines = [Where(name, share / total, "none", (0.0, cutoff)) for name, share in power.items()]
        return tuple(sorted(lines, key=lambda line: -line.share))


def _noise(problem: IdentificationProblem, left: Array) -> Array:
    """``(n_rows,)`` deviation that each row counts with: of its joint's rest, as effective samples are fewer."""
    out = np.ones(len(left))
    for k in range(len(problem.channel_names)):
        rows = problem.channel == k
        count = float(count_effective_samples(left[rows, None], problem.trial[rows])[0])
        out[rows] = max(float(np.sqrt((left[rows] ** 2).mean())), 1e-9) * np.sqrt(rows.sum() / count)
    return out


def _scale(term: str, load: float, fast: float) -> float:
    """Standard deviation expected of a term: of friction and constants what makes a share of a joint's torque.

    Args:
        term: its name.
        load: deviation of the joint's torque [N·m or N].
        fast: deviation of its velocity [rad/s or m/s].
    """
    kind = ROW_KINDS[term]
    if not kind.unit.startswith("N"):
        return kind.spread
    return kind.spread * load / (fast if term == "viscous" else 1.0)


def _limits(log: Log, servos: Sequence[_Servo]) -> Iterator[str]:
    """What the record does not tell."""
    if not servos and any(t.q_cmd is None for t in log.trials):
        yield "no commands beside torques: whether gains are applied and commands are late is not told; log q_cmd.*"
    for servo in servos:
        if servo.explained <= _FOLLOWS:
            yield (
                f"{100 * servo.explained:.0f} % of the torque of {servo.joint} follows a servo's law of its command: "
                "another joint's command, a feedforward, or gains that change"
            )
        if servo.saturated > 0.01:
            yield f"the torque of {servo.joint} is saturated for {100 * servo.saturated:.1f} % of the time"
    if log.header.imu is None:
        yield "no IMU: the base's motion is that of its pose, differentiated twice"


def _next(log: Log) -> NextExperiment | None:
    """What would tell more than walking does."""
    if all(t.q_cmd is not None for t in log.trials):
        return None
    return NextExperiment(
        "the same walk with commands logged tells gains and delays", ("servo_gain", "command_delay")
    )
