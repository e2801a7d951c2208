"""Effects of bodies and their placement: payload, link lengths, tilt of the base."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.effect import Belief, Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.forces import RippleNote
from excite.diagnosis.effects.form import Absence, Context, Draft, Form, Sizes
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import ARMATURE
from excite.diagnosis.equations.units import is_sliding_joint
from excite.doctor.doubt import Doubt
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.physical.cone_program import TRIANGLE, ConeProgram, solve_cone_program
from excite.regressor.kernels import placement_gradient
from excite.robot.links import carried_link
from excite.robot.quantities import GRAVITY

# The directions in which a tilt of the base turns gravity.

# Cosine beyond which the base's x axis is upright rather than level.
_UPRIGHT = 0.9


def level_axes(gravity: Array) -> Array:
    """Unit vectors in the base frame, ``(3, 3)``: two level ones, along x and y on a level base, and down.

    Args:
        gravity: ``(3,)`` nominal gravity in the base frame [m/s²]; straight down in its z where it is nothing.

    Returns:
        In rows; where the base's x axis is upright, the first is along its y axis.
    """
    size = float(np.linalg.norm(gravity))
    down = np.asarray(gravity, dtype=np.float64) / size if size > 0.0 else np.array([0.0, 0.0, -1.0])
    along = np.eye(3)[1 if abs(down[0]) > _UPRIGHT else 0]
    first = along - (along @ down) * down
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(first, down), down])


# A base that does not stand as the model says.

# Distance of link 1's centre of mass from its axis that nobody knew of, with the whole robot's mass in it [m].
_LEVER = 0.1
# A tilt that is not seen for the noise [m/s²].
_LEAST = 0.02


def tilt_gravity(gravity: Array, item: Sizes) -> Array:
    """Gravity ``(3,)`` in a tilted base [m/s²]: its components are along the axes that the effect is fitted in."""
    size, (first, second, down) = float(np.linalg.norm(gravity)), level_axes(gravity)
    aside = item.value_of("gravity_x") * first + item.value_of("gravity_y") * second
    # A tilt turns gravity, it does not add to it; but masses that were fitted beside what is left of it go with that.
    less = float(np.sqrt(max(size**2 - float(aside @ aside), 0.0))) - size
    return (size + item.value_of("gravity_down", less)) * down + aside


class BaseTilt(Effect):
    """Gravity in the base frame has level components that the model does not have: along x and y on a level base.

    Two columns are the torques of a horizontal gravity; two more, cos q₁ and sin q₁ on the first row, are
    the first moments of link 1, invisible while its axis is upright. They are no larger than the tilt and the
    robot's mass make them, or a spring at joint 1 would be a tilt of nothing.
    """

    name = "base_tilt"
    belief = Belief(width=1.0)
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("gravity_x", "m/s²", -5.0, 5.0),
        Parameter("gravity_y", "m/s²", -5.0, 5.0),
        Parameter("first_row_cosine", "N·m", beside=True),
        Parameter("first_row_sine", "N·m", beside=True),
    )
    confusable_with = ("joint_spring", "torque_bias", "encoder_offset")
    separating_motion = "a wide range of joint 1; the arm on a base that is turned"
    mujoco = "option gravity"
    moves = True
    by_motion = True
    note = RippleNote

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (SteepTilt(),)

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return (KnownLeverTilt(),)

    def is_candidate(self, modelled: tuple[str, ...]) -> bool:
        return self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("base",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        model = samples.robot.model.copy()
        q = samples.stack_trials("q")
        still = np.zeros((len(q), model.nv))
        columns = np.zeros((len(q), len(context.joints), len(self.linear)))
        for k, axis in zip((0, 1, 4), level_axes(model.gravity.linear), strict=True):
            if k < len(self.linear):
                model.gravity.linear = axis
                columns[:, :, k] = samples.rigid_torques(
                    context.baseline.phi, motion=Moved(q, still, still), model=model
                )
        # A slide has no first moments; those of links further out are the identifier's.
        lever = len(self.linear) > 2
        if lever and samples.index[0] == 0 and not is_sliding_joint(samples.robot, context.joints[0]):
            first = context.q[:, 0]
            columns[:, 0, 2], columns[:, 0, 3] = np.cos(first), np.sin(first)
        return Shape({j: columns[:, j] for j in range(len(context.joints))})

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        mass = sum(inertia.mass for inertia in context.baseline.samples.robot.model.inertias)
        most = _LEVER * mass * max(float(np.hypot(*beta[:2])), _LEAST)
        return float(np.linalg.norm(beta[2:4])) <= most and super().is_admissible(
            context, location, theta, beta
        )

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        # A slide that is level shows one of the two, a joint whose axis is upright none.
        shown = np.isfinite(fit.extra_std[:2])
        aside, spread = fit.extra[:2][shown], fit.extra_std[:2][shown]
        # Of no tilt nobody knows the direction: any is as likely.
        size = float(np.linalg.norm(aside))
        along = aside / size if size > 0.0 else np.full(len(aside), max(len(aside), 1) ** -0.5)
        std = float(np.linalg.norm(along * spread)) / GRAVITY if shown.any() else None
        angle = Estimate(float(np.arcsin(min(size / GRAVITY, 1.0))), std, "rad")
        found = super().to_estimates(context, location, theta, fit)
        return {"angle": angle, **{p.name: found[p.name] for p in self.linear[:2] if p.name in found}}

    def in_mujoco(self, item: Sizes) -> Form:
        first = {name: item.value_of(f"first_row_{name}") for name in ("cosine", "sine")}
        noted = self.make_note(replace(item, values={**first, "periods_per_rev": 1.0}), item.joints[0])
        notes = (noted,) if any(first.values()) else ()
        return Form(gravity=lambda gravity: tilt_gravity(gravity, item), notes=notes)


class KnownLeverTilt(BaseTilt):
    """The same with a first link as it is known: beside a large effect at joint 1, its first moments are nowhere."""

    linear = BaseTilt.linear[:2]

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (BaseTilt(),)

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return ()


class SteepTilt(BaseTilt):
    """The same where the tilt is large enough for less of gravity to be left along the nominal vertical."""

    linear = (*BaseTilt.linear, Parameter("gravity_down", "m/s²", -5.0, 0.0))

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()


# The likeliest of all bodies that can exist, of a Gaussian estimate of the ten inertial parameters.

# Sizes of mass, first moments and moments of inertia, by which the solver scales: a kilogram within a hand's breadth.
_SIZES = np.array([1.0, *[0.1] * 3, *[0.01] * 6])
# Rounding of a solver by which a body's least second moment may lie below zero, as a share of its largest.
_ROUNDING = 1e-6
# Information of a number, as a share of the largest, below which it is none: else rounding would choose it. With 1e-7
# drawn bodies that can exist come out 1e-5 off; with nothing two processors gave other moments of inertia.
_LEAST_TOLD = 1e-9
# Share of the largest distance of a body's parts from which its bound is what holds it: a solver's precision. False
# names in an LWR's and an AirBot's records lie at 0.600 of 0.6 m, loads that are there at 0.19 to 0.30.
_AT_REACH = 1e-3
# By entry of the inertia in the order xx, xy, yy, xz, yz, zz: its second moments ∫ r rᵀ dm are ½ tr(I) 1 − I.
_INERTIA = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def likeliest_body(information: Array, target: Array, reach: float, removable: float) -> Array | None:
    """The body that is added to a link or, where that is likelier, taken away from it.

    Its pseudo-inertia is positive semidefinite (Wensing, Kim and Slotine 2018, eq. 8), and its second moments are no
    larger than those of its mass at the reach.

    Args:
        information: inverse covariance of mass, first moments and moments of inertia about the joint, ``(10, 10)``,
            in pinocchio's order.
        target: ``information`` times their estimate, ``(10,)``.
        reach: largest distance of its parts from the joint [m].
        removable: mass that a link has to lose [kg].

    Returns:
        ``(10,)``, all negative where it is taken away; None where nothing is likelier than any body.
    """
    best, found = 0.0, None
    for sign in (1.0, -1.0):
        answer = _solve_for_body(information, sign * target, reach, np.inf if sign > 0.0 else removable)
        if answer is None:
            continue
        value = 0.5 * float(answer @ information @ answer) - sign * float(target @ answer)
        if value < best:
            best, found = value, sign * answer
    return found


def is_physical_body(body: Array, reach: float, removable: float) -> bool:
    """Whether ten parameters are those of a body as :func:`likeliest_body` finds them, of whatever likelihood.

    Args:
        body: ``(10,)``, all negative where it is taken away.
        reach: largest distance of its parts from the joint [m].
        removable: mass that a link has to lose [kg].
    """
    added = body if body[0] > 0.0 else -body
    if not added[0] > 0.0 or -body[0] > removable * (1.0 + _ROUNDING):
        return False
    # In units of the reach, mass and second moments are alike.
    sizes = np.array([1.0, *[reach] * 3, *[reach**2] * 6])
    values = np.linalg.eigvalsh(pseudo_inertia_matrices(added / sizes))
    within = second_moment(added) <= reach**2 * added[0] * (1.0 + _ROUNDING)
    return bool(values.min() >= -_ROUNDING * values.max() and within)


def second_moment(body: Array) -> float:
    """``∫ |r|² dm`` about the joint, of a body added or taken away [kg·m²]."""
    return 0.5 * abs(float(body[4] + body[6] + body[9]))


def _solve_for_body(information: Array, target: Array, reach: float, most: float) -> Array | None:
    # Scaled before it is factored: moments of inertia and masses are orders of magnitude apart.
    scaled = information * np.outer(_SIZES, _SIZES)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    root = np.sqrt(np.maximum(values, 1e-12 * values.max()))
    matrix = (root[:, None] * vectors.T) / _SIZES
    triangle = _pseudo_inertia()
    second = triangle[[TRIANGLE.index((i, i)) for i in range(3)]].sum(axis=0)
    rows = [reach**2 * np.eye(10)[0] - second]
    bound = [0.0]
    if np.isfinite(most):
        rows.append(-np.eye(10)[0])
        bound.append(-most)
    answer = solve_cone_program(
        ConeProgram(
            matrix=matrix,
            target=(vectors.T @ (target * _SIZES)) / root,
            rows=np.array(rows),
            bound=np.array(bound),
            cones=(triangle[None],),
            weight=np.sqrt(_LEAST_TOLD * values.max()) / _SIZES,
            center=np.zeros(10),
            scale=_SIZES,
        )
    )
    return None if answer is None else answer.z


def _pseudo_inertia() -> Array:
    """Upper triangle of the pseudo-inertia by columns, linear in the ten parameters, ``(10, 10)``."""
    made = np.zeros((10, 10))
    for row, (i, j) in enumerate(TRIANGLE):
        if j < 3:
            made[row, 4 + _INERTIA.index((i, j))] -= 1.0
            if i == j:
                for k in range(3):
                    made[row, 4 + _INERTIA.index((k, k))] += 0.5
        else:
            made[row, 1 + i if i < 3 else 0] = 1.0
    return made


# A joint that sits elsewhere than the model says.


class LinkLengthError(Effect):
    """The joint's placement in its parent shifted: change of all torques per metre along three axes."""

    name = "link_length_error"
    belief = Belief(chance=0.01, width=0.01)
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    linear = tuple(Parameter(f"shift_{axis}", "m", -0.3, 0.3) for axis in "xyz")
    confusable_with = ("link_inertia", "payload", "encoder_offset")
    separating_motion = "fast motion of the joints before it, in several postures"
    mujoco = "body pos"
    moves = True
    by_motion = True

    def is_candidate(self, modelled: tuple[str, ...]) -> bool:
        # Free inertial parameters take up nearly all of it.
        return "rigid_body" not in modelled and self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        robot = context.baseline.samples.robot
        # Of a loop all joints would stand elsewhere.
        looped = set[int]() if robot.mechanism is None else robot.mechanism.looped
        return tuple(name for name in context.joints[1:] if robot.model.getJointId(name) not in looped)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        change = placement_gradient(samples.robot.model, location, *samples.tree_motion, context.baseline.phi)
        stacked = samples.on_motors(change)
        return Shape(
            {j: stacked[:, j] for j in range(stacked.shape[1]) if np.abs(stacked[:, j]).max() > 1e-9}
        )

    def in_mujoco(self, item: Sizes) -> Form:
        def shift_body(draft: Draft) -> None:
            body = draft.moved_body(item.location)
            body.pos = body.pos + np.array([item.value_of(p.name) for p in self.linear])

        return Form(elements=shift_body)


