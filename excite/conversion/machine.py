"""What of a robot helps to understand a recording: its joints in order, their ranges, the text of its model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.reading.file import read_text
from excite.reading.xml_document import MAX_XML_BYTES
from excite.robot.bringing import load_robot
from excite.robot.loading import portable_description
from excite.robot.robot import Robot
from excite.robot.sliding import is_prismatic
from excite.robot.urdf.model import urdf_model
from excite.robot.urdf.reading import parse_urdf

# Joints of the simplest leg: hip and knee.
_LEG = 2


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot as a recording sees it.

    Attributes:
        name: of the robot.
        joints: names of the joints that move by themselves, in the model's order.
        lower: ``(n,)`` [rad or m], ``upper`` too; infinite where the model states none.
        speed: ``(n,)`` largest speeds [rad/s or m/s]; nan where the model states none.
        torque: ``(n,)`` largest torques [N·m or N]; infinite where none is stated.
        slides: ``(n,)`` whether a joint slides instead of turning.
        floating: whether the base is free.
        base_link: the root link.
        gravity: ``(3,)`` in the world frame [m/s²].
        text: of the URDF, or of a robot.yaml where a URDF does not say all of it.
        robot: the robot with its limits, None for a bare URDF whose base is fixed.
    """

    name: str
    joints: tuple[str, ...]
    lower: Array
    upper: Array
    speed: Array
    torque: Array
    slides: Array
    floating: bool
    base_link: str
    gravity: tuple[float, float, float]
    text: str
    robot: Robot | None

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def file(self) -> str:
        """Name of the model's file in a log."""
        return "robot.urdf" if self.robot is None or self.robot.mechanism is None else "robot.yaml"

    @property
    def motors(self) -> frozenset[str]:
        """Motors of transmissions, which move joints together."""
        blocks = () if self.robot is None else self.robot.description.transmissions
        return frozenset(motor.name for block in blocks for motor in block.motors)


def load_machine(name_or_path: str | Path) -> Machine:
    """A bundled robot, a ``robot.yaml``, or a bare URDF, xacro or MuJoCo model; raises RobotError."""
    path = Path(name_or_path)
    if path.suffix == ".urdf":
        return _of_urdf(path)
    robot = load_robot(name_or_path)
    return _of_robot(robot, robot.driven_names)


def at_joints(machine: Machine) -> Machine:
    """The machine as a recording has it that speaks of joints where transmissions have motors."""
    robot = machine.robot
    if robot is None:
        return machine
    there = {
        motor.name: joint
        for block in robot.description.transmissions
        for motor, joint in zip(block.motors, block.joints, strict=True)
    }
    return _of_robot(robot, tuple(there.get(name, name) for name in machine.joints))


def _of_robot(robot: Robot, joints: tuple[str, ...]) -> Machine:
    places = [robot.joint_index(name) for name in joints]
    gravity = np.asarray(robot.model.gravity.linear, dtype=float)
    return Machine(
        name=robot.name,
        joints=joints,
        lower=np.asarray(robot.limits.position_lower, dtype=float)[places],
        upper=np.asarray(robot.limits.position_upper, dtype=float)[places],
        speed=_stated(np.asarray(robot.limits.velocity, dtype=float)[places]),
        torque=np.asarray(robot.limits.torque, dtype=float)[places],
        slides=np.array([is_prismatic(robot.model, robot.n_base_v + place) for place in places]),
        floating=robot.floating,
        base_link=robot.base_link,
        gravity=(float(gravity[0]), float(gravity[1]), float(gravity[2])),
        text=robot.urdf if robot.mechanism is None else portable_description(robot),
        robot=robot,
    )


def _stated(speeds: Array) -> Array:
    """Limits of speed, nan for those that are none."""
    return np.where(np.isfinite(speeds) & (speeds > 0.0), speeds, np.nan)


def _of_urdf(path: Path) -> Machine:
    root = parse_urdf(path)
    model = urdf_model(root, path)
    followers = {joint.get("name") for joint in root.findall("joint") if joint.find("mimic") is not None}
    names = tuple(name for name in tuple(model.names)[1:] if name not in followers)
    children = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
    links = [link.get("name", "") for link in root.findall("link")]
    moved = [model.joints[model.getJointId(name)] for name in names]
    order = [joint.idx_v for joint in moved]
    # What turns on and on has the two numbers of a direction for a position, and no range.
    ends = np.array([joint.nq == 1 for joint in moved])

    def limits(values: Array, missing: float, places: list[int] = order) -> Array:
        found = np.asarray(values, dtype=float)[places]
        return np.where(np.isfinite(found) & (np.abs(found) < 1e10), found, missing)

    at = [joint.idx_q for joint in moved]
    lower = limits(model.lowerPositionLimit, -np.inf, at)
    upper = limits(model.upperPositionLimit, np.inf, at)
    # A joint that is logged moves: a range without width is one that nobody has filled in.
    ends &= lower < upper
    effort = limits(model.effortLimit, np.inf)
    standing = _standing_robot(path, model)
    return Machine(
        name=model.name or path.stem,
        joints=names,
        lower=np.where(ends, lower, -np.inf),
        upper=np.where(ends, upper, np.inf),
        speed=_stated(limits(model.velocityLimit, np.nan)),
        torque=np.where(effort > 0.0, effort, np.inf),
        slides=np.array([is_prismatic(model, place) for place in order]),
        floating=standing is not None,
        base_link=next((link for link in links if link not in children), ""),
        gravity=(0.0, 0.0, -9.81),
        text=read_text(path, limit=MAX_XML_BYTES),
        robot=standing,
    )


def _standing_robot(path: Path, model: pin.Model) -> Robot | None:
    """The robot of a bare URDF whose base is free, as the first description has it of a model that has limbs."""
    limbs = ((len(model.subtrees[child]) >= _LEG for child in children) for children in model.children)
    if all(sum(several) < 2 for several in limbs):
        return None
    try:
        robot = load_robot(path)
    except RobotError:
        return None
    return robot if robot.floating and robot.mechanism is None else None
