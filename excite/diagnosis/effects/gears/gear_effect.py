"""What soft gears and loose ones have in common: the link behind them moves otherwise than the motor."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.effect import Belief, Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import DEFLECTION, Absence, Context, Draft, Form, InitialState, Note, Sizes
from excite.diagnosis.effects.gears.gear import (
    DrivenLink,
    Gear,
    contact_stiffness,
    gear_damping,
    link_inertia,
)
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import ARMATURE
from excite.diagnosis.equations.samples import ArmSamples
from excite.doctor.doubt import Doubt
from excite.lazy_kernel import LazyKernel
from excite.logs.signals.butterworth import settling_samples

if TYPE_CHECKING:
    import mujoco

# A motor whose rotor weighs nothing has no equation of motion of its own [kg·m²].
_LEAST_ROTOR = 1e-4


class GearEffect(Effect, ABC):
    """An effect of a gear that gives way.

    Attributes:
        second_order: whether torques follow the deflection to second order, instead of to first.
    """

    moves = True
    second_order: bool = False

    @property
    def refined_form(self) -> Effect | None:
        """To second order: a gear that is soft for its load turns gravity with it."""
        if self.second_order:
            return None
        other = copy(self)
        other.second_order = True
        return other

    @abstractmethod
    def make_gear(self, context: Context, location: str, theta: Theta) -> Gear:
        """The gear that non-linear parameters stand for."""

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        """What the link's deflection from the motor adds to the torques of all joints.

        ``∂τ/∂q δ + ∂τ/∂v δ̇ + M δ̈`` and so on in the deflection δ, with δ from its own equation of motion, the other
        joints moving as logged (Spong 1987, eq. 5, with the motor's side prescribed).
        """
        j = context.row(location)
        moved = self.link_deflection(context, location, theta)
        by_q, by_v, mass = (context.torque_gradient(j, what) for what in ("q", "v", "a"))
        if self.second_order:
            x, s = moved[0][:, None], moved[1][:, None]
            qq, qv, vv, qa = (context.torque_curvature(j, what) for what in ("qq", "qv", "vv", "qa"))
            by_q, by_v, mass = by_q + 0.5 * qq * x, by_v + qv * x + 0.5 * vv * s, mass + qa * x
        return Shape(offset=dict(enumerate(added_torque(by_q, by_v, mass, moved))))

    def link_deflection(self, context: Context, location: str, theta: Theta) -> Array:
        """The link's angle less the motor's, its speed and its acceleration, the rows of ``(3, n_samples)``."""
        j, samples = context.row(location), context.baseline.samples
        behind = DrivenLink.of_joint(context, j, second_order=self.second_order)
        gear = self.make_gear(context, location, theta)
        begin = first_states(context, j, behind, gear)
        return integrate_deflection(behind, gear, samples.is_start, begin, 1.0 / samples.rate_hz)

    def initial_state(self, context: Context, location: str, theta: Theta) -> InitialState:
        moved = self.link_deflection(context, location, theta)
        return InitialState(deflection=context.baseline.samples.by_trial(moved[:2].T))


def joint_behind(draft: Draft, motor: str) -> mujoco.MjsJoint:
    """A second joint of the body that a motor moves, behind the motor's, whose rotor alone the armature then is."""
    joint = draft.find_joint(motor)
    joint.armature = max(joint.armature, _LEAST_ROTOR)
    return draft.moved_body(motor).add_joint(name=motor + DEFLECTION, type=joint.type, axis=joint.axis)


# The motion of a link behind a soft or loose gear.

# No gear gives way further [rad].
_FURTHEST = 1.0
# Trials that go side by side: the processor works on several at a time, where one would wait for itself. Of 4, 8 and
# 16 lanes on an AVX-512 machine, 8 take .48 of the time of one after the other for 8 trials, .74 for 4 and 1.5 for 1.
LANES = 8
# What is known of each lane, one after the other in one array: the compiler then sees that they are apart.
_X, _S, _MEAN, _NOW, _THEN, _INERTIA, _TURN, _DRAG, _BEND, _TWIST = range(10)


@LazyKernel
def integrate_deflection(behind, gear, starts, begin, dt):  # pragma: no cover - compiled
    """Integrate ``M δ̈ = −τ(δ, δ̇) − k(δ) − D δ̇`` with a dead band of ±gap, by its midpoints.

    ``behind`` (:class:`~excite.diagnosis.effects.gears.gear.DrivenLink`) is the torque τ that the link needs and its
    changes. The inertia behind a joint does not change with its own angle, and so nothing does with the square of
    its own speed. ``starts`` marks the first sample of each trial, the first of all among them, where the deflection is
    the static one and ``begin (n_trials, 2)`` more, angle and speed.

    ``gear`` (:class:`~excite.diagnosis.effects.gears.gear.Gear`) gives way: the spring is ``k x (1 + cubic x²)``; in
    the dead band there is neither spring nor damper. With ``soft`` each flank of the band is
    ``k s log(1 + exp((x − gap)/s))``: contact comes on over a width s. With ``depth`` the flanks are round, their
    force and their damping as those of two spheres: ``k x √(x/depth)`` (Hertz 1881; Hunt, Crossley 1975). Contacts
    push and do not pull.
    Returns δ, δ̇, δ̈ as the rows of ``(3, n)``.
    """
    load, stiffness, gap, cubic = behind.load, gear.stiffness, gear.gap, gear.cubic
    out = np.empty((3, len(load)))
    first, lengths = _trial_bounds(starts)
    flat = gear.soft == 0.0 and gear.depth == 0.0
    room = np.empty(10 * LANES)
    for group in range(0, len(first), LANES):
        # Lanes that no trial is left for go through the last one again.
        width, longest = min(LANES, len(first) - group), 0
        for k in range(LANES):
            trial = group + min(k, width - 1)
            start, longest = first[trial], max(longest, lengths[trial])
            # A load that falls as the link gives way softens the gear; it is not let carry all of it.
            held = max(1.0 + behind.by_q[start] / stiffness, 0.2)
            rest = _static_deflection(-load[start] / (stiffness * held), gap, cubic / held)
            room[_X * LANES + k], room[_S * LANES + k] = rest + begin[trial, 0], begin[trial, 1]
        for i in range(longest):
            for k in range(LANES):
                trial = group + min(k, width - 1)
                # A trial that has ended goes on under its last load, unrecorded.
                last = lengths[trial] - 1
                here = first[trial] + min(i, last)
                if i <= last:
                    out[0, here], out[1, here] = room[_X * LANES + k], room[_S * LANES + k]
                room[_NOW * LANES + k], room[_THEN * LANES + k] = (
                    load[here],
                    load[first[trial] + min(i + 1, last)],
                )
                room[_INERTIA * LANES + k], room[_MEAN * LANES + k] = behind.inertia[here], 0.0
                room[_TURN * LANES + k], room[_DRAG * LANES + k] = behind.by_q[here], behind.by_v[here]
                room[_BEND * LANES + k], room[_TWIST * LANES + k] = behind.by_qq[here], behind.by_qv[here]
            for part in range(4):
                if flat:
                    _flat_step(room, stiffness, gear.damping, gap, cubic, (part + 0.5) / 4, dt / 4)
                else:
                    _round_step(room, gear, (part + 0.5) / 4, dt / 4)
            for k in range(width):
                if i < lengths[group + k]:
                    out[2, first[group + k] + i] = room[_MEAN * LANES + k]
    return out


@LazyKernel
def added_torque(by_q, by_v, mass, moved):  # pragma: no cover - compiled
    """Torques ``(n_joints, n)`` of a deflection, its speed and its acceleration, the rows of ``moved (3, n)``.

    The others are changes of all torques with the joint's motion, ``(n, n_joints)``.
    """
    out = np.empty((by_q.shape[1], by_q.shape[0]))
    for k in range(by_q.shape[1]):
        for i in range(by_q.shape[0]):
            out[k, i] = by_q[i, k] * moved[0, i] + by_v[i, k] * moved[1, i] + mass[i, k] * moved[2, i]
    return out


@LazyKernel
def _flat_step(room, stiffness, damping, gap, cubic, share, h):  # pragma: no cover - compiled
    """A quarter of a sample of all lanes, flanks flat: no branches, so that lanes go together."""
    for k in range(LANES):
        x, s = room[_X * LANES + k], room[_S * LANES + k]
        beyond = (x - gap if x > gap else 0.0) + (x + gap if x + gap < 0.0 else 0.0)
        grown = cubic * beyond * beyond
        held, kk = stiffness * (1.0 + grown) * beyond, stiffness * (1.0 + 3.0 * grown)
        apart = (beyond == 0.0) | ((gap > 0.0) & ((held + damping * s) * beyond < 0.0))
        held, kk, dd = 0.0 if apart else held, 0.0 if apart else kk, 0.0 if apart else damping
        _midpoint_step(room, k, held, kk, dd, share, h)


@LazyKernel
def _round_step(room, gear, share, h):  # pragma: no cover - compiled
    """A quarter of a sample of all lanes, flanks soft or round."""
    for k in range(LANES):
        held, kk, dd = _gear_torque(room[_X * LANES + k], room[_S * LANES + k], gear)
        _midpoint_step(room, k, held, kk, dd, share, h)


@LazyKernel
def _midpoint_step(room, k, held, kk, dd, share, h):  # pragma: no cover - compiled
    """A step of a lane whose gear holds ``held`` with a stiffness ``kk`` and a damping ``dd``."""
    x, s, m = room[_X * LANES + k], room[_S * LANES + k], room[_INERTIA * LANES + k]
    turn, drag = room[_TURN * LANES + k], room[_DRAG * LANES + k]
    bend, twist = room[_BEND * LANES + k], room[_TWIST * LANES + k]
    held += (turn + 0.5 * bend * x) * x
    kk += turn + bend * x + twist * s
    dd += drag + twist * x
    tau = room[_NOW * LANES + k] * (1.0 - share) + room[_THEN * LANES + k] * share
    # The midpoint's spring and damper lose no energy of their own; those of the step's end are stable where contacts
    # are stiff for it.
    at = h if h * h * kk > 0.25 * m else 0.5 * h
    acc = -(tau + held + kk * at * s + dd * s) / (m + at * dd + at * at * kk)
    x, s = x + h * (s + at * acc), s + h * acc
    # A gear softer than gravity pulls lets its link fall: no gear, but no number without end either.
    beyond = abs(x) > _FURTHEST
    room[_X * LANES + k], room[_S * LANES + k] = (
        math.copysign(_FURTHEST, x) if beyond else x,
        0.0 if beyond else s,
    )
    room[_MEAN * LANES + k] += acc / 4


@LazyKernel
def _gear_torque(x, s, gear):  # pragma: no cover - compiled
    """Torque of a gear's spring at a deflection, its stiffness there, and its damping."""
    stiffness, damping, gap = gear.stiffness, gear.damping, gear.gap
    if gear.soft > 0.0:
        held, share = _flank_torque(x, gap, gear.soft)
        return stiffness * held, stiffness * share, damping * share
    beyond = x - gap if x > gap else min(x + gap, 0.0)
    if beyond == 0.0:
        return 0.0, 0.0, 0.0
    if gear.depth > 0.0:
        share = math.sqrt(abs(beyond) / gear.depth)
        held, kk, dd = stiffness * share * beyond, 1.5 * stiffness * share, damping * share
    else:
        grown = gear.cubic * beyond * beyond
        held, kk, dd = stiffness * (1.0 + grown) * beyond, stiffness * (1.0 + 3.0 * grown), damping
    if gap > 0.0 and (held + dd * s) * beyond < 0.0:
        return 0.0, 0.0, 0.0
    return held, kk, dd


@LazyKernel
def _static_deflection(stretch, gap, cubic):  # pragma: no cover - compiled
    """Deflection under a constant load, of which a linear spring would take ``stretch``."""
    x = stretch
    # Newton's method for x (1 + cubic x²) = stretch; from the softest spring's side it comes down.
    for _ in range(30):
        x -= (x * (1.0 + cubic * x * x) - stretch) / (1.0 + 3.0 * cubic * x * x)
    return x + gap if x > 0.0 else x - gap


@LazyKernel
def _flank_torque(x, gap, soft):  # pragma: no cover - compiled
    """Torque per stiffness of two soft contacts at ±gap, and its slope, 0…1."""
    up, down = (x - gap) / soft, (-x - gap) / soft
    held = soft * (math.log1p(math.exp(-abs(up))) + max(up, 0.0))
    held -= soft * (math.log1p(math.exp(-abs(down))) + max(down, 0.0))
    return held, 1.0 / (1.0 + math.exp(-up)) + 1.0 / (1.0 + math.exp(-down))


@LazyKernel
def _trial_bounds(starts):  # pragma: no cover - compiled
    """First sample and length of each trial, ``(n_trials,)`` both."""
    # Plain loops where numpy has a function: each of those takes a tenth of a second to compile.
    count = 0
    for marked in starts:
        count += marked
    first, lengths, end = np.empty(count, np.int64), np.empty(count, np.int64), len(starts)
    for i in range(len(starts) - 1, -1, -1):
        if starts[i]:
            count -= 1
            first[count], lengths[count], end = i, end - i, i
    return first, lengths


# How a soft or loose gear swings already where a trial begins.

# So few samples, or such a share of those before the rows, do not tell how a gear swings.
_LEAST, _LEAST_SHARE = 20, 0.4
# A gear that has swung off to exp(−5) before the first row may have begun anyhow.
_FORGOTTEN = 5.0
# Steps of Gauss and Newton, where the gear is not linear.
_STEPS = 4


def first_states(context: Context, j: int, behind: DrivenLink, gear: Gear) -> Array:
    """Deflection and its speed at each trial's first sample, beyond rest under the load, ``(n_trials, 2)``.

    Where a trial begins in motion the gear already swings, and a soft one goes on for longer than the rows wait. The
    measured torque less the motor's own part is what the gear carries: least squares over the samples before the
    first row tells its state. Rows, and so whatever is judged, have no part in it. A trial that begins at rest, or
    before which nothing was measured, begins at rest under its load.
    """
    samples, base = context.baseline.samples, context.baseline
    begin = np.zeros((len(samples.trials), 2))
    moving = np.abs(context.v[:, j]) > samples.standstill[j]
    kept = base.derived.values
    if (j, "before rows") not in kept:
        kept[j, "before rows"] = _before_rows(samples, j, moving)
    counts = kept[j, "before rows"]
    told = np.flatnonzero(counts)
    inertia = float(behind.inertia.mean())
    length = float(counts.max()) / samples.rate_hz
    if not len(told) or 0.5 * gear.damping / inertia * length > _FORGOTTEN:
        return begin
    firsts = np.flatnonzero(samples.is_start)
    rows = np.concatenate([firsts[k] + np.arange(counts[k]) for k in told])
    measured = np.concatenate([samples.trials[k].measured_torque[: counts[k], j] for k in told])
    own = base.total[rows, j] - base.rigid[rows, j]
    early = _EarlySamples(
        behind.at_samples(rows),
        samples.is_start[rows],
        measured - own,
        moving[rows],
        np.cumsum(counts[told])[:-1],
        1.0 / samples.rate_hz,
        gear,
    )
    load = float(np.sqrt(np.mean(behind.load**2)))
    reach = gear.gap + load / gear.stiffness
    begin[told] = early.fit_states(reach, reach * math.sqrt(gear.stiffness / inertia))
    return begin


@dataclass(frozen=True, eq=False)
class _EarlySamples:
    """The samples before the rows, of the trials in which they tell something.

    Attributes:
        behind: what the gear has behind it at these samples.
        starts: which are the first of a trial.
        carried: torque that the gear carries there, as measured [N·m].
        moving: whether the motor moves: where it stands, static friction has any part of the torque.
        ends: where trials end, the last one's left out.
        dt: [s].
        gear: the gear.
    """

    behind: DrivenLink
    starts: NDArray[np.bool_]
    carried: Array
    moving: NDArray[np.bool_]
    ends: NDArray[np.int64]
    dt: float
    gear: Gear

    def residual_torque(self, begin: Array) -> Array:
        """Torque that a gear does not carry which begins so, ``(n_samples,)``; none where the motor stands."""
        swung = integrate_deflection(self.behind, self.gear, self.starts, begin, self.dt)
        return (self.carried - self.behind.required_torque(*swung)) * self.moving

    def fit_states(self, reach: float, speed: float) -> Array:
        """First states ``(n_trials, 2)``, as large as ``reach`` and ``speed`` before anything is measured."""
        count = len(self.ends) + 1
        size = np.array([reach, speed])
        states, linear = np.zeros((count, 2)), self.gear.gap == 0.0 and self.gear.cubic == 0.0
        left = np.split(self.residual_torque(states), self.ends)
        # Noise as between neighbours.
        moves = np.split(self.moving, self.ends)
        noise = (float(np.std(np.diff(y[m]))) for y, m in zip(left, moves, strict=True))
        weights = [1.0 / max(level, 1e-12) ** 2 for level in noise]
        for _ in range(1 if linear else _STEPS):
            wanted = self._newton_states(states, left, weights, size, 1.0 if linear else 0.05)
            # A step that makes a trial worse is taken by a third, or not at all.
            for share in (1.0, 0.3):
                if np.array_equal(wanted, states):
                    break
                tried = states + share * (wanted - states)
                after = np.split(self.residual_torque(tried), self.ends)
                for k, w in enumerate(weights):
                    closer = w * float(left[k] @ left[k] - after[k] @ after[k])
                    if closer > float(((tried[k] ** 2 - states[k] ** 2) / size**2).sum()):
                        states[k], left[k], wanted[k] = tried[k], after[k], tried[k]
        return states

    def _newton_states(
        self, states: Array, left: list[Array], weights: list[float], size: Array, step: float
    ) -> Array:
        """States at which what is left would be least, were the gear linear about these, ``(n_trials, 2)``."""
        moved = [np.split(self.residual_torque(states + step * size * unit), self.ends) for unit in np.eye(2)]
        wanted = states.copy()
        for k, w in enumerate(weights):
            slope = np.column_stack([left[k] - m[k] for m in moved]) / step
            normal = w * slope.T @ slope + np.eye(2)
            wanted[k] += np.linalg.solve(normal, w * slope.T @ left[k] - states[k] / size) * size
        return wanted


def _before_rows(samples: ArmSamples, j: int, moving: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of a trial's samples that are out of its rows' reach, ``(n_trials,)``; 0 where the joint stands."""
    edge = settling_samples(samples.rate_hz, samples.bands.rows_hz)
    counts = np.zeros(len(samples.trials), np.int64)
    by_trial = np.split(moving, np.flatnonzero(samples.is_start)[1:])
    for k, (trial, moves) in enumerate(zip(samples.trials, by_trial, strict=True)):
        count = max(int(trial.rows[0]) - edge, 0)
        if moves[:count].sum() >= max(_LEAST, _LEAST_SHARE * count) and np.isfinite(trial.tau[0, j]):
            counts[k] = count
    return counts


# Rotor inertia, reflected through the gear.


class Armature(Effect):
    """``τ = I_a a``: the rotor's inertia times the gear ratio squared, felt by its own joint alone."""

    name = "armature"
    observed_by = frozenset({Doubt.CLOCK})
    linear = (Parameter("inertia", "kg·m²", 0.0),)
    confusable_with = ("link_inertia", "payload", "joint_elasticity")
    separating_motion = "fast motion of that joint in two postures with different link inertia"
    without_motion = "the rotor's inertia by its data sheet times the gear's ratio squared"
    mujoco = "joint armature"
    by_motion = True
    term = ARMATURE
    twins_of_a_gain = ("torque_gain",)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return context.signal_at(location, "a")[:, None]

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(armature=item.value_of("inertia"))


# A soft gear between motor and link.

# Natural frequencies [Hz] and damping ratios from which a gear is searched: harmonic drives and servos have ratios of
# .05 to .3. Within the motion's own band only one damped by half its critical damping is wide enough for the grid.
# Above it such a one gives way late rather than by degrees: with 0.5 at all, two took the place of a delay of 12 ms
# that was planted in an xMate3's record; with 0.12 at all, a gear of 1.7 Hz is not found.
_SWINGS = ((2.0, 0.5), (3.0, 0.5), (4.5, 0.12), (6.5, 0.12), (9.0, 0.12), (13.0, 0.12))


@dataclass(frozen=True)
class ElasticityNote(Note):
    """Where a soft gear begins a roll-out of which nothing is told.

    Attributes:
        stiffness: [N·m/rad].
        hardening_at: deflection at which it is twice as stiff as at rest [rad].
    """

    stiffness: float
    hardening_at: float | None = None

    beyond = Absence.START
    every_step = False

    def resting_deflection(self, torque: float) -> float:
        linear, at = -torque / self.stiffness, np.inf if self.hardening_at is None else self.hardening_at
        # x (1 + (x/x₀)²) = linear by Newton's method.
        x = linear
        for _ in range(30):
            r = x / at
            x -= (x * (1.0 + r * r) - linear) / (1.0 + 3.0 * r * r)
        return x


class JointElasticity(GearEffect):
    """The link's angle is the logged motor's angle plus a deflection, ``k δ = −τ`` (Spong 1987)."""

    name = "joint_elasticity"
    belief = Belief(group="gear")
    searched: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "N·m/rad", 0.01, 1e6),
        Parameter("damping_ratio", "1", 0.01, 2.0),
    )
    confusable_with = ("armature", "backlash", "time_delay")
    separating_motion = "a chirp of that joint around the resonance"
    mujoco = "a second joint with stiffness and damping behind the motor's"
    note = ElasticityNote

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (HardeningElasticity(),)

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        j = context.row(location)
        return [(contact_stiffness(context, j, hertz), ratio) for hertz, ratio in _SWINGS]

    def make_gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return Gear(theta[0], gear_damping(context, context.row(location), theta[0], theta[1]))

    def transfer_shape(self, old: Context, new: Context, location: str, theta: Theta) -> Theta:
        """As many swings a second: a link that turns out lighter has a gear that is softer by as much."""
        before, after = (float(link_inertia(c, c.row(location)).mean()) for c in (old, new))
        return (theta[0] * after / before, *theta[1:])

    def to_sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        values = super().to_sizes(context, location, theta, fit)
        damping = gear_damping(context, context.row(location), values["stiffness"], values["damping_ratio"])
        return values | {"damping": damping}

    def in_mujoco(self, item: Sizes) -> Form:
        def add_elastic_joint(draft: Draft) -> None:
            # MuJoCo's polynomial: force −(k₀ + k₁ |x| + k₂ x²) x.
            joint = joint_behind(draft, item.location)
            joint.stiffness = [item.value_of("stiffness"), 0.0, self.cubic_stiffness(item)]
            joint.damping = [item.value_of("damping"), 0.0, 0.0]

        return Form(elements=add_elastic_joint, notes=(self.make_note(item),))

    def cubic_stiffness(self, item: Sizes) -> float:
        """Growth of the stiffness with the square of the deflection [N·m/rad³]."""
        return 0.0


