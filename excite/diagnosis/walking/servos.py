"""What servos of a robot that walks make of their commands.

The law ``τ(t) = k_p (s·q_cmd(t − d) + o − q) − k_d v`` of each joint, where commands and torques are logged, knows
nothing of the forces at the feet: gains that are not applied, commands that arrive late, scaled, about another pose or
at another joint, and torques that are cut.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, jackknife_std, widen_flags
from excite.diagnosis.answer.candidate import Candidate
from excite.diagnosis.servo.gains import stated_servo
from excite.diagnosis.walking.kinds import JITTER, ORDER, SATURATION, SERVO_KINDS, SURE, joint_kinds
from excite.logs.log import Log, Trial
from excite.logs.quantisation import channel_noise
from excite.logs.signals.butterworth import lowpass, noise_bandwidth
from excite.robot.robot import Robot

# Steps are sharp: of a simulated trot rows filtered at 5, 10, 20 and 40 Hz leave the true robot 15, 11, 6 and 3 % of
# its torques. Logs that are too slow for it take less.
_CUTOFF_HZ = 40.0
# Stretches of a trial by which sizes are told anew, each left out once.
_STRETCHES = 5
# Commands are looked for that much earlier [s].
_LATEST_S = 0.1
# Share of a torque's power that a servo's law explains where the joint has such a servo.
_FOLLOWS = 0.8
# Rows for which commands are held, and ticks, that their jitter is told by.
_HELD, _FEWEST_TICKS = 4, 20
# Power that the stated law leaves of a drive's torque over that which a fitted one leaves, from which the drive has a
# law of its own: of a G1's walks without jitter healthy drives had 1.02 at most, those with a fault 18 and more.
_OWN = 2.0
# Torques pile up at a limit: they stray from it by less than this share of the power that is asked beyond it.
_PILED = 0.2
# Share of samples at the largest torque that is worth a name; times that a law and its limit are told by each other.
_CUT_OFTEN, _TIMES = 0.005, 3


Indices = NDArray[np.int64]


def highest_cutoff(rate_hz: float) -> float:
    """Cut-off of filters of what steps move, by the log's rate [Hz]."""
    return min(_CUTOFF_HZ, 0.2 * rate_hz)


class CommandPath(NamedTuple):
    """What a servo follows: the command of a joint, by its column, and whether its rate as well."""

    column: int
    rate: bool


class _Law(NamedTuple):
    """A servo's law: kp, kd, constant, the command beyond kp, its blur, delay in samples ``(6,)``; its rest.

    Attributes:
        left: what it leaves of the torque's power.
        power: of the torque, with noise.
        noise: of which is the torque's noise.
    """

    sizes: Array
    left: float
    power: float
    noise: float

    @property
    def r_squared(self) -> float:
        """Share of the torque's power that it explains."""
        return 1.0 - self.left / max(self.power, 1e-300)

    @property
    def unexplained(self) -> float:
        """Share that neither it nor noise explains."""
        return max(self.left - self.noise, 0.0) / max(self.power, 1e-300)