# A body on a link that the model does not have.

# Standard deviations, told for white residuals, by which a mass is below zero that cannot be.
_SURELY = 6.0
# Share of its torques that a body's mass and first moments have at least.
_WEIGHTLESS = 0.05
# Share of its torques by which numbers may miss a body that can exist: what a solver leaves.
_MISSED = 1e-3
# Columns smaller than this share of the largest one are rounding errors, as they are where hypotheses are fitted.
_NOTHING = 1e-7
# Share of what a number may be a priori from which a record says nothing of it.
_UNTOLD = 0.5


def link_columns(context: Context, joint: int) -> Array:
    """Torques per unit of the ten inertial parameters of the body after a joint, ``(n, n_joints, 10)``."""
    s = context.baseline.samples
    key, kept = "regressor", s.motion_cache
    if key not in kept:
        kept[key] = s.rigid_regressor()
    return np.asarray(kept[key][:, :, 10 * (joint - 1) : 10 * joint])


def _find_felt_parameters(context: Context, joint: int) -> NDArray[np.bool_]:
    """Which joints feel which of these parameters, ``(n_joints, 10)``."""
    kept = context.baseline.samples.motion_cache
    key = "felt of a body", joint
    if key not in kept:
        largest = np.abs(link_columns(context, joint)).max(axis=0)
        kept[key] = largest > max(_NOTHING * float(largest.max()), 1e-12)
    return np.asarray(kept[key])


