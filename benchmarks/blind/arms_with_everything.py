"""Cases with many effects at once: how they are drawn, simulated with and without each effect, and scored."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from benchmarks.blind.answers import Stated
from benchmarks.blind.arm_case import FAULTS, N_TRIALS, N_VALIDATION, Arm, arm_of
from benchmarks.blind.case import log_session, noise_of, recordings_of
from benchmarks.blind.case_score import same_effect
from benchmarks.blind.detectability import DETECTABLE, Band, band_rows
from benchmarks.blind.documents import Answer, HiddenEffect, JointGap
from benchmarks.blind.draw import ROBOTS
from benchmarks.blind.forms import FORMS, NEEDS_GIVEN_INERTIA, OWN_TERMS
from benchmarks.blind.magnitudes import MAKERS, Site
from excite.arrays import Array
from excite.logs.log import Log
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.sensing import log_header
from excite.simulation.virtual_robot import Recording, VirtualRobot

# One case with a little of everything: simulated with all, without each and with each alone, and logged once.

# A gap that is a thousandth of the noise's power in the band is none.
_NO_GAP = 1e-3


def build_mixture(plan: Mixture, rng: np.random.Generator) -> tuple[Log, Answer]:
    """Simulate one case.

    Args:
        plan: what it is to have.
        rng: source of the arm, its motions and its noise.

    Returns:
        Its log and what is hidden in it, with the true shares of every joint's gap.
    """
    arm = arm_of(load_robot(plan.robot), plan.fixed, rng)
    modelled = ("rigid_body_fixed" if plan.fixed else "rigid_body", *OWN_TERMS)
    everything = range(len(plan.ingredients))

    def simulated(kept: Collection[int]) -> list[Recording]:
        return recordings_of(robot_with(arm, plan.ingredients, kept)[0], arm)

    recordings = simulated(everything)
    sigma = noise_of(recordings, plan.noise)
    band = Band.of(recordings[0], sigma)
    robot = arm.virtual.robot

    def left(runs: list[Recording]) -> np.ndarray:
        return left_over(robot, runs, modelled, band)

    shares = true_shares(
        left(recordings),
        [left(simulated([k for k in everything if k != out])) for out in everything],
        [left(simulated([only])) for only in everything],
        left(simulated([])),
        _NO_GAP * band.noise**2,
    )
    names, open_ = robot.joint_names, shares.gap > 0.0
    hidden = []
    for effect, share in zip(robot_with(arm, plan.ingredients, everything)[1], shares.share, strict=True):
        taken = {name: float(x) for name, x, there in zip(names, share, open_, strict=True) if there}
        hidden.append(replace(effect, shares=taken))
    joints = {
        name: JointGap(float(np.sqrt(gap)), float(noise), float(together))
        for name, gap, noise, together in zip(names, shares.gap, band.noise, shares.together, strict=True)
        if gap > 0.0
    }
    trials, headers = log_session(recordings, arm, plan.noise, plan.faults, sigma, rng)
    header = log_header(robot, headers).model_copy(update={"modelled": modelled})
    log = Log(header=header, trials=trials, robot_text=robot.urdf)
    hidden.sort(key=lambda item: -max(item.shares.values(), default=0.0))
    return log, Answer(
        "everything", plan.robot, modelled, tuple(hidden), plan.noise, plan.faults, joints=joints
    )


def robot_with(
    arm: Arm, ingredients: tuple[Ingredient, ...], kept: Collection[int]
) -> tuple[VirtualRobot, tuple[HiddenEffect, ...]]:
    """The robot with some of the ingredients, each the same whatever the others are; and what those are."""
    virtual = arm.virtual
    hidden: list[HiddenEffect] = []
    for k, item in enumerate(ingredients):
        if k not in kept:
            continue
        rng = np.random.default_rng(item.seed)
        sign = float(rng.choice([-1.0, 1.0]))
        site = Site(virtual, arm, item.effect, item.form, item.joint, item.size, sign, rng)
        virtual, what = MAKERS[item.effect](site)
        hidden.append(what)
    return virtual, tuple(hidden)


# Which effects an arm with a little of everything has, where, in what form and how large.

FEWEST, MOST = 3, 8
# Of the usual magnitude: from what no log shows to what rules its joint.
SMALLEST, LARGEST = 0.03, 1.5
# At most one of a group: two of them in one robot, or at one joint, are one effect with two names.
_ONE_A_ROBOT = (
    frozenset({"time_delay", "actuator_lag"}),
    frozenset({"base_tilt"}),
    # A simulated gear halves the step and every further one slows all steps.
    frozenset({"backlash", "joint_elasticity"}),
)
_ONE_A_JOINT = (
    frozenset({"torque_bias", "coulomb_asymmetry"}),
    frozenset({"payload", "link_inertia"}),
)
# Terms of ``modelled`` are all there, and what has no name is no effect that anyone could name.
_CHOICE = tuple(name for name in FORMS if name not in {*OWN_TERMS, "unknown"})
# Bristles take the place of dry friction, which further laws at a joint need.
_FORMS = {name: tuple(form for form in FORMS[name] if form != "bristle") for name in _CHOICE}


@dataclass(frozen=True)
class Ingredient:
    """One effect before it is hidden.

    Attributes:
        effect: its name.
        form: which of its forms.
        joint: index of the joint, or of the link behind it.
        size: factor on the usual magnitude.
        seed: of everything else about it.
    """

    effect: str
    form: str
    joint: int
    size: float
    seed: int


@dataclass(frozen=True)
class Mixture:
    """A case before it is simulated.

    Attributes:
        robot: name of the robot.
        fixed: whether inertial parameters are given.
        noise: factor on the usual noise.
        faults: kinds of faults of the record.
        ingredients: what is hidden.
    """

    robot: str
    fixed: bool
    noise: float
    faults: tuple[str, ...]
    ingredients: tuple[Ingredient, ...]


def draw_mixture(rng: np.random.Generator, robots: tuple[str, ...] = ROBOTS) -> Mixture:
    """Draw a case: three to eight effects, whose places go through all joints before one has its second.

    Args:
        rng: source of what is drawn.
        robots: to choose from.

    Returns:
        The draft.
    """
    robot = robots[int(rng.integers(len(robots)))]
    joints = load_robot(robot).n_joints
    fixed = bool(rng.random() < 0.4)
    noise = float(rng.choice([1.0, 1.0, 1.5]))
    faults = (str(rng.choice(sorted(FAULTS))),) if rng.random() < 0.3 else ()
    count = int(rng.integers(FEWEST, MOST + 1))
    places = np.concatenate([rng.permutation(joints) for _ in range(-(-count // joints))])[:count]
    made: list[Ingredient] = []
    for place in places:
        free = [name for name in _CHOICE if _fits_at(name, int(place), made, fixed, joints)]
        name = str(rng.choice(free))
        size = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
        made.append(
            Ingredient(name, str(rng.choice(_FORMS[name])), int(place), size, int(rng.integers(1 << 31)))
        )
    return Mixture(robot, fixed, noise, faults, tuple(made))


def _fits_at(name: str, joint: int, made: list[Ingredient], fixed: bool, joints: int) -> bool:
    """Whether an effect can be at a joint beside those that are drawn already."""
    if name in NEEDS_GIVEN_INERTIA and not (fixed and 0 < joint < joints - 1):
        return False
    here = {item.effect for item in made if item.joint == joint}
    anywhere = {item.effect for item in made}
    if name in here or any(name in group and group & anywhere for group in _ONE_A_ROBOT):
        return False
    # A drive that lags makes a gear behind it ring.
    if name == "actuator_lag" and anywhere & {"backlash", "joint_elasticity"}:
        return False
    if name in {"backlash", "joint_elasticity"} and "actuator_lag" in anywhere:
        return False
    return not any(name in group and group & here for group in _ONE_A_JOINT)


# What each hidden effect truly takes of every joint's gap, from simulations without noise.

Recordings = Sequence[Recording]


@dataclass(frozen=True, eq=False)
class TrueShares:
    """Where the gap of each joint truly goes.

    Attributes:
        gap: ``(n_joints,)`` mean square of what the modelled terms leave of the validation trials, less what they
            leave of the same robot without any hidden effect [N²·m²].
        share: ``(n_effects, n_joints)`` of the gap; zero where a joint has none.
        together: ``(n_joints,)`` what only several effects at once take: one less the sum of the shares.
    """

    gap: Array
    share: Array
    together: Array


def true_shares(
    power: Array, without: Sequence[Array], alone: Sequence[Array], none: Array, least: Array
) -> TrueShares:
    """Shares from what is left of robots with and without effects.

    An effect's share is the mean of what the gap loses when it is taken out of everything, and what it makes where
    nothing else is. For effects whose torques add up both differ by their overlaps with others, and the mean is its
    Shapley value (Shapley 1953): shares then add up to one. What they lack is kept as ``together``.

    Args:
        power: ``(n_joints,)`` what the modelled terms leave with all effects [N²·m²].
        without: the same without each effect.
        alone: the same with each effect alone.
        none: the same without any.
        least: ``(n_joints,)`` a gap below this is none [N²·m²].

    Returns:
        The shares.
    """
    gap = np.where(power - none > least, power - none, 0.0)
    parts = [0.5 * ((power - out) + (only - none)) for out, only in zip(without, alone, strict=True)]
    there = gap > 0.0
    shares = np.array([np.where(there, part / np.where(there, gap, 1.0), 0.0) for part in parts])
    return TrueShares(gap, shares, np.where(there, 1.0 - shares.sum(axis=0), 0.0))


def left_over(robot: Robot, runs: Recordings, modelled: Sequence[str], band: Band) -> Array:
    """Mean square that the modelled terms leave of the validation trials, ``(n_joints,)`` [N²·m²].

    They are fitted to the identification trials by least squares, each joint weighted by its noise; rows at which a
    joint stands count for neither.

    Args:
        robot: the nominal model.
        runs: identification trials, then those for validation; more are not looked at.
        modelled: words of ``modelled`` of the log.
        band: what is looked at, and the noise in it.
    """
    parts = [band_rows(robot, run, modelled, band.sos) for run in runs[: N_TRIALS + N_VALIDATION]]
    learn, judge = (
        [np.concatenate([part[k] for part in chosen]) for k in range(3)]
        for chosen in (parts[:N_TRIALS], parts[N_TRIALS:])
    )
    torque, columns, moving = learn
    weight = moving / band.noise
    rows = (columns * weight[:, :, None]).reshape(-1, columns.shape[2])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
    fitted = np.linalg.lstsq(rows / scale, (torque * weight).ravel(), rcond=1e-9)[0] / scale
    torque, columns, moving = judge
    rest = (torque - columns @ fitted) * moving
    return np.asarray((rest**2).sum(axis=0) / np.maximum(moving.sum(axis=0), 1.0))


# What is said of arms with a little of everything, compared with the true shares.

LARGE = 0.1
"""Share of a joint's gap from which on an effect is to be found."""