@dataclass(frozen=True, eq=False)
class Servo:
    """The law that the torques of a joint follow.

    Attributes:
        joint: its joint.
        way: the command that it follows.
        law: kp [N·m/rad], kd [N·m·s/rad], constant [N·m], share of the command beyond kp [N·m/rad], its blur
            [N·m·s²/rad] (in the mean delays that scatter add a command's second derivative), delay [samples].
        parts: ``(n_stretches, 6)`` the same with a stretch left out.
        stated: gains that the log states, kp and kd, NaN where it does not.
        excess: by delay of the command, power that the stated law leaves over what this one does, ``(n_delays,)``.
        explained: share of the torque's power that the law explains.
        unexplained: share that neither the law nor the torque's noise explains.
        gap: of the torque [N·m or N]: what the stated law leaves, without a delay, what this one leaves, and the
            torque's own deviation.
        limit: torque beyond which it is cut [N·m], infinite where it is not.
        cut: share of samples that are.
        step: between samples [s].
    """

    joint: str
    way: CommandPath
    law: Array
    parts: Array
    stated: Array
    excess: Array
    explained: float
    unexplained: float
    gap: tuple[float, float, float]
    limit: float
    cut: float
    step: float

    @property
    def is_following(self) -> bool:
        """Whether the joint may have such a servo, as one that hardly moves may."""
        return self.unexplained < 1.0 - _FOLLOWS

    @property
    def is_told(self) -> bool:
        """Whether it has one, whose gains the log tells."""
        return self.explained > _FOLLOWS

    def estimate_sizes(self, usual: Array) -> tuple[Array, Array]:
        """Sizes of :data:`SERVO_KINDS` and their deviations, gains over usual ones ``(2,)``."""

        def law_sizes(law: Array) -> Array:
            kp = np.where(law[..., 0] == 0.0, 1e-9, law[..., 0])
            offset, scale = law[..., 2] / kp, 1.0 + law[..., 3] / kp
            gains = law[..., :2] / usual
            return np.stack([gains[..., 0], gains[..., 1], offset, scale, law[..., 5] * self.step], axis=-1)

        std = jackknife_std(law_sizes(self.parts))
        std[4] = np.hypot(std[4], 0.3 * self.step)
        return law_sizes(self.law), std


def read_servos(log: Log) -> list[Servo]:
    """The servo of each joint, where commands are logged and the servo is one of positions.

    Commands that scatter in time shake the joints, which bends the laws: these are fitted again to commands as they
    acted.
    """
    said = log.header.controller
    if any(t.q_cmd is None or t.tau is None for t in log.trials):
        return []
    if said and said.get("mode", "position") != "position":
        return []
    servos, acted = list(_fit_servos(log)), log
    for _ in range(_TIMES):
        jitter = _delay_jitter(acted, [servo for servo in servos if servo.is_told])
        if jitter is None or not jitter.is_clear:
            break
        acted = jitter.retime_commands(acted)
        servos = list(_fit_servos(acted))
    return servos


def _fit_servos(log: Log) -> Iterator[Servo]:
    said = log.header.controller
    stated, signals = stated_servo(said, log.header.joints), [_Signals.from_trial(t) for t in log.trials]
    columns = range(len(log.header.joints))
    for j, joint in enumerate(log.header.joints):
        if joint in log.header.no_torque:
            continue
        told = max(
            (_fit_law(signals, j, CommandPath(j, rate)) for rate in stated.follows),
            key=lambda one: one.law.r_squared,
        )
        if (
            told.law.unexplained >= 1.0 - _FOLLOWS
            or not 0.5 < 1.0 + told.law.sizes[3] / told.law.sizes[0] < 1.5
        ):
            # What follows no command of its own, or turned about, may follow another's as it is.
            ways = [CommandPath(k, rate) for k in columns for rate in stated.follows]
            plain = {way: _solve_law(_delay_products(signals, j, way), scaled=False) for way in ways}
            other = max(plain, key=lambda one: plain[one].r_squared)
            told = _fit_law(signals, j, other) if plain[other].r_squared > _FOLLOWS else told
        way, products, law, limit, cut = told
        kept = np.array([stated.kp[j], stated.kd[j]])
        meant = _stated_left(products, np.where(np.isnan(kept), law.sizes[:2], kept))
        count = max(float(products.grams[:, 0, 2, 2].sum()), 1.0)
        gap = [float(np.sqrt(max(x, 0.0) / count)) for x in (meant[0], law.left, law.power)]
        yield Servo(
            joint,
            way,
            law.sizes,
            np.array([_solve_law(products, without=k).sizes for k in range(len(products.noise))]),
            kept,
            meant / max(law.left, 1e-300),
            law.r_squared,
            law.unexplained,
            (gap[0], gap[1], gap[2]),
            limit if cut > _CUT_OFTEN else np.inf,
            cut,
            signals[0].step,
        )