def _column_products(context: Context, joint: int) -> Array:
    """Products of these columns with each other, over all samples and joints, ``(10, 10)``."""
    key, kept = ("power of a body", joint), context.baseline.samples.motion_cache
    if key not in kept:
        columns = link_columns(context, joint).reshape(-1, 10)
        kept[key] = columns.T @ columns
    return np.asarray(kept[key])


class Payload(Effect):
    """The regressor's columns of one body: mass, first moments, inertia (Atkeson, An, Hollerbach 1986)."""

    name = "payload"
    belief = Belief(chance=0.05)
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    linear = tuple(
        Parameter(n, u, width=w)
        for n, u, w in zip(
            ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"),
            ("kg", *["kg·m"] * 3, *["kg·m²"] * 6),
            # A heavy body within half a metre: says nothing but where the motion does not show it.
            (20.0, *[10.0] * 3, *[5.0] * 6),
            strict=True,
        )
    )
    confusable_with = ("link_inertia", "torque_gain")
    separating_motion = "the same motion without the load; wide wrist motion for the place"
    without_motion = "the same motion without the load, or a scale"
    mujoco = "body mass, pos and inertia"
    moves = True
    by_motion = True
    is_body = True

    def is_candidate(self, modelled: tuple[str, ...]) -> bool:
        return "rigid_body" not in modelled and self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        model = context.baseline.samples.robot.model
        return tuple(carried_link(model, k) for k in range(1, model.njoints))

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        joint = self.locations(context).index(location) + 1
        columns, felt = link_columns(context, joint), _find_felt_parameters(context, joint)
        return Shape({j: columns[:, j] for j in range(columns.shape[1]) if felt[j].any()})

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        """Whether it has weight: one that has inertia alone is a rotor that the model lacks."""
        if ARMATURE.is_modelled(context.baseline.modelled):
            return True
        power = _column_products(context, self.locations(context).index(location) + 1)
        torque, weight = float(beta @ power @ beta), float(beta[:4] @ power[:4, :4] @ beta[:4])
        return weight > _WEIGHTLESS**2 * torque

    def is_possible(self, context: Context, location: str, beta: Array) -> bool:
        """Whether they are a body's that can exist, or what a link may lack of its own.

        Of numbers that the motion does not show any will do: a body's mass on an axis that turns about itself.
        """
        model, joint = context.baseline.samples.robot.model, self.locations(context).index(location) + 1
        most, link = largest_reach(model), float(model.inertias[joint].mass)
        if is_physical_body(beta, most, link):
            return True
        power = _column_products(context, joint)
        found = likeliest_body(power, power @ beta, most, link)
        if found is None:
            return False
        missed = found - beta
        return float(missed @ power @ missed) <= _MISSED**2 * float(beta @ power @ beta)

    def nearest_body(
        self, context: Context, location: str, information: Array, target: Array
    ) -> Array | None:
        model, joint = context.baseline.samples.robot.model, self.locations(context).index(location) + 1
        return likeliest_body(information, target, largest_reach(model), float(model.inertias[joint].mass))

    def is_physical(self, context: Context, location: str, fit: Fit) -> bool:
        """Whether link and body together may have their mass, and a body whose mass is told reaches less far than any.

        Less mass than none is another effect's doing. So are grams as far away as a body may be: friction that no law
        fits asks a wrist for a larger body than can exist.
        """
        joint = self.locations(context).index(location) + 1
        mass = float(context.baseline.phi[10 * (joint - 1)]) + float(fit.extra[0])
        most = (1.0 - _AT_REACH) * largest_reach(context.baseline.samples.robot.model)
        if mass <= -_SURELY * float(fit.extra_std[0]):
            return False
        within = second_moment(fit.extra) < most**2 * abs(float(fit.extra[0]))
        return within or not self._are_told(context, location, fit)[0]

    def _are_told(self, context: Context, location: str, fit: Fit) -> NDArray[np.bool_]:
        """Which of the ten parameters the record tells."""
        felt = np.any(_find_felt_parameters(context, self.locations(context).index(location) + 1), axis=0)
        return np.asarray(felt & (fit.extra_std < _UNTOLD * self.prior_widths))

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        """What the joints tell of the body; where they do not tell its mass, its first moment comes first."""
        found = super().to_estimates(context, location, theta, fit)
        told = self._are_told(context, location, fit)
        shown = {p.name: found[p.name] for p, here in zip(self.linear, told, strict=True) if here}
        if told[0] or not told[1:4].any():
            return shown
        moment, spread = fit.extra[1:4] * told[1:4], fit.extra_std[1:4] * told[1:4]
        size = float(np.linalg.norm(moment))
        std = float(np.linalg.norm(moment * spread) / max(size, 1e-300))
        return {"first_moment": Estimate(size, std, "kg·m")} | shown

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(body=np.array([item.value_of(p.name) for p in self.linear]))


