"""What was planned for a model of one's own is exported without naming the model again."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from excite.export.export import export_motions, robot_beside
from excite.motion.files import save_motion
from excite.robot.bringing import load_robot
from tests.robot.small import ARM
from tests.simulation.motions import standing


def _planned(folder: Path) -> Path:
    """A plan's folder: motions in one, the model's first description in another."""
    (folder / "mine.urdf").write_text(ARM, encoding="utf-8")
    robot = load_robot(folder / "mine.urdf", keep=folder / "plan" / "robot")
    (folder / "plan" / "motions").mkdir()
    save_motion(standing(robot), folder / "plan" / "motions" / "still.parquet")
    return folder / "plan"


def test_the_description_that_a_plan_kept_is_found(tmp_path: Path) -> None:
    plan = _planned(tmp_path)
    (written,) = export_motions([plan / "motions"], "csv", out=tmp_path / "out")
    assert written.is_file()
    motion = plan / "motions" / "still.parquet"
    assert robot_beside(motion, "mine") == str((plan / "robot" / "robot.yaml").resolve())
    assert robot_beside(motion, "another") == "another" and robot_beside(motion, "ur10") == "ur10"


def test_the_next_command_names_a_robot_that_it_finds(tmp_path: Path) -> None:
    plan = _planned(tmp_path)
    command = [
        sys.executable,
        "-m",
        "excite",
        "export",
        str(plan),
        "--format",
        "csv",
        "--out",
        str(tmp_path / "o"),
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert str(plan / "robot" / "robot.yaml") in " ".join(said.split())
