"""Nothing leaves for a controller that the check does not find safe, but for a stated reason that goes with it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.errors import InputError, UnsafeMotionError
from excite.export.export import export_motion, export_motions
from excite.export.registry import EXPORTERS
from excite.motion.collection import library_folder
from excite.motion.files import load_motion, save_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from tests.safety.motions import check_file

pytestmark = pytest.mark.usefixtures("judged_once", "readers_here")


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("ur10")


@pytest.fixture(scope="module")
def safe(arm: Robot) -> Motion:
    return load_motion(library_folder("ur10") / "motions" / "random_joint_015.parquet", arm)


@pytest.fixture(scope="module")
def standing(g1: Robot) -> Motion:
    return load_motion(library_folder("g1") / "motions" / "squat_001.parquet", g1)


def faster(motion: Motion) -> Motion:
    """The same way in half the time."""
    return replace(motion, time=0.5 * motion.time, v=2.0 * motion.v, a=4.0 * motion.a)


def cut(motion: Motion) -> Motion:
    """Without its first quarter: it starts while it moves."""
    n = motion.n_samples // 4
    contacts = {name: flags[n:] for name, flags in motion.contacts.items()}
    return replace(
        motion, time=motion.time[n:], q=motion.q[n:], v=motion.v[n:], a=motion.a[n:], contacts=contacts
    )


def slow(motion: Motion) -> Motion:
    """Every third sample: some nine a second, of which nobody stated the velocities."""
    contacts = {name: flags[::3] for name, flags in motion.contacts.items()}
    q, v, a = (values[::3] for values in (motion.q, motion.v, motion.a))
    return replace(motion, time=motion.time[::3], q=q, v=v, a=a, contacts=contacts, curve="spline")


def gap(motion: Motion) -> Motion:
    """A tenth of a second is missing in the middle."""
    time = motion.time.copy()
    time[len(time) // 2 :] += 0.1
    return replace(motion, time=time)


SPOILT: dict[str, Callable[[Motion], Motion]] = {
    "joint_velocity": lambda motion: faster(faster(motion)),
    "starts_moving": cut,
    "rate_too_low": slow,
    "time_gap": gap,
    "other_robot": lambda motion: replace(motion, robot="ur5"),
    "other_version_of_robot": lambda motion: replace(
        motion, metadata=replace(motion.metadata, robot_hash="00")
    ),
    "changed_since_written": lambda motion: replace(
        motion, metadata=replace(motion.metadata, stated_hash="00")
    ),
    "not_finite": lambda motion: replace(motion, q=np.where(motion.time[:, None] > 1.0, np.nan, motion.q)),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_what_the_check_refuses_does_not_leave_and_nothing_is_written(
    kind: str, safe: Motion, arm: Robot, tmp_path: Path
) -> None:
    spoilt = SPOILT[kind](safe)
    assert kind in {violation.kind for violation in check_motion(arm, spoilt).violations}
    # What is refused does not depend on the format: all of them where numbers are wrong, and where there are none.
    every = kind in {"joint_velocity", "not_finite"}
    for format, exporter in EXPORTERS.items():
        if not runs(format, arm, safe) or not (every or format in {"csv", "ros2"}):
            continue
        for rate in (None, exporter.rates_hz[-1] if exporter.rates_hz else 200.0):
            if kind == "rate_too_low" and rate:
                continue
            with pytest.raises(UnsafeMotionError, match="nothing was written") as caught:
                export_motion(spoilt, arm, format, tmp_path / "motion", rate, settings=examples(format))
            assert caught.value.exit_code == 1 and not caught.value.verdicts[0].safe
    assert not list(tmp_path.iterdir())


def test_a_standing_motion_without_contacts_or_base_does_not_leave(
    standing: Motion, g1: Robot, tmp_path: Path
) -> None:
    with pytest.raises(UnsafeMotionError, match="contact_missing of right_foot"):
        export_motion(
            replace(standing, contacts={"left_foot": standing.contacts["left_foot"]}),
            g1,
            "csv",
            tmp_path / "a",
        )
    lifted = standing.q.copy()
    lifted[:, 2] += 0.05
    with pytest.raises(UnsafeMotionError, match="foot_lifted"):
        export_motion(replace(standing, q=lifted), g1, "csv", tmp_path / "a")
    assert not list(tmp_path.iterdir())


def test_of_several_motions_all_leave_or_none(safe: Motion, arm: Robot, tmp_path: Path) -> None:
    save_motion(safe.renamed("a"), tmp_path / "in" / "a.parquet")
    save_motion(faster(faster(safe)).renamed("b"), tmp_path / "in" / "b.parquet")
    with pytest.raises(UnsafeMotionError, match=r"^b: unsafe, joint_"):
        export_motions([tmp_path / "in"], "csv", out=tmp_path / "out", robot="ur10")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("format", sorted(EXPORTERS))
def test_a_reason_lets_it_out_and_goes_with_it(format: str, safe: Motion, arm: Robot, tmp_path: Path) -> None:
    if not runs(format, arm, safe):
        pytest.skip(f"{format} does not run a {arm.name}")
    spoilt = faster(faster(safe))
    path = export_motion(
        spoilt,
        arm,
        format,
        tmp_path / "m",
        unsafe_anyway="the bench's limits\nare wider",
        settings=examples(format),
    )
    beside = json.loads((tmp_path / f"{path.name}.unsafe.json").read_text())
    (entry,) = beside["motions"]
    assert entry["file"] == path.name and entry["robot"] == "ur10"
    assert entry["verdict"]["unsafe_anyway"] == "the bench's limits\nare wider"
    assert "joint_velocity" in {violation["kind"] for violation in entry["verdict"]["violations"]}
    # The file alone says so too, and is as unsafe as before.
    if format == "npz":
        with np.load(path, allow_pickle=False) as archive:
            assert json.loads(str(archive["verdict"]))["unsafe_anyway"]
    elif format in {"ros2", "mcap"}:
        assert all(
            b"unsafe_anyway" in file.read_bytes() for file in ([path] if path.is_file() else path.iterdir())
        )
    else:
        text = b"".join(file.read_bytes() for file in ([path] if path.is_file() else path.rglob("*.*")))
        assert b"written all the same, the bench's limits are wider" in text and b"joint_velocity" in text
    assert not check_file(arm, path).safe
    with pytest.raises(InputError, match="unsafe_anyway: is blank"):
        export_motion(spoilt, arm, format, tmp_path / "n", unsafe_anyway="  ", settings=examples(format))


def test_a_rate_that_makes_another_motion_of_it_is_refused(arm: Robot, safe: Motion, tmp_path: Path) -> None:
    # A quick shake between two samples of 20 Hz, which all of them miss.
    time = np.arange(0.0, 3.0005, 0.002)
    window = np.exp(-(((time - 1.525) / 0.012) ** 2))
    q = np.tile(arm.rest, (len(time), 1))
    q[:, 5] += 1e-3 * window
    v, a = np.gradient(q, time, axis=0), np.gradient(np.gradient(q, time, axis=0), time, axis=0)
    shake = Motion("shake", arm.name, arm.joint_names, time, q, v, a)
    for rate in (20.0, 25.0):
        with pytest.raises(InputError, match=rf"rate_hz: at {rate:g} Hz the \w+ of wrist_3_joint is off"):
            export_motion(
                shake, arm, "csv", tmp_path / "shake", rate, unsafe_anyway="whatever the check says"
            )
    with pytest.raises(InputError, match="rate_hz: is 19"):
        export_motion(safe, arm, "csv", tmp_path / "safe", 19.0)
    assert not list(tmp_path.iterdir())
    for rate in (25.0, 100.0, 1000.0):
        assert check_file(arm, export_motion(safe, arm, "csv", tmp_path / f"at_{rate:g}", rate)).safe


@pytest.mark.parametrize("format", sorted(EXPORTERS))
@pytest.mark.parametrize("rate", [None, 100.0])
def test_check_reads_what_export_writes(
    format: str, rate: float | None, safe: Motion, arm: Robot, standing: Motion, g1: Robot, tmp_path: Path
) -> None:
    kind = EXPORTERS[format]
    for robot, motion in ((arm, safe), (g1, standing)):
        if not runs(format, robot, motion) or (robot.floating and format in WITHOUT_BASE):
            continue
        asked = rate if not kind.rates_hz or rate is None else kind.rates_hz[-1]
        path = export_motion(motion, robot, format, tmp_path / motion.name, asked, settings=examples(format))
        files = [path] if path.is_file() else [path, *path.glob("*.mcap")]
        for file in files:
            verdict = check_file(robot, file)
            assert verdict.safe, (file, verdict.violations)
        if rate is None and format in EXACT:
            again = load_motion(path, robot)
            np.testing.assert_array_equal(again.q, motion.q)
            np.testing.assert_array_equal(again.a, motion.a)
            np.testing.assert_allclose(again.time, motion.time, atol=1e-9)


# Formats that hold no free base; all numbers of q, v and a as they are.
WITHOUT_BASE = {"openhrp", "unitree", "ros2-yaml", "lerobot", "mujoco-keyframes"}
EXACT = {"csv", "npz", "ros2", "ros2-yaml", "mcap"}


def examples(format: str) -> dict[str, str]:
    """Settings that a format asks for, since nothing is right for every machine."""
    return {setting.name: setting.example for setting in EXPORTERS[format].settings if setting.example}


def runs(format: str, robot: Robot, motion: Motion) -> bool:
    """Whether a controller of the format runs motions of the robot at all."""
    try:
        EXPORTERS[format](robot, examples(format)).refuse(motion)
    except InputError as error:
        assert error.remedy and "\n" not in str(error)
        return False
    return True
