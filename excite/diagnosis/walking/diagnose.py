"""Why a policy shakes, drifts or falls: what of a robot that walks is not as its simulator has it.

Three equations that do not know the forces at the feet: the servos' law (:mod:`excite.diagnosis.walking.servos`), the
limbs' rows, and the feet's, which stand still against each other while they carry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from excite.arrays import Array, distinct_rows, runs_of, widen_flags
from excite.diagnosis.answer.answer import Absorbed, Diagnosis, NextExperiment, Verdict
from excite.diagnosis.answer.candidate import Candidate, Estimate, RobotChanges
from excite.diagnosis.answer.gap import ChannelGap, Gap, Where, share_closed
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.selection import sampler
from excite.diagnosis.servo.gains import stated_servo
from excite.diagnosis.walking.kinds import (
    JITTER,
    LATE_IMU,
    OF_COMMANDS,
    ORDER,
    ROW_KINDS,
    SLIP,
    SURE,
    TURNED,
    Kind,
    joint_kinds,
)
from excite.diagnosis.walking.servos import Servo, command_ticks, highest_cutoff, read_servos, servo_effects
from excite.doctor.inertial_prior import count_effective_samples, likely_spread
from excite.errors import LogError
from excite.finding import list_names
from excite.identification.problem import IdentificationProblem, build_problem
from excite.logs.log import Log, Trial
from excite.regressor.contact_forces import contact_maps
from excite.regressor.tree import read_tree
from excite.robot.robot import Robot
from excite.rows.joint_rows import CHANGE_S, JointRows, closed_on_grid
from excite.rows.kinematics import trial_kinematics
from excite.rows.settings import ProblemSettings

# Feet that leave the ground more often, for longer than a flag flickers [s], step: those of a trot do eight times a
# second, of a G1 that walks slowly once in two seconds; a foot that is moved alone leaves it once in seven.
_STEPS_HZ, _FLICKER_S = 0.25, 0.05


def is_walking(log: Log) -> bool:
    """Whether a log is of a robot that steps, whose contact forces nobody measures; moving foot by foot is standing."""
    if log.header.base != "floating" or log.header.sensors:
        return False
    flags = [np.asarray(one, dtype=bool) for trial in log.trials for one in trial.contacts.values()]
    lifted = [end - start for one in flags for start, end in runs_of(~one)]
    steps = np.sum(np.array(lifted) > _FLICKER_S * log.header.rate_hz)
    return bool(steps > _STEPS_HZ * sum(float(t.time[-1] - t.time[0]) for t in log.trials))


def diagnose_walking(robot: Robot, log: Log) -> Diagnosis:
    """Diagnose a robot that walks, from commands, positions, torques, IMU and contact flags.

    Args:
        robot: the nominal model.
        log: the log; without torques the servo's gains have to be stated, and torques are what it asks for.

    Returns:
        The diagnosis; channels are joints.

    Raises:
        LogError: what the log has tells nothing of drives.
    """
    servos = read_servos(log) if log.header.torque in {"motor_side", "link_side"} else []
    if log.header.torque == "none":
        log = _with_asked_torques(log)
    limbs = Limbs.from_log(robot, log, choose_cutoff(robot, log))
    others = (*servo_effects(robot, log, servos), *_foot_effects(limbs.problem.robot, log))
    effects = tuple(sorted([*others, *limbs.chosen_effects()], key=lambda one: -one.evidence))
    rivals = tuple(limbs.find_rivals())
    at_servos = any(one.effect in OF_COMMANDS for one in effects)
    gap = _with_servos(limbs.gap, servos) if at_servos else limbs.gap
    first, untold = effects[0] if effects else None, list(_propose_recordings(log, servos, effects, rivals))
    verdict: Verdict = "none"
    if first is not None:
        verdict = "ambiguous" if rivals and first.effect not in {*OF_COMMANDS, SLIP.effect} else "effect"
    elif any(not servo.is_following for servo in servos):
        verdict = "unknown"
    return Diagnosis(
        robot=robot.name,
        verdict=verdict,
        effect=first.effect if first else None,
        location=first.location if first else None,
        tied_locations=first.tied_locations if first else (),
        candidates=(*effects[:1], *rivals, *effects[1:]),
        effects=effects,
        gap=gap,
        where=limbs.locate_gap(),
        n_tied=1 + len(rivals) if verdict == "ambiguous" else 0,
        next_experiment=untold[0] if untold else None,
        warnings=(*_list_limits(log, servos, effects), *(f"not told: {one.why}" for one in untold[1:])),
        absorbed=tuple(_told_of_servos(servos)),
        changes=tuple(_robot_changes(effects[:k]) for k in range(len(effects) + 1)),
    )


def _robot_changes(effects: Sequence[Candidate]) -> RobotChanges:
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


def _with_asked_torques(log: Log) -> Log:
    """The log with the torques that the stated servo asks for; raises LogError."""
    servo = stated_servo(log.header.controller, log.header.joints)
    if np.isnan([*servo.kp, *servo.kd]).any():
        raise LogError(
            "neither torques nor the servo's gains are known",
            field="controller",
            remedy="state kp and kd of the policy's servos, or log their torque estimates as tau.*",
        )

    def ask_torques(trial: Trial) -> Trial:
        if trial.q_cmd is None:
            raise LogError("has no commands", source=trial.name, field="q_cmd", remedy="log q_cmd.*")
        v = np.gradient(trial.q, trial.time, axis=0) if trial.v is None else trial.v
        return replace(trial, tau=servo.kp * (trial.q_cmd - trial.q) - servo.kd * v)

    header = log.header.model_copy(update={"torque": "motor_side"})
    return replace(log, header=header, trials=tuple(ask_torques(t) for t in log.trials))


def _with_servos(gap: Gap, servos: Sequence[Servo]) -> Gap:
    """The gap with a channel ``JOINT.servo`` for each servo: its torque beside what the stated law asks for."""
    follow = [servo for servo in servos if servo.is_told]
    parts = np.array([np.array(servo.gap[:2]) / max(servo.gap[2], 1e-12) for servo in follow]) ** 2
    old, n = np.array([gap.before, gap.after, gap.noise_floor]) ** 2, len(gap.per_channel)
    added = np.array([parts[:, 0].sum(), parts[:, 1].sum(), parts[:, 1].sum()])
    before, after, floor = (float(x) for x in np.sqrt((n * old + added) / (n + len(follow))))
    channels = {
        f"{servo.joint}.servo": ChannelGap(servo.gap[0], servo.gap[1], servo.gap[1]) for servo in follow
    }
    whole = {**gap.per_channel, **channels}
    return Gap(before, after, floor, share_closed(before, after, floor), whole)


def _told_of_servos(servos: Sequence[Servo]) -> Iterator[Absorbed]:
    for servo in servos:
        if not servo.is_told:
            continue
        sizes, stds = servo.estimate_sizes(np.ones(2))
        for k, name, unit in ((0, "kp", "N·m/rad"), (1, "kd", "N·m·s/rad"), (4, "command_delay", "s")):
            value, std = float(sizes[k]), float(stds[k])
            between = (value - 1.645 * std, value + 1.645 * std)
            yield Absorbed(servo.joint, name, Estimate(value, std, unit), between)


def _list_limits(log: Log, servos: Sequence[Servo], effects: Sequence[Candidate]) -> Iterator[str]:
    """What limits the answer, but for what another recording would tell."""
    for one in effects:
        if one.effect == ORDER.effect:
            command = log.header.joints[round(one.parameters[ORDER.parameter].value)]
            yield (
                f"the torque of {one.location} follows the command of {command}: "
                "the policy and the robot order their joints differently, or two cables are exchanged"
            )
    for servo in servos:
        if not servo.is_following:
            yield (
                f"{100 * servo.unexplained:.0f} % of the torque of {servo.joint} follows no servo's law of a command: "
                "a feedforward, or gains that change"
            )
        if np.isfinite(servo.limit):
            yield f"the torque of {servo.joint} is cut at {servo.limit:.3g} for {100 * servo.cut:.1f} % of the time"
    if log.header.imu is None:
        yield "no IMU: the base's motion is that of its pose, differentiated twice"


def _propose_recordings(
    log: Log, servos: Sequence[Servo], effects: Sequence[Candidate], rivals: Sequence[Candidate]
) -> Iterator[NextExperiment]:
    """What this walk cannot tell, and which seconds would."""
    joints = dict.fromkeys(
        str(one.location) for one in (*effects[:1], *rivals) if rivals and one.location in log.header.joints
    )
    if rivals:
        swung = f"{list_names(list(joints))} alone swings" if joints else "its trunk is tilted by hand"
        yield NextExperiment(
            f"what could stand in the place of the first effect is told by ten seconds in which {swung}, slowly and "
            "fast, the robot hung up (base: suspended)",
            tuple(f"{one.effect}@{one.location}" for one in rivals),
        )
    tied = [one for one in effects if len(one.tied_locations) > 1]
    if tied:
        yield NextExperiment(
            "which of the feet slips is told by ten seconds in which the robot stands on all feet and leans about",
            tuple(f"{one.effect}@{one.location}" for one in tied),
        )
    if not servos:
        yield NextExperiment(
            "whether gains are applied and commands late is told by a walk with q_cmd.* and tau.* logged",
            tuple(sorted(OF_COMMANDS)),
        )
    elif not all(len(command_ticks(trial)) for trial in log.trials):
        yield NextExperiment(
            "jitter of the commands is told by ten seconds logged at several times the policy's rate, q_cmd.* as sent",
            (JITTER.effect,),
        )
    if any(trial.imu is None for trial in log.trials):
        yield NextExperiment(
            "mounting and delay of the IMU are told by ten seconds of walking and turning with imu.* logged",
            (TURNED.effect, LATE_IMU.effect),
        )


# Feet that carry stand still against each other: where one does not, it slips.
#
# What contact points move by, ``Jᵀ [0; ω; q̇]``, is known up to the trunk's linear velocity, which all share. Of three
# and more the one that moves against the others slips; of two that carry alone either may.

# Of a simulated trot on a floor of friction 0.6 feet that carry move by less for 97 % of the time [m/s]: they roll, and
# touch and leave.
_SLIDES = 0.15
_STRETCHES = 10


def _foot_effects(robot: Robot, log: Log) -> Iterator[Candidate]:
    """Feet that slip for a larger share of the time in which they carry than the others do, or all of them."""
    names = [foot.name for foot in robot.feet]
    speed = np.concatenate([_foot_speeds(robot, log, trial) for trial in log.trials])
    parts = [part for part in np.array_split(speed, _STRETCHES) if (~np.isnan(part)).any(axis=0).all()]
    if len(names) < 2 or len(parts) < _STRETCHES // 2:
        return
    shares = np.array(
        [np.nanmean(np.where(np.isnan(part), np.nan, part > _SLIDES), axis=0) for part in parts]
    )
    share, std = shares.mean(axis=0), shares.std(axis=0) / np.sqrt(len(shares)) + 1e-3
    usual = float(np.median(share))
    if usual > SLIP.least:
        yield SLIP.make_candidate("feet", usual, float(np.median(std)))
    clear = share - usual > np.maximum(SLIP.least, SURE * std)
    for k in np.flatnonzero(clear):
        alike = tuple(name for i, name in enumerate(names) if clear[i] and abs(share[i] - share[k]) < std[k])
        fast = Estimate(float(np.nanmedian(speed[speed[:, k] > _SLIDES, k])), None, "m/s")
        named = SLIP.make_candidate(names[k], share[k], std[k], usual=usual)
        yield replace(named, parameters={**named.parameters, "speed": fast}, tied_locations=alike)


def _foot_speeds(robot: Robot, log: Log, trial: Trial) -> Array:
    """Speeds at which feet that carry move along the ground against the others, ``(n, n_feet)`` [m/s]; else NaN."""
    settings = ProblemSettings(cutoff_hz=highest_cutoff(log.header.rate_hz))
    filters = settings.filters(floating=False, lowpass_hz=log.header.lowpass_hz)
    k = trial_kinematics(robot, log.header, trial, settings, filters)
    closed, still = closed_on_grid(robot, trial, k.time), k.v.copy()
    changes = np.zeros(len(closed), dtype=bool)
    changes[1:] = (closed[1:] != closed[:-1]).any(axis=1)
    use = k.valid & ~widen_flags(changes, round(CHANGE_S * k.rate_hz))
    still[:, :3] = 0.0
    out = np.full(closed.shape, np.nan)
    patterns, member = distinct_rows(closed)
    for i, pattern in enumerate(patterns):
        at, feet = np.flatnonzero((member == i) & use), np.flatnonzero(pattern)
        if len(feet) < 2 or not len(at):
            continue
        # A foot's first point, or a sole's ankle, moves by the first three numbers of its map.
        maps = [contact_maps(robot, k.q[at], [robot.feet[f]])[:, :, :2] for f in feet]
        moved = np.stack([np.einsum("nvk,nv->nk", own, still[at]) for own in maps], axis=1)
        against = moved[:, ::-1] if len(feet) == 2 else np.median(moved, axis=1, keepdims=True)
        out[at[:, None], feet] = np.linalg.norm(moved - against, axis=2)
    return out


# What torques do to the limbs: joints' rows with the forces at the feet taken out.
#
# Joints of one kind, left and right, share what the model has (:mod:`excite.regressor.contact_forces` says how forces
# go); a joint's own is an effect: torque that does not arrive, friction, zeros of encoders. So are readings of the
# IMU, which tells how the base moves, from another frame or late.

# Stretches by which sizes are told anew, each left out once.
_BLOCKS = 10
# Delays of the IMU that are tried [s]: of each the change of the rows is exact there.
_IMU_DELAYS = tuple(0.002 * k for k in range(2, 13))


class Atom(NamedTuple):
    """An effect, or one form of it.

    Attributes:
        kind: what it is.
        place: joint, or ``imu``.
        first: its first column, counted among effects'.
        width: number of its columns.
        shared: column of the baseline, what all joints of the place's kind have of it; None of the IMU's.
    """

    kind: Kind
    place: str
    first: int
    width: int
    shared: int | None = None

    @property
    def group(self) -> tuple[str, str]:
        """Forms of one effect exclude each other."""
        return self.kind.effect, self.place


class _FittedSizes(NamedTuple):
    """Sizes of columns in units of their deviations, and their covariance."""

    size: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Limbs:
    """Rows of all joints, contact forces taken out, and the effects in them.

    Sizes are a posteriori means of a linear model with normal priors; which effects there are is what the selection of
    all records ascends to. Noise is that of a model with every column, in effective samples.

    Attributes:
        problem: its rows.
        columns: ``(n_rows, n)`` baseline first, then effects', in units of the prior's deviations.
        scales: ``(n,)`` these deviations.
        atoms: the effects, forms of one beside each other.
        n_base: number of the baseline's columns.
        target: ``(n_rows,)`` torque less that of the nominal robot.
        weight: ``(n_rows,)`` root of effective samples a row over the noise's deviation.
        learn: rows that are fitted on, by stretch.
        judge: ``(n_rows,)`` whether a row judges.
    """

    problem: IdentificationProblem
    columns: Array
    scales: Array
    atoms: tuple[Atom, ...]
    n_base: int
    target: Array
    weight: Array
    learn: tuple[Array, ...]
    judge: NDArray[np.bool_]

    @classmethod
    def from_log(cls, robot: Robot, log: Log, cutoff_hz: float) -> Limbs:
        """What the rows of a log's trials tell, filtered at a frequency."""
        settings = ProblemSettings(cutoff_hz=cutoff_hz, drive_terms=tuple(ROW_KINDS))
        problem = build_problem(robot, log, settings, role=None)
        n, drives = problem.n_inertial, problem.parameter_names[problem.n_inertial :]
        place = {name: n + k for k, name in enumerate(drives)}
        torque = np.concatenate([t.tau for t in log.trials if t.tau is not None])
        speed = np.concatenate([np.gradient(t.q, t.time, axis=0) for t in log.trials])
        load = dict(zip(log.header.joints, torque.std(axis=0), strict=True))
        fast = dict(zip(log.header.joints, np.maximum(speed.std(axis=0), 1e-3), strict=True))
        kinds = joint_kinds(problem.robot)
        blocks, scales, atoms = [np.zeros((problem.n_rows, 0))], [], []
        if "rigid_body" in log.header.modelled:
            spread = likely_spread(read_tree(problem.robot.model))
            used = np.flatnonzero((spread > 0.0) & np.abs(problem.Y[:, :n]).any(axis=0))
            blocks.append(problem.Y[:, used])
            scales += list(spread[used])
        alike = [
            [j for j in problem.channel_names if kinds[j] == kind] for kind in dict.fromkeys(kinds.values())
        ]
        # What joints of one kind share is the model's: friction, rotors, contacts that are not where it has them.
        shared = {(term, joints[0]): joints for term in ROW_KINDS for joints in alike if joints}
        for (term, _), joints in shared.items():
            blocks.append(problem.Y[:, [place[f"{term}.{j}"] for j in joints]].sum(axis=1, keepdims=True))
            scales.append(max(_expected_scale(term, load[j], fast[j]) for j in problem.channel_names))
        n_base = len(scales)
        for column, ((term, _), joints) in enumerate(shared.items(), n_base - len(shared)):
            for joint in joints if len(joints) > 1 and np.isfinite(ROW_KINDS[term].least) else ():
                atoms.append(Atom(ROW_KINDS[term], joint, len(scales) - n_base, 1, column))
                blocks.append(problem.Y[:, [place[f"{term}.{joint}"]]])
                scales.append(_expected_scale(term, load[joint], fast[joint]))
        readings = list(_imu_readings(log))
        for reading in readings:
            atoms.append(Atom(reading.kind, "imu", len(scales) - n_base, len(reading.changes)))
            scales += [reading.kind.spread] * len(reading.changes)
        if readings:
            blocks.append(_row_changes(problem, log, settings, readings))
        columns = np.hstack(blocks) * scales
        target = problem.y - problem.Y @ problem.prior
        validation = np.array([t.role == "validation" for t in log.trials])
        judge = validation[problem.trial] if validation.any() else np.ones(len(target), dtype=bool)
        fitted = (
            np.flatnonzero(~validation[problem.trial]) if not validation.all() else np.arange(len(target))
        )
        limbs = cls(
            problem,
            columns,
            np.array(scales),
            tuple(atoms),
            n_base,
            target,
            1.0 / _row_noise(problem, target),
            tuple(np.array_split(fitted, _BLOCKS)),
            judge,
        )
        return replace(limbs, weight=1.0 / _row_noise(problem, limbs.residual_rows(range(len(scales)))))

    @cached_property
    def learning_products(self) -> list[tuple[Array, Array]]:
        """By stretch to learn on, weighted products of columns with each other and with the target."""
        made = []
        for rows in self.learn:
            x, y = self.columns[rows] * self.weight[rows, None], self.target[rows] * self.weight[rows]
            made.append((x.T @ x, x.T @ y))
        return made

    def fit_columns(self, columns: Sequence[int], *, without: int | None = None) -> _FittedSizes:
        """Columns fitted, a stretch left out."""
        kept = [part for k, part in enumerate(self.learning_products) if k != without]
        a = np.sum([part[0] for part in kept], axis=0)[np.ix_(columns, columns)] + np.eye(len(columns))
        h = np.sum([part[1] for part in kept], axis=0)[list(columns)]
        factor = cho_factor(a)
        return _FittedSizes(cho_solve(factor, h), cho_solve(factor, np.eye(len(columns))))

    def residual_rows(self, columns: Sequence[int]) -> Array:
        """``(n_rows,)`` target less what columns explain of it."""
        return np.asarray(self.target - self.columns[:, columns] @ self.fit_columns(columns).size)

    def with_atoms(self, atoms: Sequence[int]) -> list[int]:
        """Columns of the baseline, then of atoms."""
        chosen = [self.atoms[k] for k in atoms]
        own = [self.n_base + atom.first + i for atom in chosen for i in range(atom.width)]
        return [*range(self.n_base), *own]

    def _selection_problem(self, barred: set[int]) -> sampler.Problem:
        """Which effects there are, all else integrated out; each pays for the choice among all."""
        gram, right = (np.sum(part, axis=0) for part in zip(*self.learning_products, strict=True))
        n, k, atoms = self.n_base, len(right) - self.n_base, self.atoms
        seen = np.linalg.solve(gram[:n, :n] + np.eye(n), np.column_stack([gram[:n, n:], right[:n]]))
        free, groups = np.full(k, 1e30), list(dict.fromkeys(atom.group for atom in atoms))
        group = np.array([groups.index(atom.group) for atom in atoms])
        count = np.bincount(group)
        odds = -np.log(len(groups)) - np.log(count[group])
        return sampler.Problem(
            gram=np.ascontiguousarray(gram[n:, n:] - gram[n:, :n] @ seen[:, :-1]),
            right=right[n:] - gram[n:, :n] @ seen[:, -1],
            precision=np.ones(k),
            constant=np.zeros(k),
            low=-free,
            high=free,
            mass=np.zeros(k),
            first=np.array([atom.first for atom in atoms]),
            width=np.array([atom.width for atom in atoms]),
            group=group,
            log_prior=np.where([i in barred for i in range(len(atoms))], -np.inf, odds),
            begin=np.searchsorted(group, np.arange(len(groups))),
            n_atoms=count,
            needs=np.full(len(groups), -1),
        )

    @cached_property
    def chosen_atoms(self) -> dict[int, float]:
        """Atoms of effects and the evidence of each, most first; none that is small or leaves judging rows more."""
        barred: set[int] = set()
        while True:
            problem = self._selection_problem(barred)
            mode = sampler.find_mode(problem, np.full(len(problem.begin), -1))
            chosen = [int(a) for a in mode if a >= 0]
            gains = {
                k: self._atom_gains(problem, [other for other in chosen if other != k])[k] for k in chosen
            }
            idle = {k for k in chosen if not self._is_significant(k, chosen)}
            if not idle:
                return {self._likelier_side(k): gains[k] for k in sorted(gains, key=lambda k: -gains[k])}
            # One after the other, the faintest first: what stands beside the true one takes its part until it goes.
            barred.add(min(idle, key=lambda k: gains[k]))

    def _likelier_side(self, k: int) -> int:
        """The atom, or that of the other side where it is likelier there."""
        fellow = self._fellow(k)
        return k if fellow is None or self._side_evidence(k) >= self._side_evidence(fellow) else fellow

    def _fellow(self, k: int) -> int | None:
        """The same effect at the only other joint of a kind; None where there are more, or none."""
        atom = self.atoms[k]
        alike = [
            i for i, one in enumerate(self.atoms) if one.shared == atom.shared and one.shared is not None
        ]
        return next(i for i in alike if i != k) if len(alike) == 2 else None

    def _side_evidence(self, k: int) -> float:
        """Log evidence of an effect of one of two joints alone, but for a constant.

        Beside what both share, a joint that is weak looks like another that is strong. That the model is right in the
        other needs one parameter less.
        """
        columns = [column for column in self.with_atoms([k]) if column != self.atoms[k].shared]
        size, covariance = self.fit_columns(columns)
        gain = 0.5 * float(size @ np.linalg.solve(covariance, size))
        return gain + 0.5 * float(np.linalg.slogdet(covariance)[1])

    def _atom_gains(self, problem: sampler.Problem, others: Sequence[int]) -> dict[int, float]:
        """By atom, evidence of an effect beside others."""
        state = np.full(len(problem.begin), -1)
        state[problem.group[list(others)]] = list(others)
        return dict(enumerate(sampler.gains_beside(problem, state).tolist()))

    def _is_significant(self, k: int, chosen: Sequence[int]) -> bool:
        """Whether a size is one, and the judging rows that it acts on are clearly better for it."""
        atom, rest = self.atoms[k], [other for other in chosen if other != k]
        least = atom.kind.least / atom.kind.spread * self.scales[self.n_base + atom.first]
        size, std = (float(np.linalg.norm(part[-atom.width :])) for part in self.estimate_sizes([*rest, k]))
        names = self.problem.channel_names
        rows = self.judge & (self.problem.rows_of(atom.place) if atom.place in names else True)
        with_it, without = (
            float((self.residual_rows(self.with_atoms(some))[rows] ** 2).sum()) for some in ([*rest, k], rest)
        )
        return size > max(least, SURE * std) and (1.0 + THRESHOLDS.trifle) * with_it < without

    def estimate_sizes(self, atoms: Sequence[int]) -> tuple[Array, Array]:
        """Sizes of atoms' columns, with deviations: the larger of the equations' and of stretches left out."""
        columns = self.with_atoms(atoms)
        whole, covariance = self.fit_columns(columns)
        without = np.array(
            [self.fit_columns(columns, without=k).size for k in range(len(self.learning_products))]
        )
        spread = np.sqrt((len(without) - 1) * without.var(axis=0))
        std = np.maximum(spread, np.sqrt(np.diagonal(covariance)))
        scales = self.scales[columns]
        return (whole * scales)[self.n_base :], (std * scales)[self.n_base :]

    def chosen_effects(self) -> Iterator[Candidate]:
        """What was chosen."""
        before = self.gap.before
        for k, evidence in self.chosen_atoms.items():
            alone = self._relative_gap(self.with_atoms([k]))
            share = share_closed(before, alone, self.gap.noise_floor)
            named = self.make_candidate(k, [other for other in self.chosen_atoms if other != k], evidence)
            yield replace(named, gap_after=alone, share_closed=share)

    def make_candidate(self, k: int, others: Sequence[int], evidence: float) -> Candidate:
        """An effect beside others; torque that is lost reads as a gain of what is logged over what is delivered."""
        atom = self.atoms[k]
        sizes, stds = (part[-atom.width :] for part in self.estimate_sizes([*others, k]))
        kind, size, std = atom.kind, float(sizes[0]), float(stds[0])
        parameters = {kind.parameter: Estimate(size, std, kind.unit)}
        if atom.width == 3:
            parameters = {
                f"{kind.parameter}_{axis}": Estimate(float(s), float(d), kind.unit)
                for axis, s, d in zip("xyz", sizes, stds, strict=True)
            }
        if kind.term == "gain":
            arrives, std = self._delivered_share(atom, size, std)
            parameters = {
                "gain": Estimate(1.0 / arrives, std / arrives**2, "1"),
                "delivered": Estimate(arrives, std, "1"),
            }
        return Candidate(kind.effect, atom.place, parameters, evidence, 0.0, 0.0, (atom.place,))

    def _delivered_share(self, atom: Atom, error: float, std: float) -> tuple[float, float]:
        """Share of a logged torque that arrives and its deviation, from the error of the gain on what rows predict.

        Of a torque's error contacts leave its row a share f, so that the row predicts ``1 − f x`` of a logged torque of
        which x is lost: the error is ``x / (1 − f x)``.
        """
        problem, own = self.problem, np.flatnonzero(self.problem.rows_of(atom.place))
        free = 1.0
        if problem.freedom is not None:
            # The rows of an instant tell it together, each by its weight.
            instants = np.unique([problem.trial, problem.time], axis=1, return_inverse=True)
            instant = instants[1].ravel()
            power = np.bincount(instant, (self.weight * self.columns[:, self.n_base + atom.first]) ** 2)
            free = float(np.average(problem.freedom[own], weights=power[instant[own]]))
        through = max(1.0 + free * error, 1e-3)
        return max(1.0 - error / through, 1e-3), std / through**2

    def find_rivals(self) -> Iterator[Candidate]:
        """What could stand in the place of the first effect, beside the others, at odds of one to twenty."""
        if not self.chosen_atoms:
            return
        first, *others = self.chosen_atoms
        taken = {self.atoms[k].group for k in self.chosen_atoms}
        for k, evidence in self._atom_gains(self._selection_problem(set()), others).items():
            if k == self._fellow(first):
                evidence += self._side_evidence(k) - self._side_evidence(first)
            if self.atoms[k].group not in taken and evidence > self.chosen_atoms[first] - np.log(20.0):
                yield self.make_candidate(k, others, evidence)

    def _relative_gap(self, columns: Sequence[int]) -> float:
        rows, left = self.judge, self.residual_rows(columns)
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
        models = (self.with_atoms([]), self.with_atoms([*self.chosen_atoms]), list(range(len(self.scales))))
        before, after, floor = (self._relative_gap(columns) for columns in models)
        floor = min(before, after, floor)
        lefts = [self.residual_rows(columns) for columns in models]
        channels = {}
        for joint, unit in zip(names, self.problem.channel_units, strict=True):
            own = rows & self.problem.rows_of(joint)
            was, now, least = (float(np.sqrt((left[own] ** 2).mean())) for left in lefts)
            channels[joint] = ChannelGap(was, now, min(was, now, least), unit)
        return Gap(before, after, floor, share_closed(before, after, floor), channels)

    def locate_gap(self) -> tuple[Where, ...]:
        """Joints by their part of the gap."""
        power = {
            name: max(one.before**2 - one.noise_floor**2, 0.0) for name, one in self.gap.per_channel.items()
        }
        total = max(sum(power.values()), 1e-300)
        cutoff = self.problem.filters.cutoff_hz if self.problem.filters else 0.0
        lines = [Where(name, share / total, "none", (0.0, cutoff)) for name, share in power.items()]
        return tuple(sorted(lines, key=lambda line: -line.share))