class _Products(NamedTuple):
    """Products that laws are fitted by, and the power of the torque's noise in them.

    Attributes:
        grams: ``(n_stretches, n_delays, 6, 6)`` of errors of position and velocity, one, the command, its bend, torque.
        noise: ``(n_stretches,)``.
    """

    grams: Array
    noise: Array


class _FittedLaw(NamedTuple):
    """A joint's law: of which command, its products, and where it is cut how often."""

    way: CommandPath
    products: _Products
    law: _Law
    limit: float
    cut: float


def _fit_law(signals: Sequence[_Signals], j: int, way: CommandPath) -> _FittedLaw:
    law = _solve_law(products := _delay_products(signals, j, way))
    limit, cut = _torque_limit(signals, j, way, law)
    for _ in range(_TIMES if cut > _CUT_OFTEN else 0):
        law = _solve_law(products := _delay_products(signals, j, way, limit))
        limit, cut = _torque_limit(signals, j, way, law)
    return _FittedLaw(way, products, law, limit, cut)


@dataclass(frozen=True, eq=False)
class _Signals:
    """A trial's positions, velocities, torques, commands and their rates, ``(n, n_joints)``, filtered; raw ones.

    Attributes:
        noise: variances of the noise that is left in positions, velocities and torques, ``(3, n_joints)``.
    """

    q: Array
    v: Array
    tau: Array
    command: Array
    rate: Array
    noise: Array
    raw: tuple[Array, Array, Array, Array]
    step: float

    @classmethod
    def from_trial(cls, trial: Trial) -> _Signals:
        """The law is linear: filtered alike on both sides it holds, and the noise of velocities is less."""
        step = float(np.median(np.diff(trial.time)))
        v = np.gradient(trial.q, trial.time, axis=0) if trial.v is None else trial.v
        nothing = np.full_like(trial.q, np.nan)
        tau, command = (nothing if x is None else x for x in (trial.tau, trial.q_cmd))
        raw = (trial.q, v, tau, command)
        cutoff = highest_cutoff(1.0 / step)
        q, v, tau, command = (lowpass(x, 1.0 / step, cutoff) for x in raw)
        passed = noise_bandwidth(1.0 / step, cutoff)
        white = passed * np.square([channel_noise(trial.time, list(x.T)) for x in raw[:3]])
        # Vibration is no noise: in the band velocities stray from those of positions by no less than theirs.
        white[1] = np.minimum(white[1], (v - np.gradient(q, step, axis=0)).var(axis=0))
        if trial.v is None:
            white[1] = (2.0 * np.pi * cutoff) ** 2 / 3.0 * white[0]
        return cls(q, v, tau, command, np.gradient(command, step, axis=0), white, raw, step)

    def asked_torque(self, j: int, way: CommandPath, sizes: Array) -> Array:
        """Torque ``(n,)`` that a law asks for, unfiltered."""
        q, v, _, command = self.raw
        heard = _shift_later(command[:, way.column], round(sizes[5]))
        turning = way.rate * _shift_later(self.rate[:, way.column], round(sizes[5]))
        beyond = heard - command[:, way.column].mean()
        return np.asarray(
            np.column_stack([heard - q[:, j], turning - v[:, j], np.ones(len(q)), beyond]) @ sizes[:4]
        )


def _shift_later(values: Array, samples: int) -> Array:
    return np.asarray(values[np.maximum(np.arange(len(values)) - samples, 0)])


