"""Postures from which a standing one is sought: legs bent, spread or sprawled, the rest as wanted."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.scaffold.limbs import Figure

# Bends of hip, knee and ankle from which standing postures are sought, and how far hips turn out [rad].
_BENDS = (0.5, -0.5, 0.7, -0.7, 0.35, -0.35, 0.9, -0.9, 0.2, -0.2)
_WIDE = (0.0, 0.12)
# Cosine of 37 degrees: axes this near to each other, or to the ground, count as along them.
_ALONG = 0.8
# Steps of Newton's method by which a leg's end is turned to where it faced, to within half a degree [rad]; directions
# that joints turn a tenth as well as others are left as they are.
_TURNS, _FACES, _RCOND = 5, 0.01, 0.1
# Cosine of 60 degrees: a hip that swings its thigh about an axis less oblique than this bends the leg (an X1's has 45).
_OBLIQUE = 0.5


class Stances:
    """First guesses of standing postures.

    Args:
        figure: the robot.
        lower, upper: where joints should stay ``(n_joints,)`` [rad or m].
        wanted: posture of what is no leg ``(n_joints,)``.
    """

    def __init__(self, figure: Figure, lower: Array, upper: Array, wanted: Array) -> None:
        self.figure, self.lower, self.upper, self.wanted = figure, lower, upper, wanted

    def of(self, legs: list[int]) -> list[Array]:
        """In the order in which they are tried."""
        starts = [self.wanted] if np.any(self.wanted) else []
        starts += [self._bent(legs, bend, wide) for wide in _WIDE for bend in _BENDS]
        return [*starts, self.wanted]

    def wide(self, legs: list[int]) -> list[Array]:
        """More of them, for legs whose feet cannot follow in every direction from the others."""
        return [self._sprawled(legs, bend) for bend in _BENDS if bend > 0.0]

    def _sprawled(self, legs: list[int], bend: float) -> Array:
        """The wanted posture with thighs out and shanks down."""
        q = self.wanted.copy()
        model, data = self.figure.model, self.figure.data
        for leg in legs:
            pin.computeJointJacobians(model, data, pin.neutral(model))
            pitch, signs, _ = self._pitches(leg)
            if len(pitch) < 2:
                continue
            reached = []
            for side in (1.0, -1.0):
                tried = q.copy()
                tried[pitch[:2]] = side * bend * np.array([1.0, -1.0]) * np.array(signs[:2])
                self.figure.centre(tried)
                reached.append((float(np.linalg.norm(data.oMi[leg].translation[:2])), tried))
            q = max(reached, key=lambda one: one[0])[1]
        return np.clip(q, self.lower, self.upper)

    def _bent(self, legs: list[int], bend: float, wide: float) -> Array:
        """The wanted posture with knees bent, each leg to the side that its limits allow."""
        q = self.wanted.copy()
        model, data = self.figure.model, self.figure.data
        pin.computeJointJacobians(model, data, pin.neutral(model))
        for leg in legs:
            pitch, signs, oblique = self._pitches(leg)
            self._widen(q, leg, wide)
            if len(pitch) < 2:
                continue
            pattern = np.zeros(len(pitch))
            pattern[:3] = np.array([1.0, -2.0, 1.0])[: len(pitch)]
            both = [side * bend * pattern * np.array(signs) for side in (1.0, -1.0)]
            clipped = [np.clip(angles, self.lower[pitch], self.upper[pitch]) for angles in both]
            lost = [float(np.abs(a - b).sum()) for a, b in zip(both, clipped, strict=True)]
            q[pitch] = clipped[0] if lost[0] <= lost[1] + 1e-9 else clipped[1]
            if oblique:
                self._face_as_drawn(q, leg, pitch[1])
        return np.clip(q, self.lower, self.upper)

    def _face_as_drawn(self, q: Array, leg: int, knee: int) -> None:
        """Turn a leg's end back to as it is wanted, by joints other than the knee: an oblique hip turned its toes."""
        model, data = self.figure.model, self.figure.data
        columns = [joint - 1 for joint in self.figure.chain(leg) if joint - 1 != knee]
        pin.forwardKinematics(model, data, self.wanted)
        drawn = data.oMi[leg].rotation.copy()
        for _ in range(_TURNS):
            pin.computeJointJacobians(model, data, q)
            off = pin.log3(drawn @ data.oMi[leg].rotation.T)
            if len(columns) < 3 or np.linalg.norm(off) < _FACES:
                break
            turn = pin.getJointJacobian(model, data, leg, pin.LOCAL_WORLD_ALIGNED)[3:, columns]
            q[columns] += np.linalg.lstsq(turn, off, rcond=_RCOND)[0]
        pin.computeJointJacobians(model, data, pin.neutral(model))

    def _pitches(self, leg: int) -> tuple[list[int], list[float], bool]:
        """Joints of a leg that bend it, as indices, and which way each turns: most of its level axes are parallel.

        Where these are a knee and an ankle alone, the hip before them is the one that turns most nearly about theirs,
        if obliquely, which comes third.
        """
        axes = []
        for joint in self.figure.chain(leg):
            turn = pin.getJointJacobian(self.figure.model, self.figure.data, joint, pin.LOCAL_WORLD_ALIGNED)
            axes.append((joint - 1, turn[3:, joint - 1]))
        level = [
            (index, axis[:2] / np.linalg.norm(axis[:2]))
            for index, axis in axes
            if np.linalg.norm(axis[:2]) > _ALONG
        ]
        groups = [[one for one in level if abs(one[1] @ axis) > _ALONG] for _, axis in level]
        # Where as many roll as pitch, those across the robot bend it.
        group = max(groups, key=lambda one: (len(one), abs(one[0][1][1])), default=[])
        if not group:
            return [], [], False
        forth = group[0][1] * (1.0 if group[0][1][1] >= 0.0 else -1.0)
        before = [(index, axis[:2]) for index, axis in axes[: [i for i, _ in axes].index(group[0][0])]]
        hip = max(before, key=lambda one: abs(float(one[1] @ forth)), default=None)
        oblique = len(group) == 2 and hip is not None and abs(float(hip[1] @ forth)) > _OBLIQUE
        if oblique and hip is not None:
            group = [hip, *group]
        return [index for index, _ in group], [float(np.sign(axis @ forth)) for _, axis in group], oblique

    def _widen(self, q: Array, leg: int, wide: float) -> None:
        """Turn a leg's hip out by ``wide`` [rad] and its ankle back, if joints for that are there."""
        model, data = self.figure.model, self.figure.data
        columns = {
            joint: pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[3, joint - 1]
            for joint in self.figure.chain(leg)
        }
        rolls = [joint for joint, share in columns.items() if abs(share) > 0.8]
        side = np.sign(data.oMi[leg].translation[1])
        for joint, turn in zip((rolls[:1] + rolls[-1:])[: len(rolls)], (1.0, -1.0), strict=False):
            q[joint - 1] += turn * side * wide * np.sign(columns[joint])