@dataclass(frozen=True)
class SharePair:
    """An effect and a joint of whose gap it takes a tenth or more.

    Attributes:
        effect: name of the effect.
        location: its place.
        joint: the joint.
        share: the true share of that joint's gap.
        found: 1 where it is named at its place, 1/k where that is one of k places said to be alike, else 0.
        stated: the share that is stated, None where none is.
        inside: whether the true share is inside the stated 90 % interval, None where none is stated.
    """

    effect: str
    location: str
    joint: str
    share: float
    found: float
    stated: float | None
    inside: bool | None


@dataclass(frozen=True)
class MixtureScore:
    """One case.

    Attributes:
        case: its name.
        pairs: all effects that are to be found, by joint.
        right: for each effect that is named, how right: 1, 1/k as in ``found``, or 0 where it is not there.
        right_large: the same of those that are said to take a tenth or more of some joint's gap.
    """

    case: str
    pairs: tuple[SharePair, ...]
    right: tuple[float, ...]
    right_large: tuple[float, ...]


def score_mixture(case: str, answer: Answer, stated: Sequence[Stated]) -> MixtureScore:
    """Compare what is said with the true shares.

    An effect is to be found where it takes :data:`LARGE` or more of the gap of a joint and stands above the noise
    there as far as :data:`~benchmarks.blind.detectability.DETECTABLE` asks.

    Args:
        case: name of the case.
        answer: what is hidden.
        stated: what is said.

    Returns:
        The comparison.
    """
    pairs = []
    for hidden in answer.effects:
        best = max(stated, key=lambda item: _effect_credit(hidden, item), default=None)
        credit = 0.0 if best is None else _effect_credit(hidden, best)
        for joint, share in hidden.shares.items():
            there = answer.joints[joint]
            if share < LARGE or share**0.5 * there.gap < DETECTABLE * there.noise:
                continue
            said = best.shares.get(joint) if best is not None and credit else None
            interval = best.intervals.get(joint) if best is not None and credit else None
            inside = None if interval is None else interval[0] <= share <= interval[1]
            pairs.append(SharePair(hidden.effect, hidden.location, joint, share, credit, said, inside))
    right = [max((_effect_credit(hidden, item) for hidden in answer.effects), default=0.0) for item in stated]
    large = [
        mark
        for mark, item in zip(right, stated, strict=True)
        if max(item.shares.values(), default=0.0) >= LARGE
    ]
    return MixtureScore(case, tuple(pairs), tuple(right), tuple(large))


