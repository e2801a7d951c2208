"""The verb ``capture``: from a plan to the sheet that somebody takes to the robot."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.atomic import write_text
from excite.conversion.capture_sheet import Capture, Run
from excite.display import count
from excite.documents.document import read_document
from excite.documents.plan import PlanDocument
from excite.errors import InputError
from excite.logs.header_blocks import Role
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot

# Grease and seals settle within minutes of motion; friction of cold drives is up to twice that of warm ones
# (Bittencourt and Gunnarsson 2012), and no identification shall mix both [s].
_WARM_UP_S = 300.0
# A second of rest gives a torque's noise; ten give its mean to a third of a per cent of it [s].
_STILL_S = 10.0
# Motions of which a repeat is asked for: the noise floor needs one, two show whether it drifts.
_REPEATED = 2
# Postures that are held, rows of each motion that they are chosen from, and the share of the largest load by which
# loads have to differ: the same posture once more tells nothing of gravity.
_HELD, _LOOKED_AT, _ALIKE = 3, 50, 0.1


@dataclass(frozen=True)
class Sheet:
    """A sheet that was written.

    Attributes:
        path: the file.
        capture: what it says.
    """

    path: Path
    capture: Capture


def capture(
    robot: RobotLike, plan: str | Path, out: str | Path | None = None, *, named: str | None = None
) -> Sheet:
    """Write the sheet of a plan, in Markdown.

    Args:
        robot: the robot, or what :func:`~excite.robot.load.load_robot` takes.
        plan: folder of a plan, with ``plan.json`` and ``motions/``.
        out: the file; ``capture.md`` in the plan's folder if None.
        named: what commands on the sheet call the robot, its file where it is no bundled one; its name if None.

    Returns:
        The sheet, and what is in it for programs.

    Raises:
        InputError: the plan is of another robot, or a motion of it is missing.
    """
    robot = as_robot(robot)
    folder = Path(plan).parent if Path(plan).name == "plan.json" else Path(plan)
    document = read_document(folder / "plan.json", PlanDocument)
    if document.robot != robot.name:
        raise InputError(
            f"is a plan of {document.robot!r}, not of {robot.name!r}",
            source=folder / "plan.json",
            field="robot",
            remedy="name the robot that it was made for",
        )
    planned: list[tuple[str, Role]] = [(item.motion, "identification") for item in document.selected]
    planned += [(item, "validation") for item in document.validation]
    if not document.validation and len(planned) > 1:
        # What a model is judged on was not fitted: of a plan that names no such motion, the last one.
        planned[-1] = (planned[-1][0], "validation")
    motions = [(load_motion(folder / name, robot), name, role) for name, role in planned]
    sheet = Capture(
        robot=robot.name,
        rate_hz=robot.description.sensors.rate_hz,
        joints=robot.joint_names,
        runs=tuple(_list_runs(robot, motions)),
    )
    path = Path(out) if out is not None else folder / "capture.md"
    text = sheet_text(sheet, robot, named or robot.name, path.name)
    write_text(path, text)
    return Sheet(path, sheet)


# What tells of a policy's drives in two minutes: standing, walking as it walks, and again to judge by [s].
_OF_POLICY = (
    ("stand", "static", 10.0, None, "stand still on all feet: zeros of encoders and torques"),
    ("walk", "motion", 60.0, "identification", "let the policy walk: turn, back up, change speed"),
    ("walk_again", "motion", 30.0, "validation", "the same once more: what judges the answer"),
)


def capture_policy(robot: RobotLike, out: str | Path | None = None, *, named: str | None = None) -> Sheet:
    """Write the sheet for a policy that misbehaves: its own motion, recorded with what its drives can be told by.

    Args:
        robot: a robot that stands on feet, or what :func:`~excite.robot.load.load_robot` takes.
        out: the file; ``policy.md`` if None.
        named: what commands on the sheet call the robot; its name if None.

    Raises:
        InputError: the robot does not stand on feet.
    """
    robot = as_robot(robot)
    if not robot.floating or not robot.feet:
        raise InputError(
            "does not stand on feet",
            source=robot.source,
            field="base",
            remedy="record an arm's policy as any motion: q, q_cmd and tau; then excite diagnose",
        )
    runs = [
        Run.model_validate({"name": name, "kind": kind, "duration_s": seconds, "role": role})
        for name, kind, seconds, role, _ in _OF_POLICY
    ]
    sheet = Capture(
        robot=robot.name,
        rate_hz=robot.description.sensors.rate_hz,
        joints=robot.joint_names,
        runs=tuple(runs),
    )
    whose = shlex.quote(named or robot.name)
    flags = " ".join(f"`contact.{foot.name}`" for foot in robot.feet)
    lines = [
        f"# Recording a policy of {robot.name}",
        "",
        "Two minutes of the policy's own walk. Name each recording as its run is called.",
        "",
        "## Before",
        "",
        "- Note kp and kd that the policy sends, its rate, its default pose and action scale, and the firmware.",
        "",
        "## Order",
        "",
        "| run | what | role | s | done |",
        "| --- | --- | --- | --- | --- |",
        *(f"| {name} | {what} | {role or ''} | {s:.0f} | ☐ |" for name, _, s, role, what in _OF_POLICY),
        "",
        "## Record",
        "",
        f"- At {sheet.rate_hz:g} Hz, the driver's own rate and not the policy's: positions, velocities and torque "
        "estimates of all joints, the commands as sent (`q_cmd`), the IMU (gyroscope and accelerometer),",
        f"  contact flags {flags}. Unitree: `rt/lowstate` and `rt/lowcmd`.",
        "",
        "## After",
        "",
        f"- `excite convert walk.* walk_again.* --robot {whose} --out log`, `controller: {{kp: …, kd: …}}` into "
        "`log/log.yaml`, then `excite diagnose log`.",
        "",
        "## For `excite convert --capture`",
        "",
        "```yaml",
        sheet.text().rstrip(),
        "```",
        "",
    ]
    path = Path(out) if out is not None else Path("policy.md")
    text = "\n".join(lines)
    write_text(path, text)
    return Sheet(path, sheet)


def _list_runs(robot: Robot, motions: list[tuple[Motion, str, Role]]) -> list[Run]:
    runs = [
        Run(name="warm_up", kind="warm_up", duration_s=_WARM_UP_S, motion=motions[0][1] if motions else None)
    ]
    runs += [Run(name="zero_torque", kind="zero_torque", duration_s=_STILL_S)]
    for motion, name, role in motions:
        runs.append(_build_run(robot, motion, name, role, motion.name, None))
    chosen = [item for item in motions if item[2] == "identification"]
    for motion, name, role in chosen[:_REPEATED]:
        runs.append(_build_run(robot, motion, name, role, f"{motion.name}_again", motion.name))
    for k, (motion, name, row) in enumerate(_postures(robot, chosen)):
        runs.append(
            Run(
                name=f"static_{k + 1}",
                kind="static",
                duration_s=_STILL_S,
                motion=name,
                at_s=round(float(motion.time[row] - motion.time[0]), 3),
                start=_positions(robot, motion, row),
            )
        )
    return runs


def _postures(robot: Robot, motions: list[tuple[Motion, str, Role]]) -> list[tuple[Motion, str, int]]:
    """Rows of motions at which gravity loads the joints most differently, three at the most.

    Each is the farthest from those before it, in shares of each joint's largest load. What stands on feet is sure to
    stand still only where its motions begin.
    """
    rows = [
        (motion, name, row)
        for motion, name, _ in motions
        for row in range(0, 1 if robot.floating else len(motion.time), max(1, len(motion.time) // _LOOKED_AT))
    ]
    if not rows:
        return []
    data = robot.model.createData()
    loads = np.array(
        [pin.computeGeneralizedGravity(robot.model, data, motion.q[row]) for motion, _, row in rows]
    )
    loads = loads / np.maximum(np.abs(loads).max(axis=0), 1e-9)
    chosen = [0]
    while len(chosen) < _HELD:
        apart = np.linalg.norm(loads[:, None] - loads[chosen], axis=2).min(axis=1)
        if apart.max() < _ALIKE:
            break
        chosen.append(int(np.argmax(apart)))
    return [rows[k] for k in chosen]


def _build_run(robot: Robot, motion: Motion, file: str, role: Role, name: str, repeats: str | None) -> Run:
    return Run(
        name=name,
        kind="motion",
        duration_s=round(float(motion.time[-1] - motion.time[0]), 3),
        motion=file,
        role=role,
        repeats=repeats,
        start=_positions(robot, motion, 0),
    )


def _positions(robot: Robot, motion: Motion, row: int) -> dict[str, float]:
    values = motion.q[row, robot.n_base_q :]
    return {joint: round(float(value), 4) for joint, value in zip(robot.joint_names, values, strict=True)}


def sheet_text(sheet: Capture, robot: Robot, named: str, file: str = "capture.md") -> str:
    """The sheet in Markdown; its last block is for `excite convert --capture`.

    Args:
        sheet: what it says.
        robot: the robot.
        named: what commands call the robot.
        file: what they call the sheet.
    """
    total = sum(run.duration_s for run in sheet.runs)
    again = sum(run.repeats is not None for run in sheet.motions)
    still = sum(run.kind == "static" for run in sheet.runs)
    lines = [
        f"# Recording {sheet.robot}",
        "",
        f"{count(len(sheet.runs), 'run')} in the order of the table: warm-up, torques off, "
        f"{count(len(sheet.motions) - again, 'motion')}, {again} of them again, {count(still, 'posture')} held; "
        f"{total / 60.0:.0f} minutes in all. Name each recording as its run is called.",
        "",
        "## Before",
        "",
        f"- Re-check on the day, in the plan's folder: `excite check {shlex.quote(named)} motions/`; emergency stop "
        "within reach, space clear.",
        "- Note the load, the temperature, the controller's gains and the firmware.",
        f"- Warm up: {_WARM_UP_S / 60.0:.0f} minutes of the first motion, not recorded for identification.",
        "",
        "## Order",
        "",
        "| run | what | role | s | done |",
        "| --- | --- | --- | --- | --- |",
    ]
    for run in sheet.runs:
        lines.append(
            f"| {run.name} | {_describe_run(run, robot)} | {run.role or ''} | {run.duration_s:.0f} | ☐ |"
        )
    lines += [
        "",
        "## Record",
        "",
        *_list_topics(sheet, robot),
        "",
        "## After the first motion, before going on",
        "",
        *_list_checks(sheet, named, file),
    ]
    return "\n".join(
        [*lines, "", "## For `excite convert --capture`", "", "```yaml", sheet.text().rstrip(), "```", ""]
    )


def _describe_run(run: Run, robot: Robot) -> str:
    # What stands falls without torques.
    hung = "hung up, " if robot.floating else ""
    return {
        "warm_up": f"{run.motion} over and over",
        "zero_torque": f"{hung}torques off (or brakes on), nothing touches it: offsets and noise of torques and "
        "currents",
        "static": f"hold still where {run.motion} is {_when(run)}: gravity and stiction alone",
        "motion": f"{run.motion}" + (f", again ({run.repeats}): the noise floor" if run.repeats else ""),
    }[run.kind]


def _when(run: Run) -> str:
    if run.at_s == 0.0:
        return "at its start"
    return f"{run.at_s:g} s after its start (" + ", ".join(f"{j} {q:.2f}" for j, q in run.start.items()) + ")"


def _list_topics(sheet: Capture, robot: Robot) -> list[str]:
    joints = count(len(sheet.joints), "joint")
    lines = [
        f"- {joints}: measured position, measured torque or current, commanded position; all at "
        f"{sheet.rate_hz:g} Hz or faster,",
        "  with the time of measurement in every row. Record before any filter.",
        "- ROS: `/joint_states` and the controller's state; Unitree: `rt/lowstate` and `rt/lowcmd`; UR: RTDE at "
        "500 Hz; "
        "Franka: `q dq tau_J q_d` at 1 kHz.",
    ]
    if robot.floating:
        sensors = ", ".join(sensor.name for sensor in robot.sensors)
        contact = f"contact wrenches ({sensors})" if sensors else "which feet carry (forces or contact flags)"
        lines.append(f"- Pose of the base (link {robot.base_link}) and {contact} on the same clock.")
    return lines


def _list_checks(sheet: Capture, named: str, file: str) -> list[str]:
    first = next((run.name for run in sheet.logged), "the first motion")
    return [
        f"- `excite convert {first}.* --robot {shlex.quote(named)} --out first "
        f"--capture {shlex.quote(file)}`: "
        "every joint is found, its unit is right, nothing is asked.",
        "- `excite doctor first`: no finding that spoils; no turned torque, no clipping, "
        "rate as asked, delay below a sample or two.",
        "- Every joint moves, and its torque changes when it does.",
    ]
