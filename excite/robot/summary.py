"""What there is to say about each bundled robot in a line."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from excite.robot.catalogue import bundled_robots
from excite.robot.loading import load_robot
from excite.robot.robot import Robot


@dataclass(frozen=True)
class RobotSummary:
    """A robot in a line.

    Attributes:
        name: bundled name.
        title: what it is.
        base: ``fixed`` or ``floating``.
        n_joints: actuated joints, the degrees of freedom beside the base.
        mass: total mass of the moving segments [kg].
        sensors: what it measures beside joint angles: names of wrench sensors with their kind, or where
            joint torque is measured.
        rate_hz: sampling rate of the sensors [Hz].
    """

    name: str
    title: str
    base: str
    n_joints: int
    mass: float
    sensors: tuple[str, ...]
    rate_hz: float

    def to_json(self) -> dict[str, object]:
        """The fields by name, ready for JSON."""
        return {**asdict(self), "sensors": list(self.sensors)}


def summarise_robot(robot: Robot) -> RobotSummary:
    """Summary of one robot."""
    sensors = [f"{sensor.name} ({sensor.kind})" for sensor in robot.sensors]
    torque = robot.description.sensors.joint_torque
    if torque is not None:
        sensors.append(f"joint torque ({torque})")
    return RobotSummary(
        name=robot.name,
        title=robot.description.title,
        base=robot.description.base,
        n_joints=robot.n_joints,
        mass=round(robot.mass, 3),
        sensors=tuple(sensors),
        rate_hz=robot.description.sensors.rate_hz,
    )


def robot_summaries() -> tuple[RobotSummary, ...]:
    """Summaries of all bundled robots, by name; raises RobotError if one of them is broken."""
    return tuple(summarise_robot(load_robot(name)) for name in bundled_robots())