# Readings of the IMU, as they would be were it turned or late.


Change = Callable[[Array, Array], Array]
"""From times ``(n,)`` [s] and readings ``(n, 6)`` of the IMU to what they would be."""


class _ImuChange(NamedTuple):
    """Changes of the IMU's readings, each with the size that it is of."""

    kind: Kind
    changes: tuple[tuple[Change, float], ...]


def _imu_readings(log: Log) -> Iterator[_ImuChange]:
    """Effects of the IMU, where a log has one."""
    if any(trial.imu is None for trial in log.trials):
        return
    yield _ImuChange(TURNED, tuple((_turn_imu(turn), TURNED.least) for turn in np.eye(3) * TURNED.least))
    for delay in _IMU_DELAYS:
        yield _ImuChange(LATE_IMU, ((_shift_readings(delay), delay),))


def _turn_imu(turn: Array) -> Change:
    """Readings of an IMU that is turned by a rotation vector, in the frame that it is said to have."""
    back = Rotation.from_rotvec(turn).as_matrix().T
    return lambda _, imu: np.hstack([imu[:, :3] @ back, imu[:, 3:] @ back])


def _shift_readings(delay: float) -> Change:
    """Readings that a log tells so much later [s]."""
    return lambda time, imu: np.column_stack([np.interp(time + delay, time, column) for column in imu.T])