def _delay_products(
    signals: Sequence[_Signals], j: int, way: CommandPath, limit: float = np.inf
) -> _Products:
    """By stretch and delay, of samples that no torque at a limit is filtered into."""
    made, noise = [], []
    for one in signals:
        delays = np.arange(1 + round(_LATEST_S / one.step))
        rows = np.arange(delays[-1], len(one.q))
        cut = widen_flags(np.abs(one.raw[2][:, j]) > 0.95 * limit, round(0.5 / _CUTOFF_HZ / one.step))
        rows = rows[~cut[rows]]
        rate = one.rate[:, way.column]
        asked = np.column_stack([one.command[:, way.column], way.rate * rate, np.gradient(rate, one.step)])
        mean = one.command[:, way.column].mean()
        for part in np.array_split(rows, _STRETCHES):
            moved = np.column_stack([one.q[part, j], one.v[part, j]])
            one_tau = np.column_stack([np.ones(len(part)), one.tau[part, j]])
            x = np.empty((len(delays), len(part), 6))
            heard = asked[part - delays[:, None]]
            x[:, :, :2] = heard[:, :, :2] - moved
            x[:, :, 2], x[:, :, 5] = one_tau.T
            x[:, :, 3], x[:, :, 4] = heard[:, :, 0] - mean, heard[:, :, 2]
            gram = x.transpose(0, 2, 1) @ x
            # Noise of what a law multiplies bends its gains towards zero by the noise's share of the power.
            gram[:, [0, 1], [0, 1]] -= len(part) * one.noise[:2, j]
            made.append(gram)
            noise.append(len(part) * one.noise[2, j])
    return _Products(np.array(made), np.array(noise))


def _solve_law(products: _Products, *, without: int | None = None, scaled: bool = True) -> _Law:
    """Law of least squares over all delays, a stretch left out; unless ``scaled`` the command counts as kp says."""
    whole, noise = (part.sum(axis=0) - (0.0 if without is None else part[without]) for part in products)
    a, b = whole[:, :5, :5], whole[:, :5, 5]
    ridge = (1e-10 * np.einsum("dii->di", a) + 1e-300)[:, :, None] * np.eye(5)
    ridge[:, 3, 3] += 0.0 if scaled else 1e12
    sizes = np.linalg.solve(a + ridge, b[:, :, None])[:, :, 0]
    left = whole[:, 5, 5] - (sizes * b).sum(axis=1)
    # Gains are positive: a delay at which they are not is none.
    best = int(np.argmin(left + 1e12 * np.abs(left).max() * (sizes[:, :2] <= 0.0).any(axis=1)))
    between = 0.0
    if 0 < best < len(left) - 1:
        before, here, after = left[best - 1 : best + 2]
        between = float(np.clip(0.5 * (before - after) / max(before - 2.0 * here + after, 1e-300), -0.5, 0.5))
    mean = whole[best][2, 5] ** 2 / max(whole[best][2, 2], 1e-300)
    law = np.array([*sizes[best], best + between])
    return _Law(law, float(left[best]), float(whole[best][5, 5] - mean), float(noise))


def _stated_left(products: _Products, gains: Array) -> Array:
    """Power that a law of kp and kd ``(2,)`` leaves of the torque by delay, ``(n_delays,)``; jitter is free to blur."""
    whole, sizes = products.grams.sum(axis=0), np.concatenate([gains, np.zeros(2)])
    left = whole[:, 5, 5] - 2.0 * whole[:, 5, :4] @ sizes + whole[:, :4, :4] @ sizes @ sizes
    bent = whole[:, 4, 5] - whole[:, 4, :4] @ sizes
    return np.asarray(left - bent**2 / np.maximum(whole[:, 4, 4], 1e-300))


