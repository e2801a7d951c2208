"""Joint limits as rows that are linear in the variables, and the amplitude sums of the papers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.excitation.optimisation.motions import FourierFamily
from excite.excitation.optimisation.objective import Layout, Sampling


@dataclass(frozen=True, eq=False)
class JointLimits:
    """What the joints may do, ``(n_joints,)`` each.

    Attributes:
        lower: smallest positions [rad or m].
        upper: largest positions [rad or m].
        velocity: largest speeds [rad/s or m/s].
        acceleration: largest accelerations [rad/s² or m/s²].
        torque: largest drive torques [N·m or N].
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    torque: Array

    def checked(self, names: tuple[str, ...], start: Array | None, moved: NDArray[np.int64]) -> None:
        """Raise NoSolutionError where there is no room for a motion.

        Args:
            names: of all joints.
            start: ``(n_moved,)`` where motions have to start; None where that is free.
            moved: indices of the joints that move.
        """
        for i, joint in enumerate(moved):
            name, room = names[joint], self.upper[joint] - self.lower[joint]
            widths = {
                "position": room,
                "velocity": self.velocity[joint],
                "acceleration": self.acceleration[joint],
            }
            for kind, width in widths.items():
                if not (np.isfinite(width) and width > 0.0):
                    raise NoSolutionError(
                        f"joint {name!r} has no room to move: {kind} limits leave it {width:.3g}",
                        remedy="widen the limits",
                    )
            if start is not None and not self.lower[joint] < start[i] < self.upper[joint]:
                span = f"{self.lower[joint]:.3g} to {self.upper[joint]:.3g}"
                raise NoSolutionError(
                    f"joint {name!r} starts at {start[i]:.3g}, outside {span}",
                    remedy="move the start, or let it be chosen",
                )


@dataclass(frozen=True, eq=False)
class LinearRows:
    """``lower ≤ matrix @ x ≤ upper``, rows in shares of their limits.

    Attributes:
        matrix: ``(m, size)``.
        lower: ``(m,)``.
        upper: ``(m,)``.
    """

    matrix: Array
    lower: Array
    upper: Array

    def excess(self, x: Array) -> float:
        """How far the worst row is outside, zero if none is."""
        value = self.matrix @ x
        return float(np.maximum(self.lower - value, value - self.upper).max(initial=0.0))


def linear_rows(layout: Layout, limits: JointLimits, time: Array) -> LinearRows:
    """Position, velocity and acceleration limits of the moved joints at given times.

    Rows that cannot bind are left out: the derivative of a trigonometric polynomial of order L is at most
    ``ω L`` times its largest value (Bernstein; Zygmund 2002, vol. II, theorem X.3.13), so that a velocity limit
    may imply the acceleration's.
    """
    sampling = Sampling(layout, time)
    n, k = sampling.bases[0].shape
    blocks, lows, highs = [], [], []
    for i, joint in enumerate(layout.joints):
        half = 0.5 * (limits.upper[joint] - limits.lower[joint])
        middle = 0.5 * (limits.upper[joint] + limits.lower[joint])
        kinds = [(0, half), (1, limits.velocity[joint])]
        top = 2.0 * np.pi * layout.family.fastest_hz * limits.velocity[joint]
        if not (isinstance(layout.family, FourierFamily) and top <= limits.acceleration[joint]):
            kinds.append((2, limits.acceleration[joint]))
        for order, limit in kinds:
            by_offset, by_table = np.zeros((n, len(layout.joints))), np.zeros((n, len(layout.joints), k))
            by_table[:, i] = sampling.bases[order] / limit
            if order == 0:
                by_offset[:, i] = 1.0 / limit
            blocks.append(layout.gathered(by_offset, by_table))
            shift = (middle - layout.start[i]) / limit if order == 0 else 0.0
            lows.append(np.full(n, shift - 1.0))
            highs.append(np.full(n, shift + 1.0))
    matrix = np.vstack(blocks)
    moving = np.abs(matrix).max(axis=1) > 1e-12
    return LinearRows(matrix[moving], np.concatenate(lows)[moving], np.concatenate(highs)[moving])


def peak_shares(layout: Layout, limits: JointLimits, x: Array, per_cycle: float = 200.0) -> Array:
    """Largest share of each moved joint's limits that a motion uses, ``(n_moved,)``; the start's share is 0.

    Shares are those by which the coefficients may grow, so that ``coefficients / share`` just fits.
    """
    offset, table = layout.parts(x)
    curve = layout.family.curve(offset, table)
    time = np.append(layout.family.grid(per_cycle), layout.family.length)
    away, speed, rate = (curve.evaluate(time, order) for order in range(3))
    away = away - offset
    joints = layout.joints
    shares = np.stack(
        [
            away.max(axis=0) / (limits.upper[joints] - offset),
            -away.min(axis=0) / (offset - limits.lower[joints]),
            np.abs(speed).max(axis=0) / limits.velocity[joints],
            np.abs(rate).max(axis=0) / limits.acceleration[joints],
        ]
    )
    return np.asarray(shares.max(axis=0))
