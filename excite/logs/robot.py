"""The robot that a log speaks of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.errors import LogError, RobotError
from excite.logs.bare_urdf import bare_description
from excite.logs.header import header_path, read_header
from excite.logs.header_blocks import FootHeader, SensorHeader
from excite.logs.log import Log, LogHeader
from excite.robot.bringing import load_robot
from excite.robot.catalogue import bundled_robots
from excite.robot.links import link_placement
from excite.robot.loading import build_robot
from excite.robot.mechanisms.mechanism import Mechanism
from excite.robot.robot import Robot, WrenchSensor


def nominal_robot(log: Log) -> Robot:
    """Robot of a log that was read from a folder, from the model file that its header names.

    A bare URDF says nothing of postures, gains and accelerations; those get placeholders that identification
    does not use. Movable joints of the URDF that are not in the log are locked at zero. Inertias that no body
    has are accepted, being a starting value only; :func:`~excite.logs.bare_urdf.nominal_faults` names them.

    Raises:
        LogError: the log was made in memory, or the URDF does not fit the header.
        RobotError: the model is malformed.
    """
    if log.folder is None:
        raise LogError("was made in memory", field="robot", remedy="hand the robot over")
    file = log.folder / log.header.robot
    if _names_bundled(log):
        loaded = _robot_as_held(load_robot(log.header.robot), log.header)
        return robot_in_log(loaded, log.header, log.folder / "log.yaml")
    if file.suffix in {".yaml", ".yml"}:
        return robot_in_log(load_robot(file), log.header, log.folder / "log.yaml")
    return robot_in_log(
        build_robot(bare_description(file, log.header), file), log.header, log.folder / "log.yaml"
    )


def _names_bundled(log: Log) -> bool:
    """Whether a log's header names a bundled robot, not a file beside it."""
    beside = log.folder is not None and (log.folder / log.header.robot).is_file()
    return not beside and log.header.robot in bundled_robots()


def robot_for_log(name_or_path: str | Path, log: str | Path) -> Robot:
    """The robot that logs are to be read with: a bundled one, a ``robot.yaml``, or a bare model.

    Args:
        name_or_path: bundled name or path; of a URDF only the joints that the log has stay movable.
        log: a log folder or its ``log.yaml``; asked only where a URDF is given.

    Returns:
        The robot, checked.

    Raises:
        RobotError: the model is malformed; LogError: the log's header is, or does not fit the URDF.
        UnknownNameError: no such robot.
    """
    file = Path(name_or_path)
    if file.suffix != ".urdf":
        robot = load_robot(name_or_path)
        return _robot_as_held(robot, read_header(header_path(log))) if robot.floating else robot
    path = header_path(log)
    header = read_header(path)
    return robot_in_log(build_robot(bare_description(file, header), file), header, path)


def _robot_as_held(robot: Robot, header: LogHeader) -> Robot:
    """The robot as a log has it: one that stands on feet may have been held, by a stand or by hands."""
    if not robot.floating or header.base != "held":
        return robot
    sensors = robot.description.sensors.model_copy(update={"wrench": ()})
    held = robot.description.model_copy(update={"base": "held", "feet": (), "sensors": sensors})
    return build_robot(held, robot.source)


def robot_in_log(robot: Robot, header: LogHeader, source: Path | None = None) -> Robot:
    """The robot with the gravity and the wrench sensors that a log states.

    Args:
        robot: the robot.
        header: contents of ``log.yaml``.
        source: file to name in errors.

    Returns:
        A robot that differs in ``model.gravity`` and ``sensors`` only, and in which of a mechanism's joints follow from
        which; one that hangs stands on no feet.

    Raises:
        LogError: base, joints, base link or sensors do not fit the robot.
    """
    if robot.floating != header.free_base:
        raise LogError(f"is {header.base}, unlike that of robot {robot.name!r}", source=source, field="base")
    for joint in header.joints:
        if joint not in robot.joint_names:
            raise LogError(
                f"robot {robot.name!r} has no joint {joint!r}",
                source=source,
                field="joints",
                remedy="it has " + ", ".join(robot.joint_names),
            )
    if robot.mechanism is not None:
        robot = replace(robot, mechanism=_logged_mechanism(robot.mechanism, robot, header, source))
    model = robot.model.copy()
    model.gravity.linear = np.array(header.gravity)
    sensors = tuple(_wrench_sensor(robot, sensor, source) for sensor in header.sensors)
    if header.base == "suspended":
        return replace(robot, model=model, sensors=(), feet=())
    return replace(robot, model=model, sensors=sensors)


