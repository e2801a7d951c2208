"""Which base parameters are certain enough, which are not, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from excite.excitation.weakness import UnexcitedParameter
from excite.identification.judgement.poor import PATIENCE, said_rsd
from excite.identification.parameter_statistics import BaseParameter
from excite.robot.robot import Robot

# Deviations of averages fall with so much of a power of the number of samples.
_SQUARE_ROOT = 0.5


class Reason(Enum):
    """Why a parameter misses its target; the value is what a person is told."""

    MORE_MOTION = "more motion of its joint would bring it there"
    NOISE = "too small against the sensors' noise: no reasonable amount of motion would bring it there"
    STALLED = "hardly fell with the motion added so far: no reasonable amount of more would bring it there"
    NOT_EXCITED = "the motions do not excite it"

    @property
    def helped_by_motion(self) -> bool:
        """Whether more motion may bring a parameter to its target."""
        return self in {Reason.MORE_MOTION, Reason.NOT_EXCITED}


@dataclass(frozen=True)
class Earlier:
    """What an earlier iteration found.

    Attributes:
        seconds: motion that identification had after it [s].
        rsd_percent: by essential base parameter.
    """

    seconds: float
    rsd_percent: Mapping[str, float]


@dataclass(frozen=True)
class Miss:
    """A base parameter that misses the target.

    Attributes:
        parameter: name of its first standard parameter.
        rsd_percent: relative standard deviation [percent]; None where the data say nothing of it.
        reason: why.
        joints: joints whose motion would help.
    """

    parameter: str
    rsd_percent: float | None
    reason: Reason
    joints: tuple[str, ...]

    def __str__(self) -> str:
        rsd = "" if self.rsd_percent is None else f" ({said_rsd(self.rsd_percent)})"
        return f"{self.parameter}{rsd}: {self.reason.value}"


def missed_targets(
    robot: Robot,
    essential: Sequence[BaseParameter],
    unexcited: Sequence[UnexcitedParameter],
    target_rsd: float,
    *,
    seconds: float = 0.0,
    earlier: Sequence[Earlier] = (),
) -> tuple[Miss, ...]:
    """The parameters that are not certain enough.

    Only essential parameters have to reach the target (Xu et al. 2020, end of section II.A: a parameter whose
    contribution cannot be told from zero is no part of the model). Standard deviations fall with the square
    root of the amount of motion, so that ``(rsd / target)²`` times the motion would be needed; past ten times
    the miss is put down to noise. Where earlier iterations saw the parameter and it fell more slowly than that
    (``seconds^−p`` with p < ½), ``(rsd / target)^(1/p)`` times are needed, and past ten times it stalls. Of 11
    campaigns of five iterations, UR10 and Panda, target 6 %, none of the 15 misses so called was met by the end,
    with up to five times the motion; of the 78 others 18 were. (Parameters were counted at each iteration, and the
    same campaigns had led to the rule.)

    Args:
        robot: the robot.
        essential: estimates of the essential parameters.
        unexcited: structural base parameters that the motions do not excite at all.
        target_rsd: relative standard deviation to reach [percent].
        seconds: motion that identification had [s].
        earlier: iterations before this one, in order.
    """
    found = []
    for estimate in essential:
        if estimate.rsd_percent <= target_rsd:
            continue
        short = estimate.rsd_percent / target_rsd
        if short > PATIENCE**_SQUARE_ROOT:
            reason = Reason.NOISE
        elif short > PATIENCE ** _deviation_exponent(estimate.name, estimate.rsd_percent, seconds, earlier):
            reason = Reason.STALLED
        else:
            reason = Reason.MORE_MOTION
        found.append(Miss(estimate.name, estimate.rsd_percent, reason, _joints_moving(robot, estimate.name)))
    found += [
        Miss(item.label, None, Reason.NOT_EXCITED, _joints_moving(robot, item.label)) for item in unexcited
    ]
    return tuple(found)


def _deviation_exponent(
    parameter: str, rsd_percent: float, seconds: float, earlier: Sequence[Earlier]
) -> float:
    """The power of motion with which a parameter's deviation fell since it was first seen; at most ½, at least 0."""
    first = next((one for one in earlier if one.rsd_percent.get(parameter, 0.0) > 0.0), None)
    if first is None or not seconds > first.seconds > 0.0:
        return _SQUARE_ROOT
    fell = math.log(first.rsd_percent[parameter] / rsd_percent) / math.log(seconds / first.seconds)
    return min(max(fell, 0.0), _SQUARE_ROOT)


def joints_to_aim_at(robot: Robot, missed: Sequence[Miss]) -> tuple[str, ...]:
    """Joints whose motion helps the parameters that more motion can help, in the robot's order."""
    wanted = {joint for miss in missed if miss.reason.helped_by_motion for joint in miss.joints}
    return tuple(joint for joint in robot.joint_names if joint in wanted)


def _joints_moving(robot: Robot, parameter: str) -> tuple[str, ...]:
    """Joints that move the body of a parameter ``Izz(SEGMENT)``: its own and the one before; or a drive's."""
    inside = parameter.partition("(")[2].rstrip(")")
    if inside in robot.joint_names:
        return (inside,)
    for segment in robot.segments:
        if inside in (segment.name, segment.link):
            names = robot.model.names
            own, before = segment.joint, robot.model.parents[segment.joint]
            return tuple(names[joint] for joint in (own, before) if names[joint] in robot.joint_names)
    return ()
