"""``excite check``: the page of what it writes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import excite
from excite.cli.main import app
from excite.motion.files import save_motion
from excite.report.page import report
from tests.safety.motions import RATE_HZ, joint_motion, smooth
from tests.safety.test_units import LIFT, LINK


def test_motions_of_a_bare_model_move_on_the_page_of_their_check(tmp_path: Path) -> None:
    """A URDF without any geometry, its motions elsewhere: one safe, one beyond its limits, one of few samples."""
    model = tmp_path / "lifter.urdf"
    model.write_text(LIFT.format(links="".join(LINK.format(name=name) for name in ("base", "car", "arm"))))
    robot = excite.load_robot(model)
    time = np.arange(0.0, 8.0, 1.0 / RATE_HZ)
    there = smooth(time / 3.5) - smooth((time - 3.6) / 3.5)
    motions = tmp_path / "somewhere" / "motions"
    motions.mkdir(parents=True)
    for name, size in (("safe", 0.2), ("far", 0.5), ("slow", 0.2)):
        every = 20 if name == "slow" else 1
        joints = np.column_stack([0.3 + size * there, size * there])
        motion = joint_motion(robot, time[::every], joints[::every]).renamed(name)
        save_motion(motion, motions / f"{name}.csv")
    out = tmp_path / "out"
    found = CliRunner().invoke(app, ["check", str(model), str(motions), "--out", str(out)])
    assert found.exit_code == 1 and (out / "check.json").exists(), found.exception
    files = [entry["file"] for entry in json.loads((out / "check.json").read_text())["motions"]]
    assert files == [f"../somewhere/motions/{name}.csv" for name in ("far", "safe", "slow")]
    page = report(out).read_text(encoding="utf-8")
    assert "pictures of the robot" not in page
    section = page[page.index('<section id="motions">') :].partition("</section>")[0]
    assert 'class="moving replay"' in section
    assert all(f"{name} · " in section for name in ("far", "safe", "slow"))
    shutil.rmtree(motions)
    gone = report(out).read_text(encoding="utf-8")
    assert 'id="motions"' not in gone and "pictures of motion ../somewhere/motions/far.csv" in gone
