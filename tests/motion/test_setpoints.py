"""Goals: the curve that a controller runs through setpoints, as files state them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import excite
from excite.errors import MotionError
from excite.formats.lerobot import write_data_set
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.motion.readers.tables import STATEMENT
from excite.robot.robot import Robot
from excite.safety.check import check_motion

pytestmark = pytest.mark.usefixtures("readers_here")

SHARED = Path(__file__).resolve().parents[3] / "shared" / "cases"
STEP_S = 0.1


@pytest.fixture(scope="module")
def arm() -> Robot:
    return excite.load_robot("ur10")


def setpoints(arm: Robot, points: int = 11) -> dict[str, np.ndarray]:
    """A slow way of the wrist from rest to rest, with its derivatives."""
    time = STEP_S * np.arange(points)
    rate = np.pi / time[-1]
    shape = {
        "q": 0.15 * (0.375 - 0.5 * np.cos(2 * rate * time) + 0.125 * np.cos(4 * rate * time)),
        "v": 0.15 * rate * (np.sin(2 * rate * time) - 0.5 * np.sin(4 * rate * time)),
        "a": 0.15 * rate**2 * (2 * np.cos(2 * rate * time) - 2 * np.cos(4 * rate * time)),
    }
    found = {"time": time}
    for prefix, values in shape.items():
        for k, joint in enumerate(arm.joint_names):
            rest = arm.rest[k] if prefix == "q" else 0.0
            found[f"{prefix}.{joint}"] = rest + (values if joint == "wrist_3_joint" else 0.0 * values)
    return found


def written(columns: dict[str, np.ndarray], path: Path) -> Path:
    np.savetxt(
        path, np.column_stack(list(columns.values())), "%.12g", ",", header=",".join(columns), comments=""
    )
    return path


def goal(columns: dict[str, np.ndarray], arm: Robot, path: Path) -> Path:
    """The same as a FollowJointTrajectory goal."""
    fields = {"q": "positions", "v": "velocities", "a": "accelerations"}
    lines = ["trajectory:", f"  joint_names: [{', '.join(arm.joint_names)}]", "  points:"]
    for row, time in enumerate(columns["time"]):
        lines.append(
            f"  - time_from_start: {{sec: {int(time + 1e-9)}, nanosec: {round(1e9 * (time % 1.0)) % 10**9}}}"
        )
        for prefix, name in fields.items():
            if f"{prefix}.{arm.joint_names[0]}" in columns:
                values = ", ".join(f"{columns[f'{prefix}.{joint}'][row]:.12g}" for joint in arm.joint_names)
                lines.append(f"    {name}: [{values}]")
    path.write_text("\n".join(lines) + "\n")
    return path


def only(columns: dict[str, np.ndarray], *prefixes: str) -> dict[str, np.ndarray]:
    return {name: values for name, values in columns.items() if name[0] in ("t", *prefixes)}


def kinds(arm: Robot, motion: Motion) -> set[str]:
    return {violation.kind for violation in check_motion(arm, motion).violations}


def test_a_goal_with_accelerations_is_safe_and_its_quintic_is_what_is_judged(
    arm: Robot, tmp_path: Path
) -> None:
    columns = setpoints(arm)
    for path in (written(columns, tmp_path / "goal.csv"), goal(columns, arm, tmp_path / "goal.yaml")):
        motion = load_motion(path, arm)
        assert motion.is_goal and motion.n_samples == 11
        verdict = check_motion(arm, motion)
        assert verdict.safe, verdict.reason
    # A velocity asked for at one point makes the curve swing between it and its neighbours.
    columns["v.wrist_3_joint"][5] += 3.0
    found = kinds(arm, load_motion(written(columns, tmp_path / "goal.csv"), arm))
    assert {"joint_acceleration", "joint_jerk"} <= found and "rate_too_low" not in found


def test_a_planners_goal_from_a_file_is_judged(tmp_path: Path) -> None:
    folder = SHARED / "c07_jtc_10hz"
    if not folder.is_dir():
        pytest.skip("no shared data")
    robot = excite.load_robot(folder / "arm.urdf")
    verdict = check_motion(robot, load_motion(folder / "goal.csv", robot))
    assert verdict.safe, verdict.reason


def test_velocities_alone_make_cubics_whose_acceleration_jumps(arm: Robot, tmp_path: Path) -> None:
    columns = setpoints(arm)
    motion = load_motion(written(only(columns, "q", "v"), tmp_path / "goal.csv"), arm)
    cubic = CubicHermiteSpline(columns["time"], columns["q.wrist_3_joint"], columns["v.wrist_3_joint"])
    wrist = arm.joint_index("wrist_3_joint")
    np.testing.assert_allclose(motion.q[:, wrist], cubic(motion.time), atol=1e-9)
    np.testing.assert_allclose(motion.v[:, wrist], cubic(motion.time, 1), atol=1e-9)
    np.testing.assert_allclose(motion.a[:-1, wrist], cubic(motion.time[:-1], 2), atol=1e-6)
    assert kinds(arm, motion) == set()
    # Velocities that are not the way's make the acceleration jump at every point.
    columns["v.wrist_3_joint"] *= 1.15
    jumping = load_motion(written(only(columns, "q", "v"), tmp_path / "goal.csv"), arm)
    assert "joint_jerk" in kinds(arm, jumping)


def test_positions_alone_are_lines_in_a_goal_and_samples_in_a_table(arm: Robot, tmp_path: Path) -> None:
    columns = only(setpoints(arm), "q")
    assert kinds(arm, load_motion(written(columns, tmp_path / "table.csv"), arm)) == {"rate_too_low"}
    lines = load_motion(goal(columns, arm, tmp_path / "goal.yaml"), arm)
    slope = np.diff(columns["q.wrist_3_joint"]) / STEP_S
    assert np.abs(lines.v).max() == pytest.approx(np.abs(slope).max())
    turn = np.abs(np.diff(slope)).max()
    assert np.abs(lines.a).max() == pytest.approx(2.0 * turn * 200.0)
    assert {"joint_acceleration", "joint_jerk"} <= kinds(arm, lines)
    assert not kinds(arm, lines) & {"velocity_not_derivative", "acceleration_not_derivative", "rate_too_low"}


def test_uneven_setpoints_and_long_waits(arm: Robot, tmp_path: Path) -> None:
    """Sixty seconds of rest are no gap; a month is no goal."""
    columns = setpoints(arm)
    waited = {**columns, "time": columns["time"] + np.where(np.arange(11) == 10, 60.0, 0.0)}
    for prefix in "va":
        waited[f"{prefix}.wrist_3_joint"][9] = 0.0
    waited["q.wrist_3_joint"][9] = waited["q.wrist_3_joint"][10]
    assert "time_gap" not in kinds(arm, load_motion(written(waited, tmp_path / "goal.csv"), arm))
    month = {**columns, "time": 1e5 * np.arange(11.0)}
    assert kinds(arm, load_motion(written(month, tmp_path / "goal.csv"), arm)) == {"time_gap"}
    with pytest.raises(MotionError, match="lasts 1e"):
        load_motion(written(only(month, "q", "v"), tmp_path / "goal.csv"), arm)


def replayed(columns: dict[str, np.ndarray], arm: Robot, curve: str, folder: Path) -> Path:
    """A LeRobot data set of the positions, whose statement says how they are replayed."""
    path = folder / f"data_set_{curve}_{len(list(folder.iterdir()))}"
    path.mkdir()
    names = {"action": [f"{joint}.pos" for joint in arm.joint_names]}
    data = {
        "action": np.column_stack([columns[f"q.{joint}"] for joint in arm.joint_names]).astype(np.float32)
    }
    fps = round(1.0 / STEP_S)
    write_data_set(data, names, path, fps=fps, robot=arm.name, task="replay")
    (path / STATEMENT).write_text(json.dumps({"curve": curve}))
    return path


@pytest.mark.parametrize("form", ["table", "data set"])
def test_actions_that_are_held_jump_and_lines_where_they_are_stated_do_not(
    arm: Robot, tmp_path: Path, form: str
) -> None:
    columns = only(setpoints(arm), "q")

    def load(curve: str) -> Motion:
        if form == "data set":
            return load_motion(replayed(columns, arm, curve, tmp_path), arm)
        path = written(columns, tmp_path / f"{curve}.csv")
        path.write_text(f'# {{"schema": "excite.motion/1", "curve": "{curve}"}}\n{path.read_text()}')
        return load_motion(path, arm)

    wrist = arm.joint_index("wrist_3_joint")
    held, q = load("hold"), columns["q.wrist_3_joint"]
    # Away from the last cycle of each row and from the corner after it, by a loop of its own.
    for time, value in zip(held.time, held.q[:, wrist], strict=True):
        row = int(time / STEP_S + 1e-9)
        if 0.0026 < (time + 1e-9) % STEP_S < STEP_S - 0.0051:
            assert value == pytest.approx(q[row], abs=1e-6)
    assert np.abs(held.v[:, wrist]).max() == pytest.approx(np.abs(np.diff(q)).max() / 0.005, rel=1e-4)
    assert {"joint_velocity", "joint_acceleration"} <= kinds(arm, held) and "rate_too_low" not in kinds(
        arm, held
    )
    lines = load("linear")
    assert np.abs(lines.v).max() == pytest.approx(np.abs(np.diff(q)).max() / STEP_S, rel=1e-4)
    # Steps far below an encoder's are within the limit of jerk.
    columns["q.wrist_3_joint"] = arm.rest[wrist] + 1e-5 * (q - arm.rest[wrist])
    assert not kinds(arm, load("hold"))


def blended(arm: Robot, folder: Path, time: np.ndarray, wrist: np.ndarray, said: str) -> Path:
    """Way points of the last wrist joint alone, in a table that states a curve with blends."""
    names = {joint: index for index, joint in enumerate(arm.joint_names)}
    columns = {f"q.{name}": np.full(len(time), arm.rest[i]) for name, i in names.items()}
    columns["q.wrist_3_joint"] = columns["q.wrist_3_joint"] + wrist
    path = written({"time": time, **columns}, folder / "way.csv")
    path.write_text(f'# {{"schema": "excite.motion/1", "curve": "blend"{said}}}\n{path.read_text()}')
    return path


def test_way_points_that_are_passed_with_a_blend(arm: Robot, tmp_path: Path) -> None:
    """Against the acceleration that its definition gives, integrated twice on a fine grid."""
    time, way, width = np.array([0.0, 1.0, 2.5, 3.5]), np.array([0.0, 0.2, -0.1, 0.1]), 0.3
    motion = load_motion(blended(arm, tmp_path, time, way, f', "blend_s": {width}'), arm)
    speed = np.diff(way) / (np.diff(time) - [0.15, 0.0, 0.15])
    fine = np.linspace(0.0, 3.5, 350001)
    turns = zip((0.15, 1.0, 2.5, 3.35), np.diff(np.r_[0.0, speed, 0.0]), strict=True)
    v = sum(turn * np.clip((fine - middle) / width + 0.5, 0.0, 1.0) for middle, turn in turns)
    q = np.r_[0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(fine))]
    wrist = arm.joint_index("wrist_3_joint")
    assert motion.v[:, wrist] == pytest.approx(np.interp(motion.time, fine, v), abs=1e-6)
    assert motion.q[:, wrist] - arm.rest[wrist] == pytest.approx(np.interp(motion.time, fine, q), abs=1e-6)
    assert motion.q[-1, wrist] - arm.rest[wrist] == pytest.approx(0.1)
    assert not kinds(arm, motion) & {
        "starts_moving",
        "ends_moving",
        "rate_too_low",
        "velocity_not_derivative",
    }
    # So softly that no limit of jerk is met, and the same as lines, which turn within a cycle.
    soft = load_motion(blended(arm, tmp_path, time, 0.1 * way, f', "blend_s": {width}'), arm)
    assert not kinds(arm, soft)
    path = blended(arm, tmp_path, time, way, "")
    path.write_text(path.read_text().replace("blend", "linear"))
    assert "joint_jerk" in kinds(arm, load_motion(path, arm))


@pytest.mark.parametrize(
    ("said", "what"), [("", "is missing"), (', "blend_s": 0.9', "is 0.9 s, and setpoints")]
)
def test_blends_that_do_not_fit_are_refused(arm: Robot, tmp_path: Path, said: str, what: str) -> None:
    path = blended(arm, tmp_path, np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.1, 0.0]), said)
    with pytest.raises(MotionError, match=f"blend_s: {what}"):
        load_motion(path, arm)


def test_a_curve_that_is_none_is_refused(arm: Robot, tmp_path: Path) -> None:
    path = written(only(setpoints(arm), "q"), tmp_path / "goal.csv")
    path.write_text(f'# {{"schema": "excite.motion/1", "curve": "wavy"}}\n{path.read_text()}')
    with pytest.raises(MotionError, match="curve"):
        load_motion(path, arm)


def test_rows_too_far_apart_are_told_how_to_state_the_curve(tmp_path):
    """What is advised, put above the rows, has them judged as the lines that they are."""
    robot = excite.load_robot("ur10")
    rows = "\n".join(
        ",".join([f"{0.1 * k:g}", *(f"{q + 1e-4 * k:.6f}" for q in robot.rest)]) for k in range(20)
    )
    text = f"time,{','.join(f'q.{joint}' for joint in robot.joint_names)}\n{rows}\n"
    (tmp_path / "a.csv").write_text(text)
    said = excite.check(robot, [tmp_path / "a.csv"]).summary()
    assert "rate_too_low" in said
    advised = next(part for part in said.splitlines() if "# {" in part)
    line = advised[advised.index("# {") : advised.index("}") + 1]
    (tmp_path / "b.csv").write_text(f"{line}\n{text}")
    assert "rate_too_low" not in excite.check(robot, [tmp_path / "b.csv"]).summary()