def _logged_mechanism(
    mechanism: Mechanism, robot: Robot, header: LogHeader, source: Path | None
) -> Mechanism:
    """The mechanism by what a log has of it: its motors, or the joints that these move, from which the rest follows."""
    columns = np.array([robot.n_base_v + robot.joint_index(name) for name in header.joints], dtype=np.int64)
    found = mechanism.following_from(columns)
    both = np.intersect1d(found.passive, columns)
    if len(both):
        name = robot.joint_names[int(both[0]) - robot.n_base_v]
        raise LogError(
            f"says where joint {name!r} is, and it follows from others that it has, too",
            source=source,
            field="joints",
            remedy="leave it out, or the motors that move it",
        )
    return found


def base_offset(robot: Robot, header: LogHeader, source: Path | None = None) -> pin.SE3:
    """Pose of the logged base link in the frame of the free-flyer; raises LogError if it moves there."""
    if header.base_link is None:
        return pin.SE3.Identity()
    try:
        joint, placement = link_placement(robot.model, header.base_link, source, "base_link")
    except RobotError as error:
        raise LogError(error.what, source=source, field="base_link", remedy=error.remedy) from error
    if joint != 1:
        raise LogError(
            f"link {header.base_link!r} moves against the root {robot.base_link!r}",
            source=source,
            field="base_link",
            remedy="log the pose of the root link, or of one fixed to it",
        )
    return placement


def imu_placement(robot: Robot, header: LogHeader, source: Path | None = None) -> pin.SE3:
    """Pose of the IMU's link in the frame of the free-flyer; raises LogError where it is not on the base."""
    link = "" if header.imu is None else header.imu.link
    try:
        joint, placement = link_placement(robot.model, link, source, "imu.link")
    except RobotError as error:
        raise LogError(error.what, source=source, field="imu.link", remedy=error.remedy) from error
    if joint != 1:
        raise LogError(
            f"link {link!r} moves against the root {robot.base_link!r}",
            source=source,
            field="imu.link",
            remedy="log the IMU of the root link, or of one fixed to it",
        )
    return placement


def _wrench_sensor(robot: Robot, header: SensorHeader, source: Path | None) -> WrenchSensor:
    field = f"sensors.{header.name}"
    offset = pin.SE3(pin.rpy.rpyToMatrix(*header.rpy), np.array(header.xyz))
    try:
        joint, parent = (0, pin.SE3.Identity())
        if header.parent != "world":
            joint, parent = link_placement(robot.model, header.parent, source, f"{field}.parent")
        link_placement(robot.model, header.foot, source, f"{field}.foot")
        excludes = tuple(
            sorted(
                link_placement(robot.model, link, source, f"{field}.excludes")[0] - 1
                for link in header.excludes
            )
        )
    except RobotError as error:
        raise LogError(error.what, source=source, field=error.field, remedy=error.remedy) from error
    if (header.kind == "force_plate") != (header.parent == "world"):
        raise LogError(
            f"a {header.kind} has parent {header.parent!r}",
            source=source,
            field=f"{field}.parent",
            remedy="a force_plate has world for parent, a foot_ft a link",
        )
    return WrenchSensor(
        name=header.name,
        kind=header.kind,
        link=header.parent,
        joint=joint,
        placement=parent * offset,
        foot=header.foot,
        excludes=excludes,
        excludes_links=header.excludes,
        noise_force=header.noise_force or 0.0,
        noise_moment=header.noise_moment or 0.0,
    )


def foot_headers(robot: Robot) -> tuple[FootHeader, ...]:
    """The robot's feet as ``log.yaml`` has them."""
    blocks = {block.name: block for block in robot.description.feet}
    made = []
    for foot in robot.feet:
        centre = None
        if foot.radius > 0.0:
            # A log has no posture at rest, in which a ball's corner would be the lowest point.
            link = link_placement(robot.model, foot.link, robot.source, "feet")[1]
            x, y, z = np.round(link.actInv(foot.centre), 9).tolist()
            centre = (x, y, z)
        sole = blocks[foot.name].sole
        made.append(FootHeader(name=foot.name, link=foot.link, sole=sole, radius=foot.radius, centre=centre))
    return tuple(made)


def sensor_headers(robot: Robot) -> tuple[SensorHeader, ...]:
    """The robot's contact wrench sensors as ``log.yaml`` has them."""
    return tuple(
        SensorHeader(
            name=block.name,
            kind=block.kind,
            parent="world" if block.kind == "force_plate" else block.link,
            xyz=block.xyz,
            rpy=block.rpy,
            foot=robot.foot(block.foot).link,
            excludes=block.excludes,
            noise_force=block.noise_force,
            noise_moment=block.noise_moment,
        )
        for block in robot.description.sensors.wrench
    )
