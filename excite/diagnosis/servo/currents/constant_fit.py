"""Torque constants of an arm whose bodies are given, fitted together with what its model may lack.

Bodies that are given fix the scale of every joint's current. A load that nobody knew of asks for more of it where it
is heavy: alone, constants would take that up, and what is left of its torques would look like anything else. So they
are fitted beside a body at each link, and beside gravity aside of a tilted base, as long as that is worth its numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.bodies.likeliest_body import likeliest_body
from excite.diagnosis.effects.bodies.reach import reach
from excite.diagnosis.servo.gain_fit import CORRELATED, EQUATION, Rows, beside, turning_rows
from excite.robot.robot import Robot

_STEPS, _NEAR = 40, 1e-5
# Directions of a body that the motion does not show, relative.
_BLIND = 1e-9
# How often what was found first is fitted again beside what was found later.
_AGAIN = 3


@dataclass(frozen=True, eq=False)
class _Joint:
    """One joint's rows.

    Attributes:
        current: ``(n,)`` [A].
        nominal: ``(n,)`` torque of the bodies as given [N·m].
        beside: ``(n, 4)`` columns of its drive.
        lacking: by place, ``(n, p)`` torques of what the model may lack.
        known: torque constant, NaN where it is not stated.
    """

    current: Array
    nominal: Array
    beside: Array
    lacking: tuple[Array, ...]
    known: float

    @property
    def stated(self) -> bool:
        """Whether its constant is."""
        return not np.isnan(self.known)

    def asked(self, sizes: Sequence[Array]) -> Array:
        """Torque of the bodies with what is lacking, ``(n,)`` [N·m]."""
        torque = self.nominal
        for columns, size in zip(self.lacking, sizes, strict=True):
            torque = torque + columns @ size if size.any() else torque
        return torque

    def per_torque(self, asked: Array) -> tuple[float, float]:
        """Current per torque [A/(N·m)] where the bodies ask for so much, and the deviation of the current left [A]."""
        columns = self.beside if self.stated else np.column_stack([asked, self.beside])
        target = self.current - asked / self.known if self.stated else self.current
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        x = np.linalg.lstsq(columns / scale, target, rcond=1e-10)[0] / scale
        found = 1.0 / self.known if self.stated else float(x[0])
        return found, max(float((target - columns @ x).std()), 1e-12)

    def rest_of_torques(self, asked: Array, columns: Array) -> tuple[Array, Array]:
        """Columns and what they have to explain, where torques are a constant times currents, which is linear."""
        if self.stated:
            return _projected(self.beside, columns, self.known * self.current - asked)
        return _projected(np.column_stack([self.current, self.beside]), columns, -asked)

    def rest_of_currents(self, asked: Array, columns: Array, per_torque: float) -> tuple[Array, Array]:
        """The same where currents are torques over a constant, as it is."""
        if self.stated:
            return _projected(self.beside, per_torque * columns, self.current - asked / self.known)
        return _projected(np.column_stack([asked, self.beside]), per_torque * columns, self.current)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Constants beside what the model may lack.

    Attributes:
        sizes: by place.
        per_torque: ``(n_joints,)`` current per torque [A/(N·m)].
        sigma: ``(n_joints,)`` deviation of the currents that is left [A].
        least: ``(n_joints,)`` deviation below which equations are not believed [A].
        n_told: numbers that the motion shows of what was fitted last.
    """

    sizes: tuple[Array, ...]
    per_torque: Array
    sigma: Array
    least: Array
    n_told: int = 0


def constants_beside_bodies(robot: Robot, rows: Rows, known: Array, told: NDArray[np.bool_]) -> Array:
    """Torque constants ``(n_joints,)`` [N·m/A] of an arm with given bodies.

    Args:
        robot: the nominal model.
        rows: with currents for ``e``.
        known: ``(n_joints,)`` constants, NaN where they are not stated.
        told: ``(n_joints,)`` joints whose currents mean something.
    """
    joints = _joints(rows, known, told)
    masses = [float(inertia.mass) for inertia in list(robot.model.inertias)[1:]]
    search = _Search(joints, masses, reach(robot.model))
    chosen: list[int] = []
    best = search.made([np.zeros(block.shape[1]) for block in joints[0].lacking])
    while True:
        rest = [k for k in range(len(best.sizes)) if k not in chosen]
        tried = [search.fitted(best, k) for k in rest]
        gains = [search.gain(best, fit) for fit in tried]
        if not gains or max(gains) <= 0.0:
            break
        place = int(np.argmax(gains))
        chosen.append(rest[place])
        best = tried[place]
        for _ in range(_AGAIN if len(chosen) > 1 else 0):
            for k in chosen:
                best = search.fitted(best, k)
    constants = known.copy()
    constants[told] = 1.0 / best.per_torque
    return constants