class HardeningElasticity(JointElasticity):
    """A gear that grows stiffer: ``k δ (1 + (δ/δ₀)²)``, as harmonic drives do; where it is nearly slack, like play."""

    searched = (*JointElasticity.searched, Parameter("hardening_at", "rad", 1e-4, 1.0))

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        # Under a constant load the tangent is what has been found, and the spring at rest is softer.
        return [(s * theta[0], theta[1], at) for s in (0.15, 0.4, 0.8) for at in (0.01, 0.03, 0.08)]

    def further_starts(self, context: Context, location: str) -> list[Theta]:
        """Stiffer where the load stretches it than at rest: hardly damped, and damped more, whose valley is wider."""
        j = context.row(location)
        load = float(np.sqrt(np.mean(context.baseline.rigid[:, j] ** 2)))
        soft = [contact_stiffness(context, j, hertz) for hertz in (0.75, 1.1, 1.6, 2.4, 3.6, 5.4)]
        damped: list[Theta] = [(k, 0.3, 0.7 * load / k) for k in soft[:4]]
        return [*damped, *((k, 0.1, share * load / k) for k in soft[2:] for share in (0.7, 1.4))]

    def make_gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return super().make_gear(context, location, theta)._replace(cubic=theta[2] ** -2)

    def cubic_stiffness(self, item: Sizes) -> float:
        return item.value_of("stiffness") / item.value_of("hardening_at") ** 2
