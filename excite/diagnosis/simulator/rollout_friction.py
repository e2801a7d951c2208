"""Dry friction of a simulated joint beyond a constant level: it decays with speed, grows with load, bends first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.presliding import RATIO, bend, bend_further
from excite.diagnosis.simulator.rollout_drives import Window

# An effect, the joint that it is at, its values.
Note = tuple[str, str, Mapping[str, float]]


@dataclass(frozen=True)
class Static:
    """Static friction over Coulomb's, ``excess·exp(−|v/velocity|^exponent)``.

    Attributes:
        excess: at rest [N·m].
        velocity: Stribeck velocity [rad/s].
        exponent: of its decay.
    """

    excess: float
    velocity: float
    exponent: float = 2.0

    @staticmethod
    def of(p: Mapping[str, float]) -> Static:
        """From the sizes of a Stribeck effect."""
        return Static(p["excess"], p["velocity"], p.get("exponent", 2.0))

    def share(self, v: float) -> float:
        """What is left of it at a speed, 0…1."""
        return math.exp(-((abs(v) / self.velocity) ** self.exponent))


@dataclass(eq=False)
class Bristle:
    """Friction that builds up over a deflection, ``z' = (v − |v| z)/δ`` (Dahl 1968), stepped implicitly.

    With static friction the LuGre model's bristles bend further, ``z' = (v − |v| z/g)/δ``, ``g = 1 + r·share``; per
    unit of static over Coulomb friction that adds the difference of both over r (Canudas de Wit et al. 1995).

    Attributes:
        joint: index of its joint.
        breakaway: δ [rad].
        damping: torque per ``z'`` [N·m·s] (Canudas de Wit et al. 1995, eq. 3).
        damped_below: speed beyond which it has died out [rad/s].
        static: static friction on it.
        z: states, without and with static friction, −1 … 1 + r.
        kept: shares of the states that a step at the present speed leaves.
    """

    joint: int
    breakaway: float
    damping: float = 0.0
    damped_below: float = np.inf
    static: Static | None = None
    z: tuple[float, float] = (0.0, 0.0)
    kept: tuple[float, float] = (1.0, 1.0)

    def start(self, window: Window) -> None:
        """Bend it as the record before the window did."""
        self.z = (0.0, 0.0)
        if window.past is None:
            return
        v = np.ascontiguousarray(window.past.v[:, self.joint])
        starts = np.zeros(len(v), dtype=np.bool_)
        starts[0] = True
        period = float(window.past.time[1] - window.past.time[0])
        plain = float(bend(v, starts, period, self.breakaway)[-1])
        further = plain
        if self.static is not None:
            law = self.static.velocity, self.static.exponent
            further = float(bend_further(v, starts, period, self.breakaway, *law, RATIO)[-1])
        self.z = (plain, further)

    def force(self, level: float, v: float, step: float) -> tuple[float, float]:
        """Torque [N·m] and damping [N·m·s/rad] of the coming step, together those of its end."""
        excess = 0.0 if self.static is None else self.static.excess / RATIO
        slips = 1.0 if self.static is None else 1.0 + RATIO * self.static.share(v)
        self.kept = (
            1.0 / (1.0 + step * abs(v) / self.breakaway),
            1.0 / (1.0 + step * abs(v) / (self.breakaway * slips)),
        )
        rate = self.damping * math.exp(-((v / self.damped_below) ** 2)) / step
        # Static friction is damped as Coulomb friction is.
        more = rate / level * excess if level > 0.0 else 0.0
        torque = damping = 0.0
        for z, kept, size, slow in zip(
            self.z, self.kept, (level - excess, excess), (rate - more, more), strict=True
        ):
            torque += -(size + slow) * kept * z + slow * z
            damping += (size + slow) * kept * step / self.breakaway
        return torque, damping

    def move(self, v: float, step: float) -> None:
        """Bend it by the step that was made."""
        plain, further = (
            kept * (z + step * v / self.breakaway) for z, kept in zip(self.z, self.kept, strict=True)
        )
        self.z = (plain, further)


class DryFriction:
    """Friction levels of all joints at every step, and the bristles of those that have some.

    Attributes:
        bristles: those of all joints.
        acts: whether anything changes from step to step.
        loaded: whether the torques that the gears carry matter.
    """

    def __init__(self, notes: Sequence[Note], joints: tuple[str, ...]):
        """Pick what is friction from a model's notes.

        Args:
            notes: all notes.
            joints: joints in the order of all arrays.
        """
        self._notes = [(effect, joints.index(place), place, p) for effect, place, p in notes]
        self._common: dict[int, Bristle] = {}
        self._own: list[tuple[Bristle, Mapping[str, float]]] = []
        # Part of each joint's constant level that bristles of its own take over [N·m].
        self._taken: dict[int, float] = {}
        self._static = {j: Static.of(p) for effect, j, _, p in self._notes if effect == "stribeck"}
        for effect, j, _, p in self._notes:
            if effect == "presliding":
                damped = p.get("damping", 0.0), p.get("damped_below", np.inf)
                self._common[j] = Bristle(j, p["breakaway"], *damped)
            elif "breakaway" in p:
                static = Static.of(p) if effect == "stribeck" else None
                self._own.append(
                    (Bristle(j, p["breakaway"], p.get("bristle_damping", 0.0), static=static), p)
                )
        for effect, j, _, p in self._notes:
            if effect == "stribeck" and "breakaway" not in p and j in self._common:
                self._common[j].static = self._static[j]
        self.bristles = (*self._common.values(), *(bristle for bristle, _ in self._own))
        kinds = {effect for effect, *_ in self._notes}
        self.acts, self.loaded = (
            bool(self.bristles or kinds - {"joint_spring"}),
            "load_dependent_friction" in kinds,
        )

    def start(self, window: Window) -> None:
        """Begin a window."""
        for bristle in self.bristles:
            bristle.start(window)

    def levels(
        self, level: Array, v: Array, carried: Array, growth: Mapping[str, float]
    ) -> tuple[Array, Array]:
        """Coulomb levels and added viscous friction of all joints, ``(n_joints,)`` each.

        Args:
            level: constant levels [N·m].
            v: velocities [rad/s].
            carried: torques that the gears carry [N·m].
            growth: by joint, how far friction that drifts has come.
        """
        level, viscous = level.copy(), np.zeros(len(level))
        for effect, j, place, p in self._notes:
            if effect == "stribeck" and "breakaway" in p:
                # A fit may have bristles take less than none of a level, or more than all.
                self._taken[j] = min(max(p["presliding"], 0.0), max(float(level[j]), 0.0))
                level[j] -= self._taken[j]
            elif effect == "stribeck" and j not in self._common:
                static = self._static[j]
                level[j] += static.excess * static.share(float(v[j]))
            elif effect == "load_dependent_friction":
                level[j] += p["coefficient"] * abs(carried[j])
            elif effect == "friction_drift":
                level[j] += growth[place] * p["coulomb_change"]
                viscous[j] += growth[place] * p["viscous_change"]
        return np.maximum(level, 0.0), viscous

    def bent(self, level: Array, v: Array, step: float) -> tuple[Array, Array]:
        """Torque and damping of all bristles; levels that they take over are taken off ``level`` in place."""
        force, damping = np.zeros(len(level)), np.zeros(len(level))
        if not self.bristles:
            return force, damping
        parts = [(b, level[j]) for j, b in self._common.items()]
        for j in self._common:
            level[j] = 0.0
        for bristle, p in self._own:
            j = bristle.joint
            parts.append((bristle, p["rubbing"] if "rubbing" in p else self._taken[j]))
        for bristle, size in parts:
            f, d = bristle.force(max(size, 0.0), float(v[bristle.joint]), step)
            force[bristle.joint] += f
            damping[bristle.joint] += d
        return force, damping

    def move(self, v: Array, step: float) -> None:
        """Bend all bristles by the step that was made."""
        for bristle in self.bristles:
            bristle.move(float(v[bristle.joint]), step)
