"""A posture in which a bare model rests: upright on its legs, or free of collision above its ground."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from excite.arrays import Array
from excite.errors import MotionError
from excite.robot.holding import TORQUE_SHARE, holding_torques, usable_torque
from excite.robot.scaffold.footing import Footing, Standing
from excite.robot.scaffold.limbs import Figure
from excite.robot.scaffold.stances import Stances
from excite.robot.shapes.ignored_pairs import PairSearch

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
# Share of the usable torque down to which a posture is eased: beside it there must be others that can be held, too.
_EASE = 0.8
# Random postures of what does not stand, from near the wanted posture outwards; a dual arm needs some tens.
_TRIES = 300


class _Tried(NamedTuple):
    """A posture on feet, pairs of links that touch in it, and whether its legs are bent."""

    stand: Standing
    touching: frozenset[tuple[str, str]]
    bent: bool


class Postures:
    """Searches postures of a figure within its limits, a tenth of each range away from them where possible."""

    def __init__(self, figure: Figure, search: PairSearch, wanted: Array, rng: np.random.Generator) -> None:
        self.figure, self.search, self.rng = figure, search, rng
        limits = figure.robot.limits
        room = 0.1 * (limits.position_upper - limits.position_lower)
        self.lower, self.upper = limits.position_lower + room, limits.position_upper - room
        self.wanted = np.clip(wanted, limits.position_lower, limits.position_upper)
        self.footing = Footing(figure, self.lower, self.upper, self.wanted)
        self.stances = Stances(figure, self.lower, self.upper, self.wanted)

    def clear(self, ground: float | None, ignored: frozenset[tuple[str, str]]) -> Array | None:
        """A posture near the wanted one without collision and above the ground that the drives can hold; one that
        strains them least where none can be held, None where all collide."""
        every = np.ones(len(self.wanted), dtype=bool)
        parted = self._parted(self.wanted, set(), ignored)
        least: tuple[float, Array] | None = None
        for near in (parted, *self._near(self.wanted, every)):
            q = self._closed(near)
            if q is None:
                continue
            eased = self._eased(q)
            strain = self.strain(eased)
            if least is not None and strain >= least[0]:
                continue
            if self.touching(eased, ignored) or (ground is not None and self._below(eased, ground)):
                continue
            if strain <= 1.0:
                return eased
            least = strain, eased
        return None if least is None else least[1]

    def _closed(self, q: Array) -> Array | None:
        """A posture with what follows from others where it follows to, None out of reach or limits."""
        robot = self.figure.robot
        if robot.mechanism is None:
            return q
        try:
            q = robot.mechanism.closed(q[None])[0]
        except MotionError:
            return None
        inside = (q >= robot.limits.position_lower) & (q <= robot.limits.position_upper)
        return q if inside.all() else None

    def strain(self, q: Array) -> float:
        """The largest torque that holds a posture, of what motions may use of it."""
        return float(np.abs(holding_torques(self.figure.robot, q[None]) / self._usable).max(initial=0.0))

    def _eased(self, q: Array) -> Array:
        """A posture near ``q`` that the drives can hold, as far as one is found downhill from it."""
        if self.strain(q) <= 1.0 or self.figure.robot.mechanism is not None:
            return q
        model, data = self.figure.model, self.figure.data

        def excess(at: Array) -> tuple[float, Array]:
            strain = pin.computeGeneralizedGravity(model, data, at) / self._usable
            over = np.sign(strain) * np.maximum(np.abs(strain) - _EASE, 0.0)
            slope = pin.computeGeneralizedGravityDerivatives(model, data, at) / self._usable[:, None]
            return float(over @ over), 2.0 * over @ slope

        bounds = list(zip(self.lower, self.upper, strict=True))
        start = np.clip(q, self.lower, self.upper)
        return np.asarray(minimize(excess, start, jac=True, method="L-BFGS-B", bounds=bounds).x)

    @cached_property
    def _usable(self) -> Array:
        robot = self.figure.robot
        return usable_torque(robot, np.full(robot.n_joints, TORQUE_SHARE), robot.limits.velocity)

    def _near(self, start: Array, moves: Array) -> list[Array]:
        tries = [start]
        for number in range(_TRIES):
            share = (number + 1) / _TRIES
            goal = self.rng.uniform(self.lower, self.upper)
            tries.append(np.where(moves, start + share * (goal - start), start))
        return tries

    def touching(
        self, q: Array, ignored: frozenset[tuple[str, str]], slack: float = 0.0
    ) -> list[tuple[str, str]]:
        """Pairs of links closer than the margin and some slack [m], those left out that are ignored."""
        margin = self.figure.robot.description.collision.margin + slack
        near = self.search.distances(self.search.posture(q)) < margin
        return [
            pair for pair, close in zip(self.search.pairs, near, strict=True) if close and pair not in ignored
        ]

    def _below(self, q: Array, ground: float) -> bool:
        margin = self.figure.robot.description.collision.margin
        low = self.figure.lowest(q)
        return any(
            z < ground + margin for joint, z in low.items() if joint and self.figure.model.parents[joint] != 0
        )

    def standing(self, legs: list[int], ignored: frozenset[tuple[str, str]]) -> Standing | None:
        """A posture with all feet on one plane, the centre of mass where they hold it, and nothing touching.

        What links of a leg and of its trunk touch in all postures on bent legs does not count: hulls of hips and ankles
        are larger than what turns in them, and a robot on straight legs can move nothing but its arms.
        """
        tried = self._tried(self.stances.of(legs), legs, ignored)
        if not tried or self._agility(self._best(tried, legs, ignored).stand, legs) < _AGILE:
            tried += self._tried(self.stances.wide(legs), legs, ignored)
        if not tried:
            return None
        best, of_hulls = self._best(tried, legs, ignored), self._of_hulls(tried, legs)
        return self._spread(best.stand, legs, ignored | of_hulls) if best.touching - of_hulls else best.stand

    def _tried(
        self, starts: list[Array], legs: list[int], ignored: frozenset[tuple[str, str]]
    ) -> list[_Tried]:
        """What is found from some starts, up to the first that leaves nothing to wish for."""
        tried: list[_Tried] = []
        for start in starts:
            found = self.footing.stand(start, legs)
            if found is None:
                continue
            touching = frozenset(self.touching(found.q, ignored))
            tried.append(_Tried(found, touching, self._bend(found, legs) >= _BEND))
            if not touching and self._room(found, legs, ignored) >= 1.0:
                break
        return tried

    def _best(self, tried: list[_Tried], legs: list[int], ignored: frozenset[tuple[str, str]]) -> _Tried:
        """The one with the most room, and with the fewest pairs that touch."""
        of_hulls = self._of_hulls(tried, legs)

        def score(one: _Tried) -> float:
            return self._room(one.stand, legs, ignored | of_hulls) - len(one.touching - of_hulls)

        return max(tried, key=score)

    def _of_hulls(self, tried: list[_Tried], legs: list[int]) -> frozenset[tuple[str, str]]:
        """Pairs of links with only joints of legs between them that touch in every posture on bent legs."""
        bent = [one.touching for one in tried if one.bent]
        of_legs = {joint for leg in legs for joint in self.figure.chain(leg)}
        common = frozenset.intersection(*bent) if bent else frozenset[tuple[str, str]]()
        return frozenset(pair for pair in common if set(self.search.joints_between(pair)) <= of_legs)

    def _bend(self, stand: Standing, legs: list[int]) -> float:
        return min(self.footing.bend(stand, leg, foot) for leg, foot in zip(legs, stand.feet, strict=True))

    def _agility(self, stand: Standing, legs: list[int]) -> float:
        return min(self.footing.agility(stand, leg, foot) for leg, foot in zip(legs, stand.feet, strict=True))

    def _room(self, stand: Standing, legs: list[int], ignored: frozenset[tuple[str, str]]) -> float:
        """How much of the room that motions need is there, 0 … 1."""
        q = stand.q
        limits = self.figure.robot.limits
        joints = sorted({joint - 1 for leg in legs for joint in self.figure.chain(leg)})
        to_limits = np.minimum(q - limits.position_lower, limits.position_upper - q)[joints]
        margin = self.figure.robot.description.collision.margin
        apart = [
            distance - margin
            for pair, distance in zip(
                self.search.pairs, self.search.distances(self.search.posture(q)), strict=True
            )
            if pair not in ignored
        ]
        low, of_legs = self.figure.lowest(q), {joint for leg in legs for joint in self.figure.chain(leg)}
        ground = min(low[leg] for leg in legs)
        above = [low[joint] - ground - margin for joint in low if joint not in of_legs]
        shares = (
            float(to_limits.min(initial=_ROOM)) / _ROOM,
            min(apart, default=_APART) / _APART,
            min(above, default=_APART) / _APART,
            self._bend(stand, legs) / _BEND,
            self._agility(stand, legs) / _AGILE,
        )
        return sum(min(max(share, 0.0), 1.0) for share in shares) / len(shares)

    def _spread(self, stand: Standing, legs: list[int], ignored: frozenset[tuple[str, str]]) -> Standing:
        """The same feet with arms and head out of the way, if that can be; else as far as it could."""
        of_legs = {joint for leg in legs for joint in self.figure.chain(leg)}
        found = self.footing.stand(self._parted(stand.q, of_legs, ignored), legs)
        return (
            found
            if found and len(self.touching(found.q, ignored)) < len(self.touching(stand.q, ignored))
            else stand
        )

    def _parted(self, q: Array, kept: set[int], ignored: frozenset[tuple[str, str]]) -> Array:
        """Fewer links touching: pair by pair, joints between its links are drawn anew, but for those ``kept``."""
        touching = self.touching(q, ignored)
        for number in range(_TRIES):
            if not touching:
                break
            between = set(self.search.joints_between(touching[number % len(touching)])) - kept
            places = [joint - 1 for joint in between]
            share = min(1.0, 0.1 + number / (0.5 * _TRIES))
            drawn = q.copy()
            goal = self.rng.uniform(self.lower, self.upper)
            drawn[places] += share * (goal - q)[places]
            after = self.touching(drawn, ignored)
            if len(after) < len(touching):
                q, touching = drawn, after
        return q