def _effect_credit(hidden: HiddenEffect, said: Stated) -> float:
    if not same_effect(hidden.effect, said.effect):
        return 0.0
    if hidden.location != said.location and hidden.location not in said.tied:
        return 0.0
    return 1.0 / (1 + len(said.tied))


def mixture_figures(scores: Iterable[MixtureScore]) -> dict[str, float | None]:
    """Figures of all such cases; None where nothing is to be counted."""
    scores = tuple(scores)
    pairs = [pair for score in scores for pair in score.pairs]
    # An effect of several joints counts once.
    found = {(s.case, p.effect, p.location): p.found for s in scores for p in s.pairs}
    stated = [pair for pair in pairs if pair.stated is not None]
    inside = [pair.inside for pair in pairs if pair.inside is not None]
    weight = sum(pair.share for pair in pairs)
    return {
        "everything_cases": float(len(scores)),
        "everything_effects": float(len(found)),
        "everything_share_found": sum(p.share * p.found for p in pairs) / weight if weight else None,
        "everything_found": _mean_or_none(list(found.values())),
        "everything_named_right": _mean_or_none([mark for score in scores for mark in score.right]),
        "everything_large_named_right": _mean_or_none(
            [mark for score in scores for mark in score.right_large]
        ),
        "everything_share_error_median": median(abs((p.stated or 0.0) - p.share) for p in stated)
        if stated
        else None,
        "everything_share_inside": _mean_or_none([float(mark) for mark in inside]),
    }


def _mean_or_none(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None