def _torque_limit(signals: Sequence[_Signals], j: int, way: CommandPath, law: _Law) -> tuple[float, float]:
    """Torque at which a law is cut, that leaves least of what the law leaves, and the share of samples beyond it."""
    asked = np.concatenate([one.asked_torque(j, way, law.sizes) for one in signals])
    told = np.concatenate([one.raw[2][:, j] for one in signals])
    limits = np.linspace(0.3, 1.0, 71) * np.abs(asked).max()
    left = [((told - np.clip(asked, -limit, limit)) ** 2).sum() for limit in limits]
    limit = float(limits[int(np.argmin(left))])
    beyond = np.abs(asked) > limit
    # What a cut leaves beyond the limit is the law's rest elsewhere.
    rest = ((told - asked)[~beyond] ** 2).mean() if (~beyond).any() else np.inf
    cut = ((told - np.clip(asked, -limit, limit))[beyond] ** 2).mean() if beyond.any() else np.inf
    lost = ((np.abs(asked[beyond]) - limit) ** 2).mean() if beyond.any() else 0.0
    return limit, float(beyond.mean()) if cut < min(2.0 * rest, _PILED * lost) else 0.0


def servo_effects(robot: Robot, log: Log, servos: Sequence[Servo]) -> Iterator[Candidate]:
    """What of servos is not as stated, or not as those of the joint's kind, of one drive or of all."""
    follow = [servo for servo in servos if servo.is_told]
    if not follow:
        return
    yield from _size_candidates(robot, follow)
    for servo in follow:
        if np.isfinite(servo.limit) and servo.limit < 0.95 * _stated_limit(robot, servo.joint):
            yield SATURATION.make_candidate(servo.joint, servo.limit, servo.gap[1], usual=0.0)
        if log.header.joints[servo.way.column] != servo.joint:
            yield ORDER.make_candidate(servo.joint, servo.way.column, 0.0, usual=-1.0)
    jitter = _delay_jitter(log, follow)
    if jitter is not None and jitter.is_clear:
        yield JITTER.make_candidate("command", jitter.deviation, jitter.std)


def _size_candidates(robot: Robot, servos: Sequence[Servo]) -> Iterator[Candidate]:
    """Sizes of laws that are not the stated ones, or not those of the joint's kind, of one drive or of all."""
    kinds, told = joint_kinds(robot), []
    for servo in servos:
        alike = [one.law[:2] for one in servos if kinds[one.joint] == kinds[servo.joint]]
        usual = np.where(servo.stated > 0.0, servo.stated, np.median(alike, axis=0))
        told.append(servo.estimate_sizes(np.where(usual == 0.0, 1e-9, usual)))
    sizes, stds = (np.array(part) for part in zip(*told, strict=True))
    # Jitter of all commands moves the joints, which bends every gain that is fitted: a drive's own law is one where the
    # stated one leaves more than it does elsewhere.
    excess = np.log([servo.excess for servo in servos])
    excess = excess[:, int(np.argmin(np.median(excess, axis=0)))]
    excess = excess - np.median(excess)
    own = excess > max(np.log(_OWN), SURE * 1.4826 * float(np.median(np.abs(excess))))
    # A command that is scaled about some pose is off at any other: its offset is no cause of its own.
    scaled = np.abs(sizes[:, 3] - 1.0) > np.maximum(SERVO_KINDS[3].least, SURE * stds[:, 3])
    sizes[scaled, 2] = 0.0
    for k, kind in enumerate(SERVO_KINDS):
        common, std = float(np.median(sizes[:, k])), float(np.median(stds[:, k]))
        if abs(common - kind.usual) > max(kind.least, SURE * std):
            yield kind.make_candidate("command", common, std)
        else:
            common = kind.usual
        for servo, size, spread, clear in zip(servos, sizes[:, k], stds[:, k], own, strict=True):
            if clear and abs(size - common) > max(kind.least, SURE * spread):
                yield kind.make_candidate(servo.joint, size, spread, usual=common)


def command_ticks(trial: Trial) -> Indices:
    """Rows at which commands change that are held in between, logged several times as often; none of others."""
    if trial.q_cmd is None:
        return np.zeros(0, dtype=np.int64)
    ticks = np.flatnonzero((np.diff(trial.q_cmd, axis=0) != 0.0).any(axis=1)) + 1
    held = len(ticks) >= _FEWEST_TICKS and np.median(np.diff(ticks)) >= _HELD
    return np.asarray(ticks if held else ticks[:0])