# How far from the joint that carries it a body may lie.

# No gripper or tool of the records is longer [m]; their arms are about a metre long.
_TOOL_M = 0.6
# Of larger machines as long a share of their length: an excavator's bucket hangs 1.5 m from a joint, and what it holds
# within 0.6 m was told as gains of two joints, a lighter stick, backlash, a rotor and a wrong length.
_SHARE = 0.5


def largest_reach(model: pin.Model) -> float:
    """Largest distance of a body's parts from the joint that carries it [m].

    Args:
        model: of the robot; wherever it is mounted.
    """
    length = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        step = np.linalg.norm(model.jointPlacements[joint].translation) if parent > 0 else 0.0
        length[joint] = length[parent] + step
    tips = [2.0 * np.linalg.norm(inertia.lever) if inertia.mass > 0.0 else 0.0 for inertia in model.inertias]
    return max(_TOOL_M, _SHARE * float((length + tips)[1:].max(initial=0.0)))


# A body that is on a link in some of a record's trials and not in the others.


class PartTimePayload(Payload):
    """The columns of one body in the trials that have it, nothing in the others.

    Bodies that are fitted to all trials alike do not take it up: it can be told whatever is modelled.

    Attributes:
        trials: names of the trials that have the body.
    """

    def __init__(self, trials: Collection[str]) -> None:
        self.trials = frozenset(trials)

    def is_candidate(self, modelled: tuple[str, ...]) -> bool:
        return self.name not in modelled

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        trials = context.baseline.samples.trials
        there = np.concatenate([np.full(len(t.time), t.name in self.trials) for t in trials])
        columns = super().shape(context, location, theta).columns
        return Shape({j: block * there[:, None] for j, block in columns.items()})

    def is_physical(self, context: Context, location: str, fit: Fit) -> bool:
        # What some trials have more, others have less: its sign was chosen with the trials.
        return True

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(absent=Absence.SOME_TRIALS)
