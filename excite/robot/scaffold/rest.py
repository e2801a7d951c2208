"""How a bare model rests: on feet, on its base, or held; in which posture; and which links touch in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.robot.description import Assumed, Base
from excite.robot.holding import TORQUE_SHARE, holding_torques, usable_torque
from excite.robot.mechanisms.building import limb_columns
from excite.robot.scaffold.footing import Standing
from excite.robot.scaffold.limbs import Figure, FootGuess
from excite.robot.scaffold.said import Said
from excite.robot.scaffold.standing import Postures
from excite.robot.shapes.ground import ground_height
from excite.robot.shapes.ignored_pairs import PairSearch, review_pairs
from excite.robot.shapes.support_area import has_area

# Links that rest so close to the margin [m] refuse every motion, which begins and ends there: the filter and the
# independent check build their shapes anew (iCub's hip and torso, apart at rest, were refused at 9.97 of 10 mm).
_SLACK = 1e-3
# Room between moving links and the ground at rest, of the longest limb's length: of 12 candidates of a UR5 that rests
# stretched out at 0.09 m the ground refuses 7; with this much room 4.
_HEADROOM = 0.15


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
    postures, legs, standing = _search_standing(figure, search, wanted, said, allowed, rng)
    if (legs or said.floating) and np.any(wanted) and _explain_held(figure, postures, legs, standing):
        # A model's own posture may be none that it stands in: MuJoCo's key frames of some lie, fold legs, or leap.
        other = _search_standing(figure, search, np.zeros_like(wanted), said, allowed, rng)
        if not _explain_held(figure, *other):
            postures, legs, standing = other
    base: Base = "floating" if legs else "fixed"
    feet: tuple[FootGuess, ...] = ()
    notes: list[Assumed] = []
    unsteady = _explain_held(figure, postures, legs, standing) if legs or said.floating else ""
    if not legs and said.floating is None and figure.has_folded_legs(wanted):
        unsteady = "its legs lie flat about its base in the file: hold the robot up, legs free, or state how it stands"
    if unsteady:
        base = "held"
        notes.append(_assumption("base", "held", unsteady))
    if standing is not None and base == "floating":
        q, feet = standing.q, standing.feet
        source = "found: feet on one plane, centre of mass above the middle of what soles and ankles hold"
    else:
        ground = ground_height(figure.model, figure.shapes, wanted, held_up=base == "held")
        above = [ground] if said.posture is not None else [ground + _HEADROOM * figure.reach, ground]
        clear = _first_clear(postures, [*above, None], allowed)
        source = "found near zero, or the model's own posture: free of collision, above the ground"
        q = wanted if clear is None else clear
    q = np.round(q, 5)
    touching = postures.touching(q, allowed, _SLACK)
    if touching:
        names = ", ".join(f"{a} and {b}" for a, b in touching[:5])
        why = "no posture to move from was found that parts them: they keep a distance of their own"
        notes.append(_assumption("links that touch at rest", names, why))
    stated = {pair for a, b in said.ignored for pair in ((a, b), (b, a))} & set(search.pairs)
    ignored = tuple(dict.fromkeys((*review.never, *(p for p in search.pairs if p in stated))))
    margin = figure.robot.description.collision.margin
    near = _near_pairs(search, q, margin, (*review.at_rest, *review.always, *touching), stated)
    if near:
        found = f"{len(review.always)} always, {len(review.at_rest)} at rest"
        how = "they may not overlap, or where their hulls do at rest not deeper by more than the margin"
        notes.append(
            _assumption("pairs of links nearer than the margin", found, f"{how}: collision.near_pairs")
        )
    if ignored:
        found = f"{len(review.never)} that never meet, {len(stated)} that the model lets touch"
        where = "found in 100 random postures; they stand in collision.ignored_pairs"
        notes.append(_assumption("pairs of links not kept apart", found, where))
    if base != "held":
        # Of one that is held it stands there why.
        notes.insert(0, _assumption("base", base, _CONSEQUENCE[base]))
    legs_down = tuple(legs) if base == "floating" else ()
    return Rest(base, q, legs_down, feet, ignored, near, source, tuple(notes))


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
    at_rest = dict(zip(search.pairs, search.distances(search.posture(q)), strict=True))
    return {
        pair: 0.0 if at_rest[pair] >= 0.0 else float(np.floor(1e4 * (at_rest[pair] - margin)) / 1e4)
        for pair in dict.fromkeys(pairs)
        if pair not in stated
    }


def _search_standing(
    figure: Figure,
    search: PairSearch,
    wanted: Array,
    said: Said,
    allowed: frozenset[tuple[str, str]],
    rng: np.random.Generator,
) -> tuple[Postures, list[int], Standing | None]:
    """The search from a posture ``(n_joints,)``, the legs that it has in it, and how it stands on them."""
    postures = Postures(figure, search, wanted, rng)
    legs = [] if said.floating is False else figure.legs(wanted, free=bool(said.floating))
    return postures, legs, postures.standing(legs, allowed) if legs and not figure.is_guessed(legs) else None


def _explain_held(figure: Figure, postures: Postures, legs: list[int], standing: Standing | None) -> str:
    """Why a robot that ought to stand on legs is held; empty where it stands."""
    if not legs:
        return "no legs were found that it could stand on: hold it still"
    if figure.is_guessed(legs):
        return "no geometry says where its soles are: hold the robot up, legs free"
    if standing is None:
        return "no standing posture was found: hold the robot up, legs free"
    if not has_area(postures.footing.corners(standing, legs)):
        return "its feet span no area to stand on: hold the robot up, legs free"
    if not _can_steer(figure, legs, standing.feet):
        return "its legs have too few joints to move it over feet that stay: hold the robot up, legs free"
    if _has_tied_legs(figure, legs):
        return "joints of its legs follow from others, and no balance was planned so: hold the robot up, legs free"
    return ""


def _first_clear(
    postures: Postures, heights: list[float | None], allowed: frozenset[tuple[str, str]]
) -> Array | None:
    """A clear posture above the first of some heights where one can be held; else the first of those that cannot."""
    strained: list[Array] = []
    for height in heights:
        q = postures.clear(height, allowed)
        if q is not None and postures.strain(q) <= 1.0:
            return q
        strained += [] if q is None else [q]
    return strained[0] if strained else None


def _can_steer(figure: Figure, legs: list[int], feet: tuple[FootGuess, ...]) -> bool:
    """Whether legs have the joints to move a trunk forth, aside and up: six coordinates of the base and the legs' less
    what the feet hold, six of a sole and three of a point or an edge."""
    joints = {joint for leg in legs for joint in figure.chain(leg)}
    held = sum(6 if len(foot.sole) >= 3 else 3 for foot in feet)
    return 6 + len(joints) - held >= 3


def _has_tied_legs(figure: Figure, legs: list[int]) -> bool:
    """Whether joints of legs have to follow from others, which feet that stay do not let them."""
    mechanism = figure.robot.mechanism
    if mechanism is None:
        return False
    columns = limb_columns(figure.model, legs)
    return bool(np.isin(mechanism.following_from(columns).passive, columns).any())


def weak_joints(figure: Figure, rest: Rest) -> dict[str, float]:
    """Joints outside legs whose drives cannot hold the robot at rest, springs of a suspension among them, and where
    they are then [rad or m]."""
    robot = figure.robot
    usable = usable_torque(robot, np.full(robot.n_joints, TORQUE_SHARE), robot.limits.velocity)
    strained = np.abs(holding_torques(robot, rest.q[None]))[0] > usable
    strained[[joint - 1 for leg in rest.legs for joint in figure.chain(leg)]] = False
    return {robot.joint_names[i]: float(rest.q[i]) for i in np.flatnonzero(strained)}


_CONSEQUENCE = {
    "fixed": "its root does not move",
    "floating": "it stands on the feet found, free to fall: check posture and feet before the first run",
}


def _assumption(what: str, value: str, consequence: str) -> Assumed:
    return Assumed(what=what, value=value, consequence=consequence)
