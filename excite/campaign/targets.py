"""Which base parameters are certain enough, which are not, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from excite.excitation.weakness import UnexcitedParameter
from excite.identification.judgement.poor import PATIENCE
from excite.identification.parameter_statistics import BaseParameter
from excite.robot.robot import Robot


class Reason(Enum):
    """Why a parameter misses its target; the value is what a person is told."""

    MORE_MOTION = "more motion of its joint would bring it there"
    NOISE = "too small against the sensors' noise: no reasonable amount of motion would bring it there"
    NOT_EXCITED = "the motions do not excite it"


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
        rsd = "unknown" if self.rsd_percent is None else f"{self.rsd_percent:.0f} %"
        return f"{self.parameter} ({rsd}): {self.reason.value}"


def misses(
    robot: Robot,
    essential: Sequence[BaseParameter],
    unexcited: Sequence[UnexcitedParameter],
    target_rsd: float,
) -> tuple[Miss, ...]:
    """The parameters that are not certain enough.

    Only essential parameters have to reach the target (Xu et al. 2020, end of section II.A: a parameter whose
    contribution cannot be told from zero is no part of the model). Standard deviations fall with the square
    root of the amount of motion, so that ``(rsd / target)²`` times the motion would be needed; past ten times
    the miss is put down to noise.

    Args:
        robot: the robot.
        essential: estimates of the essential parameters.
        unexcited: structural base parameters that the motions do not excite at all.
        target_rsd: relative standard deviation to reach [percent].
    """
    found = []
    for estimate in essential:
        if estimate.rsd_percent <= target_rsd:
            continue
        needed = (estimate.rsd_percent / target_rsd) ** 2
        reason = Reason.NOISE if needed > PATIENCE else Reason.MORE_MOTION
        found.append(Miss(estimate.name, estimate.rsd_percent, reason, _joints(robot, estimate.name)))
    found += [Miss(item.label, None, Reason.NOT_EXCITED, _joints(robot, item.label)) for item in unexcited]
    return tuple(found)


def joints_to_aim_at(robot: Robot, missed: Sequence[Miss]) -> tuple[str, ...]:
    """Joints whose motion helps the parameters that more motion can help, in the robot's order."""
    wanted = {joint for miss in missed if miss.reason is not Reason.NOISE for joint in miss.joints}
    return tuple(joint for joint in robot.joint_names if joint in wanted)


def _joints(robot: Robot, parameter: str) -> tuple[str, ...]:
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