def _row_changes(
    problem: IdentificationProblem, log: Log, settings: ProblemSettings, readings: Sequence[_ImuChange]
) -> Array:
    """Change of the rows per unit of each change of the readings, ``(n_rows, n_changes)``."""
    robot, filters = problem.robot, settings.filters(floating=False, lowpass_hz=log.header.lowpass_hz)
    builder = JointRows(robot, log.header, settings, filters, tuple(ROW_KINDS))
    changes = [change for reading in readings for change in reading.changes]
    parts = []
    for trial in log.trials:
        imu = np.zeros((len(trial.time), 6)) if trial.imu is None else trial.imu
        trials = [trial, *(replace(trial, imu=change(trial.time, imu)) for change, _ in changes)]
        k, *others = (trial_kinematics(robot, log.header, one, settings, filters) for one in trials)
        rows = builder.change(trial, k, others)
        parts.append(rows.values[np.nonzero(rows.use)] / [size for _, size in changes])
    return np.asarray(np.concatenate(parts))


def choose_cutoff(robot: Robot, log: Log) -> float:
    """Cut-off of the rows' filter at which the nominal robot leaves the least share of the torques' power [Hz].

    Steps are sharp, and what a low filter smears over a change of contacts is in no model; noise of the base's
    acceleration and of the joints' grows with the square of the frequency.
    """
    highest = highest_cutoff(log.header.rate_hz)
    return min((highest / 2**k for k in range(4)), key=lambda cutoff: _nominal_misfit(robot, log, cutoff))


