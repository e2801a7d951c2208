"""How a bare model rests: on feet, on its base, or held; in which posture; and which links touch in it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from excite.arrays import Array
from excite.errors import MotionError
from excite.results import Assumed
from excite.robot.description import Base
from excite.robot.init_robot.assumptions import assume
from excite.robot.init_robot.limbs import Figure, FootGuess, Footing, Standing
from excite.robot.legs import TORQUE_SHARE, holding_torques, usable_torque
from excite.robot.mechanisms.mechanism import limb_columns
from excite.robot.shapes.collision import PairSearch, ground_height, review_pairs
from excite.robot.shapes.shape import has_area
from excite.robot.urdf.converted import Said


@dataclass(frozen=True, eq=False)
class Rest:
    """How a robot rests.

    Attributes:
        base: ``fixed``, ``floating`` or ``held``.
        q: posture ``(n_joints,)``.
        legs: joints at the legs' ends; empty unless it floats.
        feet: on which it stands, in the order of ``legs``.
        ignored: pairs of links that need not stay apart.
        near: distance that pairs keep which rest nearer than the margin [m].
        source: how the posture was found.
        assumed: what had to be assumed.
    """

    base: Base
    q: Array
    legs: tuple[int, ...]
    feet: tuple[FootGuess, ...]
    ignored: tuple[tuple[str, str], ...]
    near: Mapping[tuple[str, str], float]
    source: str
    assumed: tuple[Assumed, ...]


def find_rest(figure: Figure, wanted: Array, said: Said, rng: np.random.Generator) -> Rest:
    """Find how a robot rests; ``wanted`` ``(n_joints,)`` is where the search starts."""
    search = PairSearch(figure.robot)
    review = review_pairs(figure.robot, rng, 100, search, wanted)
    allowed = frozenset((*review.ignored, *said.ignored, *((b, a) for a, b in said.ignored)))
    postures = Postures(figure, search, wanted, said.floating, allowed, rng)
    unsteady = postures.explain_held() if postures.legs or said.floating else ""
    if unsteady and np.any(wanted):
        # A model's own posture may be none that it stands in: MuJoCo's key frames of some lie, fold legs, or leap.
        other = Postures(figure, search, np.zeros_like(wanted), said.floating, allowed, rng)
        if not other.explain_held():
            postures, unsteady = other, ""
    base: Base = "floating" if postures.legs else "fixed"
    notes: list[Assumed] = []
    if not postures.legs and said.floating is None and figure.has_folded_legs(wanted):
        unsteady = "its legs lie flat about its base in the file: hold the robot up, legs free, or state how it stands"
    if unsteady:
        base = "held"
        notes.append(assume("held base", why=unsteady))
    feet: tuple[FootGuess, ...] = ()
    if postures.standing is not None and base == "floating":
        q, feet = postures.standing.q, postures.standing.feet
        source = "found: feet on one plane, centre of mass above the middle of what soles and ankles hold"
    else:
        ground = ground_height(figure.model, figure.shapes, wanted, held_up=base == "held")
        # Room between moving links and the ground at rest, of the longest limb's length: of 12 candidates of a UR5 that
        # rests stretched out at 0.09 m the ground refuses 7; with this much room 4.
        above = [ground] if said.posture is not None else [ground + 0.15 * figure.reach, ground]
        source = "found near zero, or the model's own posture: free of collision, above the ground"
        q = _first_clear(postures, [*above, None], wanted)
    q = np.round(q, 5)
    # Links that rest so close to the margin [m] refuse every motion, which begins and ends there: the filter and the
    # independent check build their shapes anew (iCub's hip and torso, apart at rest, were refused at 9.97 of 10 mm).
    touching = postures.touching_pairs(q, 1e-3)
    if touching:
        notes.append(assume("touching", names=", ".join(f"{a} and {b}" for a, b in touching[:5])))
    unknown = sorted(link for link in {*chain(*said.ignored)} if not figure.model.existBodyName(link))
    notes += [assume("unknown pairs", names=", ".join(unknown))] if unknown else []
    stated = {pair for a, b in said.ignored for pair in ((a, b), (b, a))} & set(search.pairs)
    ignored = tuple(dict.fromkeys((*review.never, *(p for p in search.pairs if p in stated))))
    near = _near_pairs(search, q, postures.margin, (*review.at_rest, *review.always, *touching), stated)
    if near:
        notes.append(assume("near pairs", always=len(review.always), at_rest=len(review.at_rest)))
    if ignored:
        notes.append(assume("ignored pairs", never=len(review.never), stated=len(stated)))
    if base != "held":
        # Of one that is held it stands there why.
        notes.insert(0, assume(f"{base} base"))
    legs = tuple(postures.legs) if base == "floating" else ()
    return Rest(base, q, legs, feet, ignored, near, source, tuple(notes))


def _near_pairs(
    search: PairSearch,
    q: Array,
    margin: float,
    pairs: Iterable[tuple[str, str]],
    stated: set[tuple[str, str]],
) -> dict[tuple[str, str], float]:
    """Least distance of pairs that rest nearer than the margin, by what it is at rest ``q`` [m].

    Hulls contain their bodies: those that are apart at rest may not meet. Where hulls overlap at rest, bodies turn in
    each other, and how deep the overlap is changes by millimetres with their joints (of G1 and Talos by 8, but for
    hips): that much, the margin, they may overlap deeper. A limb that goes through a trunk overlaps it by centimetres.
    """
    at_rest = dict(zip(search.pairs, search.link_distances(search.whole_posture(q)), strict=True))
    return {
        pair: 0.0 if at_rest[pair] >= 0.0 else float(np.floor(1e4 * (at_rest[pair] - margin)) / 1e4)
        for pair in dict.fromkeys(pairs)
        if pair not in stated
    }


def _first_clear(postures: Postures, heights: list[float | None], wanted: Array) -> Array:
    """A clear posture above the first of some heights where one can be held; else the first of those that cannot."""
    strained: list[Array] = []
    for height in heights:
        q = postures.find_clear(height)
        if q is not None and postures.torque_strain(q) <= 1.0:
            return q
        strained += [] if q is None else [q]
    return strained[0] if strained else wanted


def weak_joints(figure: Figure, rest: Rest) -> dict[str, float]:
    """Joints outside legs whose drives cannot hold the robot at rest, springs of a suspension among them, and where
    they are then [rad or m]."""
    robot = figure.robot
    usable = usable_torque(robot, np.full(robot.n_joints, TORQUE_SHARE), robot.limits.velocity)
    strained = np.abs(holding_torques(robot, rest.q[None]))[0] > usable
    strained[[joint - 1 for leg in rest.legs for joint in figure.joint_chain(leg)]] = False
    return {robot.joint_names[i]: float(rest.q[i]) for i in np.flatnonzero(strained)}


# A posture in which a bare model rests: upright on its legs, or free of collision above its ground.

# Room that motions need about a standing posture: of the legs' joints to their limits [rad], between links and below
# all that is no leg [m]. Sways of the Go2 and the HyQ turn knees by some 0.3 rad (with 0.16 rad of room no candidate of
# either passes, with 0.35 most do); candidates of a humanoid whose links rest at the margin collide; a hexapod whose
# belly rests 4 mm above the ground touches it as soon as it carries more.
_ROOM, _APART = 0.35, 0.02
# Angle of knees from which a leg can lift and lower its hip both ways [rad]: the bundled humanoids stand with 0.7.
_BEND = 0.6
# Least speed of a point foot at unit speed of its leg's joints, of its distance from the hip, so that it can follow in
# every direction. Other makers' quadrupeds have 0.2 … 0.3; on legs with 0.14 (ANYmal's hind ones, little bent) and 0.10
# (CENTAURO's, whose feet rest below the axes that turn their hips) most and all of the candidates are out of reach.
_AGILE = 0.2
# Random postures of what does not stand, from near the wanted posture outwards; a dual arm needs some tens.
_TRIES = 300


class _Tried(NamedTuple):
    """A posture on feet, pairs of links that touch in it, and whether its legs are bent."""

    stand: Standing
    touching: frozenset[tuple[str, str]]
    bent: bool


class Postures:
    """Searches postures of a figure within its limits, a tenth of each range away from them where possible.

    Args:
        figure: the robot.
        search: of its links' distances.
        wanted: posture from which others are sought ``(n_joints,)``.
        free: whether the model says that its base is free; None where it does not say.
        ignored: pairs of links that may touch.
        rng: draws postures.

    Attributes:
        legs: joints at the ends of the limbs that the robot stands on in the wanted posture.
        standing: how it stands on them; None where it does not.
        margin: distance that links keep [m].
    """

    def __init__(
        self,
        figure: Figure,
        search: PairSearch,
        wanted: Array,
        free: bool | None,
        ignored: frozenset[tuple[str, str]],
        rng: np.random.Generator,
    ) -> None:
        self.figure, self.search, self.ignored, self.rng = figure, search, ignored, rng
        robot, limits = figure.robot, figure.robot.limits
        room = 0.1 * (limits.position_upper - limits.position_lower)
        self.lower, self.upper = limits.position_lower + room, limits.position_upper - room
        self.wanted = np.clip(wanted, limits.position_lower, limits.position_upper)
        self.margin = robot.description.collision.margin
        self.usable = usable_torque(robot, np.full(robot.n_joints, TORQUE_SHARE), limits.velocity)
        self.footing = Footing(figure, self.lower, self.upper, self.wanted)
        self.legs = [] if free is False else figure.find_legs(wanted, free=bool(free))
        self.of_legs = {joint for leg in self.legs for joint in figure.joint_chain(leg)}
        known = self.legs and not figure.is_guessed(self.legs)
        self.standing = self._find_standing() if known else None

    def explain_held(self) -> str:
        """Why a robot that ought to stand on legs is held; empty where it stands."""
        figure, mechanism, standing = self.figure, self.figure.robot.mechanism, self.standing
        if not self.legs:
            return "no legs were found that it could stand on: hold it still"
        if figure.is_guessed(self.legs):
            return "no geometry says where its soles are: hold the robot up, legs free"
        if standing is None:
            return "no standing posture was found: hold the robot up, legs free"
        if not has_area(self.footing.sole_corners(standing, self.legs)):
            return "its feet span no area to stand on: hold the robot up, legs free"
        # To move a trunk forth, aside and up: six coordinates of the base and the legs' less what the feet hold, six of
        # a sole and three of a point or an edge.
        held = sum(6 if len(foot.sole) >= 3 else 3 for foot in standing.feet)
        if 6 + len(self.of_legs) - held < 3:
            return "its legs have too few joints to move it over feet that stay: hold the robot up, legs free"
        columns = limb_columns(figure.model, self.legs)
        # Joints that have to follow from others, which feet that stay do not let them.
        if mechanism is not None and np.isin(mechanism.following_from(columns).passive, columns).any():
            return "joints of its legs follow from others, and no balance was planned so: hold the robot up, legs free"
        return ""

    def find_clear(self, ground: float | None) -> Array | None:
        """A posture near the wanted one without collision and above the ground that the drives can hold; one that
        strains them least where none can be held, None where all collide."""
        tries = [self._part_links(self.wanted, set()), self.wanted]
        for number in range(_TRIES):
            goal = self.rng.uniform(self.lower, self.upper)
            tries.append(self.wanted + (number + 1) / _TRIES * (goal - self.wanted))
        least: tuple[float, Array] | None = None
        for q in (closed for near in tries if (closed := self._close_posture(near)) is not None):
            eased = self._ease_posture(q)
            strain = self.torque_strain(eased)
            if least is not None and strain >= least[0]:
                continue
            low, parents = self.figure.lowest_heights(eased), self.figure.model.parents
            least_height = min((low[joint] for joint in low if joint and parents[joint]), default=np.inf)
            if self.touching_pairs(eased) or (ground is not None and least_height < ground + self.margin):
                continue
            least = strain, eased
            if strain <= 1.0:
                break
        return None if least is None else least[1]

    def _close_posture(self, q: Array) -> Array | None:
        """A posture with what follows from others where it follows to, None out of reach or limits."""
        robot = self.figure.robot
        if robot.mechanism is None:
            return q
        try:
            q = robot.mechanism.close_configurations(q[None])[0]
        except MotionError:
            return None
        inside = (q >= robot.limits.position_lower) & (q <= robot.limits.position_upper)
        return q if inside.all() else None

    def torque_strain(self, q: Array) -> float:
        """The largest torque that holds a posture, of what motions may use of it."""
        return float(np.abs(holding_torques(self.figure.robot, q[None]) / self.usable).max(initial=0.0))

    def _ease_posture(self, q: Array) -> Array:
        """A posture near ``q`` that the drives can hold, as far as one is found downhill from it."""
        if self.torque_strain(q) <= 1.0 or self.figure.robot.mechanism is not None:
            return q
        model, data = self.figure.model, self.figure.data

        def torque_excess(at: Array) -> tuple[float, Array]:
            strain = pin.computeGeneralizedGravity(model, data, at) / self.usable
            # Share of the usable torque down to which a posture is eased: beside it there must be others that can be
            # held, too.
            over = np.sign(strain) * np.maximum(np.abs(strain) - 0.8, 0.0)
            slope = pin.computeGeneralizedGravityDerivatives(model, data, at) / self.usable[:, None]
            return float(over @ over), 2.0 * over @ slope

        bounds = list(zip(self.lower, self.upper, strict=True))
        start = np.clip(q, self.lower, self.upper)
        return np.asarray(minimize(torque_excess, start, jac=True, method="L-BFGS-B", bounds=bounds).x)

    def _link_distances(self, q: Array) -> dict[tuple[str, str], float]:
        """Distances of the links that have to keep one [m]."""
        found = zip(self.search.pairs, self.search.link_distances(self.search.whole_posture(q)), strict=True)
        return {pair: float(distance) for pair, distance in found if pair not in self.ignored}

    def touching_pairs(self, q: Array, slack: float = 0.0) -> list[tuple[str, str]]:
        """Pairs of links closer than the margin and some slack [m], those left out that are ignored."""
        return [pair for pair, distance in self._link_distances(q).items() if distance < self.margin + slack]

    def _find_standing(self) -> Standing | None:
        """A posture with all feet on one plane, the centre of mass where they hold it, and nothing touching.

        What links of a leg and of its trunk touch in all postures on bent legs does not count: hulls of hips and ankles
        are larger than what turns in them, and a robot on straight legs can move nothing but its arms.
        """
        stances = Stances(self.figure, self.lower, self.upper, self.wanted)
        tried = self._try_stances(stances.bent_stances(self.legs))
        if (
            not tried
            or self._least_distance(self.footing.foot_agility, self._choose_best(tried).stand) < _AGILE
        ):
            tried += self._try_stances(stances.wide_stances(self.legs))
        if not tried:
            return None
        best, stated = self._choose_best(tried), self.ignored
        self.ignored = stated | self._of_hulls(tried)
        if self.touching_pairs(best.stand.q):
            # The same feet with arms and head out of the way, if that can be; else as far as it could.
            found = self.footing.find_stance(self._part_links(best.stand.q, self.of_legs), self.legs)
            if found is not None and len(self.touching_pairs(found.q)) < len(
                self.touching_pairs(best.stand.q)
            ):
                best = best._replace(stand=found)
        self.ignored = stated
        return best.stand

    def _try_stances(self, starts: list[Array]) -> list[_Tried]:
        """What is found from some starts, up to the first that leaves nothing to wish for."""
        tried: list[_Tried] = []
        for start in starts:
            found = self.footing.find_stance(start, self.legs)
            if found is None:
                continue
            touching = frozenset(self.touching_pairs(found.q))
            tried.append(
                _Tried(found, touching, self._least_distance(self.footing.knee_bend, found) >= _BEND)
            )
            if not touching and self._room_left(found) >= 1.0:
                break
        return tried

    def _choose_best(self, tried: list[_Tried]) -> _Tried:
        """The one with the most room, and with the fewest pairs that touch."""
        of_hulls = self._of_hulls(tried)
        return max(tried, key=lambda one: self._room_left(one.stand, of_hulls) - len(one.touching - of_hulls))

    def _of_hulls(self, tried: list[_Tried]) -> frozenset[tuple[str, str]]:
        """Pairs of links with only joints of legs between them that touch in every posture on bent legs."""
        bent = [one.touching for one in tried if one.bent]
        common = frozenset.intersection(*bent) if bent else frozenset[tuple[str, str]]()
        return frozenset(pair for pair in common if set(self.search.joints_between(pair)) <= self.of_legs)

    def _least_distance(self, measure: Callable[[Standing, int, FootGuess], float], stand: Standing) -> float:
        return min(measure(stand, leg, foot) for leg, foot in zip(self.legs, stand.feet, strict=True))

    def _room_left(self, stand: Standing, apart_from: Collection[tuple[str, str]] = ()) -> float:
        """How much of the room that motions need is there, 0 … 1, some pairs of links left out."""
        q, limits = stand.q, self.figure.robot.limits
        joints = sorted(joint - 1 for joint in self.of_legs)
        to_limits = np.minimum(q - limits.position_lower, limits.position_upper - q)[joints]
        apart = [one - self.margin for pair, one in self._link_distances(q).items() if pair not in apart_from]
        low = self.figure.lowest_heights(q)
        ground = min(low[leg] for leg in self.legs) + self.margin
        above = [low[joint] - ground for joint in low if joint not in self.of_legs]
        shares = (
            float(to_limits.min(initial=_ROOM)) / _ROOM,
            min(apart, default=_APART) / _APART,
            min(above, default=_APART) / _APART,
            self._least_distance(self.footing.knee_bend, stand) / _BEND,
            self._least_distance(self.footing.foot_agility, stand) / _AGILE,
        )
        return sum(min(max(share, 0.0), 1.0) for share in shares) / len(shares)

    def _part_links(self, q: Array, kept: set[int]) -> Array:
        """Fewer links touching: pair by pair, joints between its links are drawn anew, but for those ``kept``."""
        touching = self.touching_pairs(q)
        for number in range(_TRIES):
            if not touching:
                break
            between = set(self.search.joints_between(touching[number % len(touching)])) - kept
            places = [joint - 1 for joint in between]
            share = min(1.0, 0.1 + number / (0.5 * _TRIES))
            drawn = q.copy()
            goal = self.rng.uniform(self.lower, self.upper)
            drawn[places] += share * (goal - q)[places]
            after = self.touching_pairs(drawn)
            if len(after) < len(touching):
                q, touching = drawn, after
        return q


# Postures from which a standing one is sought: legs bent, spread or sprawled, the rest as wanted.

# Bends of hip, knee and ankle from which standing postures are sought, and how far hips turn out [rad].
_BENDS = (0.5, -0.5, 0.7, -0.7, 0.35, -0.35, 0.9, -0.9, 0.2, -0.2)
# Cosine of 37 degrees: axes this near to each other, or to the ground, count as along them.
_ALONG = 0.8


class Stances:
    """First guesses of standing postures.

    Args:
        figure: the robot.
        lower, upper: where joints should stay ``(n_joints,)`` [rad or m].
        wanted: posture of what is no leg ``(n_joints,)``.
    """

    def __init__(self, figure: Figure, lower: Array, upper: Array, wanted: Array) -> None:
        self.figure, self.lower, self.upper, self.wanted = figure, lower, upper, wanted
        # Axes of the joints, and where they are, with all at zero.
        jacobian = pin.computeJointJacobians(figure.model, figure.data, pin.neutral(figure.model))
        self.axes = jacobian[3:].T.copy()
        self.sides = np.sign([place.translation[1] for place in figure.data.oMi])

    def bent_stances(self, legs: list[int]) -> list[Array]:
        """In the order in which they are tried."""
        starts = [self.wanted] if np.any(self.wanted) else []
        starts += [self._bend_knees(legs, bend, wide) for wide in (0.0, 0.12) for bend in _BENDS]
        return [*starts, self.wanted]

    def wide_stances(self, legs: list[int]) -> list[Array]:
        """More of them, for legs whose feet cannot follow in every direction from the others."""
        return [self._sprawl_legs(legs, bend) for bend in _BENDS if bend > 0.0]

    def _sprawl_legs(self, legs: list[int], bend: float) -> Array:
        """The wanted posture with thighs out and shanks down."""
        q, data = self.wanted.copy(), self.figure.data
        for leg in legs:
            pitch, signs = self._pitch_joints(leg)
            reached = []
            for side in (1.0, -1.0) if len(pitch) > 1 else ():
                tried = q.copy()
                tried[pitch[:2]] = side * bend * np.array([1.0, -1.0]) * signs[:2]
                self.figure.mass_centre(tried)
                reached.append((float(np.linalg.norm(data.oMi[leg].translation[:2])), tried))
            q = max(reached, key=lambda one: one[0], default=(0.0, q))[1]
        return np.clip(q, self.lower, self.upper)

    def _bend_knees(self, legs: list[int], bend: float, wide: float) -> Array:
        """The wanted posture with knees bent, each leg to the side that its limits allow, and hips turned out."""
        q = self.wanted.copy()
        for leg in legs:
            rolls = [
                joint - 1 for joint in self.figure.joint_chain(leg) if abs(self.axes[joint - 1, 0]) > 0.8
            ]
            # The hip turns out and the ankle back, if joints for that are there.
            for joint, turn in zip((rolls[:1] + rolls[-1:])[: len(rolls)], (1.0, -1.0), strict=False):
                q[joint] += turn * self.sides[leg] * wide * np.sign(self.axes[joint, 0])
            pitch, signs = self._pitch_joints(leg)
            if len(pitch) < 2:
                continue
            pattern = bend * np.pad([1.0, -2.0, 1.0], (0, len(pitch)))[: len(pitch)] * signs
            both = [
                (angles, np.clip(angles, self.lower[pitch], self.upper[pitch]))
                for angles in (pattern, -pattern)
            ]
            lost = [float(np.abs(a - b).sum()) for a, b in both]
            q[pitch] = both[0 if lost[0] <= lost[1] + 1e-9 else 1][1]
        return np.clip(q, self.lower, self.upper)

    def _pitch_joints(self, leg: int) -> tuple[list[int], Array]:
        """Joints of a leg that bend it, as indices, and which way each turns: most of its level axes are parallel."""
        level = {joint - 1: self.axes[joint - 1, :2] for joint in self.figure.joint_chain(leg)}
        sizes = {joint: float(np.linalg.norm(axis)) for joint, axis in level.items()}
        axes = {joint: axis / sizes[joint] for joint, axis in level.items() if sizes[joint] > _ALONG}
        groups = [
            [one for one, other in axes.items() if abs(other @ axis) > _ALONG] for axis in axes.values()
        ]
        # Where as many roll as pitch, those across the robot bend it.
        group = max(groups, key=lambda one: (len(one), abs(axes[one[0]][1])), default=[])
        forth = axes[group[0]] if group else np.zeros(2)
        return group, np.sign([axes[joint] @ forth * (1.0 if forth[1] >= 0.0 else -1.0) for joint in group])