def _joints(rows: Rows, known: Array, told: NDArray[np.bool_]) -> list[_Joint]:
    """Joints whose currents mean something, each in the rows in which it turns; bodies first, gravity aside last."""
    x, turning = rows.signals, turning_rows(rows.signals["sign"])
    bodies, made = rows.bodies / rows.unit, []
    for j in np.flatnonzero(told):
        here = turning[:, j]
        links = np.split(bodies[here, j], bodies.shape[2] // 10, axis=1)
        lacking = (*links, rows.aside[here, j])
        drive = beside(x, int(j))[here]
        made.append(_Joint(x["e"][here, j], x["nominal"][here, j], drive, lacking, float(known[j])))
    return made


@dataclass(frozen=True, eq=False)
class _Search:
    """Fits of constants beside what is lacking at one place after the other.

    Attributes:
        joints: their rows.
        masses: by link [kg].
        reach: largest distance of a body's parts from the joint that carries it [m].
    """

    joints: list[_Joint]
    masses: list[float]
    reach: float

    def gain(self, before: _Fit, after: _Fit) -> float:
        """Nats of a fit over one with less, less the price of what was fitted last."""
        counts = np.array([len(joint.current) for joint in self.joints]) / CORRELATED
        left = (before.sigma**2 + after.least**2) / (after.sigma**2 + after.least**2)
        price = 0.5 * after.n_told * np.log(counts.sum()) + np.log(len(after.sizes))
        return 0.5 * float(counts @ np.log(left)) - float(price)

    def made(self, sizes: Sequence[Array], n_told: int = 0) -> _Fit:
        """Constants at some sizes of what is lacking."""
        asked = [joint.asked(sizes) for joint in self.joints]
        found = [joint.per_torque(torque) for joint, torque in zip(self.joints, asked, strict=True)]
        per_torque, sigma = (np.array(values) for values in zip(*found, strict=True))
        least = EQUATION * np.abs(per_torque) * np.array([float(torque.std()) for torque in asked])
        return _Fit(tuple(sizes), per_torque, sigma, least, n_told)

    def fitted(self, begun: _Fit, place: int) -> _Fit:
        """Constants beside what is lacking at a place and what was found at others."""
        sizes = list(begun.sizes)
        sizes[place] = np.zeros(len(sizes[place]))
        parts = [joint.rest_of_torques(joint.asked(sizes), joint.lacking[place]) for joint in self.joints]
        own = np.array([max(float(y.std()), 1e-12) for _, y in parts])
        # Of torques it is linear, and nearly right: noise of the currents makes constants smaller. A load of many times
        # what a wrist weighs is told by the joints before it, whose own torques are the largest.
        found = [self._from(begun, place, parts, sigma) for sigma in (own, np.full(len(own), own.max()))]
        return max(found, key=lambda fit: self.gain(begun, fit))

    def _from(self, begun: _Fit, place: int, parts: list[tuple[Array, Array]], sigma: Array) -> _Fit:
        """The same by Gauss and Newton's steps, the first one for what ``parts`` leave at deviations ``sigma``."""
        sizes, now = list(begun.sizes), begun
        sizes[place] = np.zeros(len(sizes[place]))
        for _ in range(_STEPS):
            sizes[place], n_told = self._size(place, parts, sigma, sizes[place])
            now, last = self.made(sizes, n_told), now
            if np.allclose(now.per_torque, last.per_torque, rtol=_NEAR, atol=0.0):
                break
            sigma = now.sigma
            parts = [
                joint.rest_of_currents(joint.asked(sizes), joint.lacking[place], g)
                for joint, g in zip(self.joints, now.per_torque, strict=True)
            ]
        return now

    def _size(
        self, place: int, parts: Sequence[tuple[Array, Array]], sigma: Array, size: Array
    ) -> tuple[Array, int]:
        """What is lacking at a place, and how many of its numbers the motion shows: of bodies one that can exist."""
        columns = np.concatenate([block / s for (block, _), s in zip(parts, sigma, strict=True)])
        rest = np.concatenate([y / s for (_, y), s in zip(parts, sigma, strict=True)])
        information = columns.T @ columns
        target = information @ size + columns.T @ rest
        scale = np.sqrt(np.diag(information))
        scale = np.where(scale > 0.0, scale, 1.0)
        n_told = int(np.linalg.matrix_rank(information / np.outer(scale, scale), _BLIND, hermitian=True))
        if place < len(self.masses):
            found = likeliest_body(information, target, self.reach, self.masses[place])
            return (np.zeros(len(size)) if found is None else found), n_told
        inverse = np.linalg.pinv(information / np.outer(scale, scale), _BLIND, hermitian=True)
        return np.asarray(inverse @ (target / scale) / scale), n_told


def _projected(own: Array, lacking: Array, target: Array) -> tuple[Array, Array]:
    """What a joint's own columns leave of others, and of a target."""
    q = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), 1e-12))[0]
    return lacking - q @ (q.T @ lacking), target - q @ (q.T @ target)