def _nominal_misfit(robot: Robot, log: Log, cutoff_hz: float) -> float:
    """Power that the nominal robot leaves of torques over these, mean over joints; infinite without rows."""
    settings = ProblemSettings(cutoff_hz=cutoff_hz)
    filters, left, whole = settings.filters(floating=False, lowpass_hz=log.header.lowpass_hz), [], []
    builder = JointRows(robot, log.header, settings, filters, ())
    for trial in log.trials:
        rows = builder.nominal(trial, trial_kinematics(robot, log.header, trial, settings, filters))
        values = rows.values[rows.use.all(axis=1)]
        left.append(values[:, :, 1] - values[:, :, 0])
        whole.append(values[:, :, 1])
    if min(map(len, whole)) < _BLOCKS:
        return np.inf
    torque = np.concatenate(whole)
    return float(np.mean((np.concatenate(left) ** 2).mean(axis=0) / np.maximum(torque.var(axis=0), 1e-12)))


def _row_noise(problem: IdentificationProblem, left: Array) -> Array:
    """``(n_rows,)`` deviation that each row counts with: of its joint's rest, as effective samples are fewer."""
    out = np.ones(len(left))
    for k in range(len(problem.channel_names)):
        rows = problem.channel == k
        count = float(count_effective_samples(left[rows, None], problem.trial[rows])[0])
        out[rows] = max(float(np.sqrt((left[rows] ** 2).mean())), 1e-9) * np.sqrt(rows.sum() / count)
    return out


def _expected_scale(term: str, load: float, fast: float) -> float:
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
