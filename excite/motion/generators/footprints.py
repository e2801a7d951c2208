"""Where the feet of a walk are put down, and how they get there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.motion.generators.polynomials import PolynomialCurve, hermite_curve
from excite.robot.robot import Foot, Robot


@dataclass(frozen=True, eq=False)
class Print:
    """A sole flat on the ground.

    Attributes:
        position: of its middle, ``(2,)`` [m].
        yaw: of its x axis [rad].
    """

    position: Array
    yaw: float


@dataclass(frozen=True, eq=False)
class Step:
    """One swing.

    Attributes:
        foot: index of the foot that swings.
        print: where it comes down.
    """

    foot: int
    print: Print


@dataclass(frozen=True, eq=False)
class Sole:
    """A foot's sole where the robot rests.

    Attributes:
        foot: the foot.
        print: where it stands.
        length: of the largest rectangle about the sole's middle that lies in it, along its x [m].
        width: along its y [m].
    """

    foot: Foot
    print: Print
    length: float
    width: float


@dataclass(frozen=True, eq=False)
class Swing:
    """When and how a foot moves to its next print.

    Attributes:
        start: path parameter at which it leaves the ground.
        end: path parameter at which it is down again.
        height: of the sole's middle half way [m].
        turn: rotation vector of the sole half way, beside its yaw, ``(3,)`` [rad].
        aside: half way, out of the straight line, ``(2,)`` [m].
    """

    start: float
    end: float
    height: float
    turn: Array
    aside: Array


def resting_soles(robot: Robot) -> tuple[Sole, ...]:
    """The soles as they stand at rest, in the order of ``robot.feet``."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    soles = []
    for foot in robot.feet:
        frame = data.oMi[foot.joint] * foot.placement
        yaw = float(np.arctan2(frame.rotation[1, 0], frame.rotation[0, 0]))
        corners = np.array([frame.actInv(data.oMi[foot.joint].act(corner))[:2] for corner in foot.sole])
        length, width = 2.0 * np.minimum(corners.max(axis=0), -corners.min(axis=0))
        soles.append(Sole(foot, Print(frame.translation[:2].copy(), yaw), float(length), float(width)))
    return tuple(soles)


def there_and_back(soles: Sequence[Sole], first: int, ways: Array, width: float) -> tuple[Step, ...]:
    """Steps that carry the robot along and back again, both soles in the end where they rest.

    With each step one sole comes to where it would be if the robot, standing as at rest, had been carried to
    the step's place; at the far end and at home the other sole follows.

    Args:
        soles: the two soles at rest.
        first: index of the foot that steps first.
        ways: displacement of the robot with each step out, in its own frame: x, y [m] and yaw [rad], ``(k, 3)``;
            the way back is in ``k`` equal parts.
        width: distance of the soles from the middle between them while the robot walks, in that at rest.

    Returns:
        ``2 k + 2`` steps.
    """
    middle = np.mean([sole.print.position for sole in soles], axis=0)
    place, yaw, out = np.zeros(2), 0.0, []
    for x, y, turn in ways:
        place = place + _plane_rotation(yaw) @ np.array([x, y])
        yaw += float(turn)
        out.append((place, yaw))
    back = [(share * place, share * yaw) for share in np.linspace(1.0, 0.0, len(ways) + 1)[1:]]
    places = [*out, out[-1], *back, back[-1]]
    steps = []
    for k, (at, turned) in enumerate(places):
        sole = soles[(first + k) % 2].print
        apart = width if k < len(places) - 2 else 1.0
        position = middle + at + _plane_rotation(turned) @ (apart * (sole.position - middle))
        steps.append(Step((first + k) % 2, Print(position, sole.yaw + turned)))
    return tuple(steps)


def sole_curve(
    sole: Sole, prints: Sequence[Print], swings: Sequence[Swing], length: float
) -> PolynomialCurve:
    """Displacement of a sole from where it rests, ``(6,)``: translation [m], then rotation vector [rad].

    Args:
        sole: the sole.
        prints: where it is put down, one after the other.
        swings: the swing that leads to each, in order.
        length: of the path parameter's interval, at which the curve ends.
    """
    knots, values, first, second = [0.0], [np.zeros(6)], [np.zeros(6)], [np.zeros(6)]
    for target, swing in zip(prints, swings, strict=True):
        start, end = values[-1], np.zeros(6)
        end[:2] = target.position - sole.print.position
        end[5] = target.yaw - sole.print.yaw
        bump = np.r_[swing.aside, swing.height, swing.turn]
        duration = swing.end - swing.start
        knots += [swing.start, 0.5 * (swing.start + swing.end), swing.end]
        values += [start, 0.5 * (start + end) + bump, end]
        # The derivatives half way of a quintic blend, and of the bump 64 u³ (1 − u)³.
        first += [np.zeros(6), 1.875 * (end - start) / duration, np.zeros(6)]
        second += [np.zeros(6), -24.0 * bump / duration**2, np.zeros(6)]
    for column in (values, first, second):
        column.append(column[-1])
    return hermite_curve(np.r_[knots, length], np.array(values), np.array(first), np.array(second))


def _plane_rotation(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
