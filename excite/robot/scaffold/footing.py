"""A figure's feet flat on one plane, its centre of mass where they hold it, found from a posture nearby."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from excite.arrays import Array
from excite.robot.legs.ankles import Ankle, before_knee
from excite.robot.scaffold.limbs import Figure, FootGuess, sole_area


@dataclass(frozen=True, eq=False)
class Standing:
    """A posture ``(n_joints,)`` on feet."""

    q: Array
    feet: tuple[FootGuess, ...]


class _Leg(NamedTuple):
    """A leg by the joint at its end, what it stands on, and what holds it over that."""

    end: int
    foot: FootGuess
    ankle: Ankle


class _Contacts(NamedTuple):
    """Heights of the soles' middles, their tilts, and the centre of mass from the feet's middle [m, rad].

    That is where soles and ankles hold the robot best.
    """

    heights: Array
    tilts: Array
    offset: Array


class Footing:
    """Postures of a figure on its feet, by least squares within limits.

    Args:
        figure: the robot with its root at the world's origin.
        lower, upper: where joints should stay ``(n_joints,)`` [rad or m]; they may go three fifths of the way from
            there to the robot's limits.
        drawn: the posture ``(n_joints,)`` that the model draws the robot in, whose soles face down [rad or m].
    """

    def __init__(self, figure: Figure, lower: Array, upper: Array, drawn: Array) -> None:
        self.figure, self.lower, self.upper, self.drawn = figure, lower, upper, drawn

    def stand(self, start: Array, legs: list[int]) -> Standing | None:
        """Inverse kinematics from ``start``; a foot that is no sole touches elsewhere when it turns, so thrice."""
        q, on = start, [self._leg(leg, self._foot(leg, start)) for leg in legs]
        limits = self.figure.robot.limits
        low, high = limits.position_lower + 1e-4, limits.position_upper - 1e-4
        flat = self.lower < self.upper
        low, high = (
            np.where(flat, 0.6 * low + 0.4 * self.lower, low),
            np.where(flat, 0.6 * high + 0.4 * self.upper, high),
        )
        if (high - low <= 1e-6).any():
            return None
        for _ in range(3):
            solved = least_squares(
                self._residual,
                np.clip(q, low + 1e-9, high - 1e-9),
                bounds=(low, high),
                args=(start, on),
                max_nfev=40,
            )
            q = solved.x
            on = [
                leg if len(leg.foot.sole) >= 3 else self._leg(leg.end, self.figure.foot(leg.end, q))
                for leg in on
            ]
        heights, tilts, offset = self._contacts(q, on)
        # Two millimetres and half a degree are below what soles and floors are flat to.
        level = np.ptp(heights) < 2e-3 and np.abs(tilts).max(initial=0.0) < 0.01
        feet = tuple(leg.foot for leg in on)
        return Standing(q, feet) if level and np.linalg.norm(offset) < 0.02 else None

    def _leg(self, end: int, foot: FootGuess) -> _Leg:
        middle = np.asarray(self._placement(foot).act(foot.sole.mean(axis=0)))
        return _Leg(end, foot, Ankle(self.figure.robot, end, middle))

    def _foot(self, leg: int, start: Array) -> FootGuess:
        """The larger of the soles that face down at ``start`` and as drawn: a bent leg may point with its toes."""
        return max(
            (self.figure.foot(leg, q) for q in (start, self.drawn)), key=lambda foot: sole_area(foot.sole)
        )

    def corners(self, stand: Standing, legs: list[int]) -> Array:
        """Corners of all soles seen from above, ``(n, 2)`` [m]."""
        self.figure.centre(stand.q)
        soles = []
        for leg, foot in zip(legs, stand.feet, strict=True):
            pose = self.figure.data.oMi[leg] * self._placement(foot)
            soles.append(foot.sole @ pose.rotation.T + pose.translation)
        return np.vstack(soles)[:, :2]

    def bend(self, stand: Standing, leg: int, foot: FootGuess) -> float:
        """Angle [rad] between thigh and shank, a leg's two longest parts in a row, seen along the joint between them; a
        stretched leg lifts no hip."""
        figure = self.figure
        figure.centre(stand.q)
        pin.computeJointJacobians(figure.model, figure.data, stand.q)
        parts = self._parts(leg, foot)
        if len(parts) < 2:
            return np.inf
        k = before_knee(np.linalg.norm(parts, axis=1))
        knee = figure.chain(leg)[k + 1]
        turn = pin.getJointJacobian(figure.model, figure.data, knee, pin.LOCAL_WORLD_ALIGNED)
        axis = turn[3:, knee - 1]
        # Thighs and shanks stand beside each other in some legs, however straight these are.
        parts = parts - (parts @ axis)[:, None] * axis
        sizes = np.linalg.norm(parts, axis=1)
        cosine = parts[k] @ parts[k + 1] / max(sizes[k] * sizes[k + 1], 1e-12)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def _parts(self, leg: int, foot: FootGuess) -> Array:
        """From each joint of a leg to the next and from the last to the foot, where they are now, ``(n, 3)`` [m]."""
        data = self.figure.data
        ends = [data.oMi[joint].translation for joint in self.figure.chain(leg)]
        end = data.oMi[leg] * self._placement(foot)
        return np.asarray(np.diff([*ends, end.act(foot.sole.mean(axis=0))], axis=0))

    def agility(self, stand: Standing, leg: int, foot: FootGuess) -> float:
        """Least speed of a point foot at unit speed of its leg's joints, of its distance from the hip [1/rad].

        It is infinite of other feet, and of legs with fewer than three joints.
        """
        figure, chain = self.figure, self.figure.chain(leg)
        if len(foot.sole) != 1 or len(chain) < 3:
            return np.inf
        figure.centre(stand.q)
        pin.computeJointJacobians(figure.model, figure.data, stand.q)
        tip = (figure.data.oMi[leg] * self._placement(foot)).act(foot.sole[0])
        turn = pin.getJointJacobian(figure.model, figure.data, leg, pin.LOCAL_WORLD_ALIGNED)
        lever = tip - figure.data.oMi[leg].translation
        linear = turn[:3] - pin.skew(lever) @ turn[3:]
        slowest = np.linalg.svd(linear[:, [joint - 1 for joint in chain]])[1][-1]
        hip = figure.data.oMi[chain[0]].translation
        return float(slowest / max(np.linalg.norm(tip - hip), 1e-9))

    def _contacts(self, q: Array, on: list[_Leg]) -> _Contacts:
        figure = self.figure
        centre = figure.centre(q)
        load = figure.beyond[0] * float(np.linalg.norm(figure.model.gravity.linear)) / len(on)
        heights, tilts, middles = [], [], []
        for leg, foot, ankle in on:
            pose = figure.data.oMi[leg] * self._placement(foot)
            corners = foot.sole @ pose.rotation.T + pose.translation
            middle = corners.mean(axis=0)
            middles.append(middle[:2])
            heights.append(corners[:, 2].mean())
            if len(corners) >= 3:
                normal = np.linalg.svd(corners - middle)[2][2]
                tilts += list(normal[:2] * np.sign(normal[2]))
                middles[-1] = middles[-1] + ankle.eased(figure.data.oMi, middle[:2], load)
            elif len(corners) == 2:
                tilts.append((corners[1] - corners[0])[2] / np.linalg.norm(corners[1] - corners[0]))
        return _Contacts(np.array(heights), np.array(tilts), centre[:2] - np.mean(middles, axis=0))

    def _placement(self, foot: FootGuess) -> pin.SE3:
        model = self.figure.model
        return model.frames[model.getFrameId(foot.link, pin.BODY)].placement

    def _residual(self, q: Array, start: Array, on: list[_Leg]) -> Array:
        heights, tilts, offset = self._contacts(q, on)
        return np.concatenate(
            [10.0 * (heights - heights.mean()), 3.0 * tilts, 3.0 * offset, 0.02 * (q - start)]
        )