def _stated_limit(robot: Robot, joint: str) -> float:
    limit = float(robot.model.effortLimit[robot.n_base_v + robot.joint_index(joint)])
    return limit if limit > 0.0 else np.inf


class _Jitter(NamedTuple):
    """Delays of held commands, tick by tick, the same for all drives.

    Attributes:
        deviation: of the delays [s].
        std: its own deviation [s].
        ticks: by trial, rows at which commands change.
        delays: by trial, how much later than usual each acts [s].
    """

    deviation: float
    std: float
    ticks: tuple[Indices, ...]
    delays: tuple[Array, ...]

    @property
    def is_clear(self) -> bool:
        """Whether commands scatter by more than matters, and surely."""
        return self.deviation > max(JITTER.least, SURE * self.std)

    def retime_commands(self, log: Log) -> Log:
        """The log with commands as they acted."""
        trials = []
        for trial, ticks, late in zip(log.trials, self.ticks, self.delays, strict=True):
            command = np.array(trial.q_cmd)
            shift = np.round(late / float(np.median(np.diff(trial.time)))).astype(int)
            arrived, rows = np.maximum.accumulate(ticks + shift), np.arange(len(command))
            last = np.searchsorted(arrived, rows, side="right") - 1
            known = (last >= 0) & (rows <= ticks[-1])
            command[known] = command[ticks[last[known]]]
            trials.append(replace(trial, q_cmd=command))
        return replace(log, trials=tuple(trials))


def _delay_jitter(log: Log, servos: Sequence[Servo]) -> _Jitter | None:
    """Delays of held commands; None where commands are not held.

    A command that acts δ late leaves ``−k_p Δq_cmd`` for δ, an area about its tick. Every other joint tells δ for
    itself: what both halves have in common is no noise.
    """
    areas, pushes, rows = [], [], []
    for trial in log.trials:
        one = _Signals.from_trial(trial)
        command = one.raw[3]
        ticks = command_ticks(trial)
        if not len(ticks):
            return None
        hold = int(np.median(np.diff(ticks)))
        ticks = ticks[(ticks > hold) & (ticks < len(command) - 2 * hold - _LATEST_S / one.step)]
        area, push = [], []
        for servo in servos:
            j = log.header.joints.index(servo.joint)
            rest = np.cumsum(one.raw[2][:, j] - one.asked_torque(j, servo.way, servo.law))
            at = ticks + round(servo.law[5]) - 1
            area.append((rest[at + hold // 2] - rest[at - hold // 2]) * one.step)
            push.append(servo.law[0] * (command[ticks] - command[ticks - 1])[:, servo.way.column])
        areas.append(np.array(area).T)
        pushes.append(np.array(push).T)
        rows.append(ticks)
    area, push = np.concatenate(areas), np.concatenate(pushes)
    weight = np.array([(push[:, half::2] ** 2).sum(axis=1) for half in (0, 1)])
    late = -np.array([(area * push)[:, half::2].sum(axis=1) for half in (0, 1)]) / np.maximum(weight, 1e-300)
    clear = (weight > 0.1 * np.median(weight, axis=1, keepdims=True)).all(axis=0)
    late = np.clip(late - np.median(late[:, clear], axis=1, keepdims=True), -_LATEST_S, _LATEST_S)
    shared = late[:, clear].prod(axis=0)
    parts = np.array([part.mean() for part in np.array_split(shared, 2 * _STRETCHES)])
    deviation = float(np.sqrt(max(shared.mean(), 1e-12)))
    ends = np.cumsum([len(ticks) for ticks in rows])[:-1]
    delays = np.split(np.where(clear, late.mean(axis=0), 0.0), ends)
    std = float(parts.std() / np.sqrt(len(parts)) / (2.0 * deviation))
    return _Jitter(deviation, std, tuple(rows), tuple(delays))
