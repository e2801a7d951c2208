"""The main job on the virtual Unitree G1: time, memory, safety, and what the identification is worth."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from excite.campaign.experiment import virtual_robot
from excite.campaign.journal import Journal
from excite.robot.loading import load_robot
from tests.benchmarks.table import Row
from tests.simulation.motions import replay_motion


def rows() -> list[Row]:
    """Run ``excite demo`` as a person would, then look at what it wrote."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "demo"
        started = time.perf_counter()
        command = [sys.executable, "-m", "excite.cli.main", "demo", "--out", str(folder), "--jobs", "2"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - started
        if not (folder / "campaign.json").is_file():
            return [Row.holds("`excite demo` runs", "ends in a report", done.stderr.strip()[-200:], False)]
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
        return [
            Row.at_most("`excite demo`, two cores", seconds, 180.0, "s"),
            Row.at_most("memory of its largest process", memory, 2.0, "GB"),
            *_planning(folder),
            *_identification(folder),
        ]


def _planning(folder: Path) -> list[Row]:
    robot = load_robot("g1")
    plan = json.loads((folder / "iteration_1" / "plan.json").read_text())
    check = json.loads((folder / "check.json").read_text())
    planned = Journal(folder).planned(1, robot)
    if planned is None:
        raise FileNotFoundError(folder / "iteration_1" / "plan.json")
    virtual = virtual_robot(robot, 0)
    motions = (*planned.chosen, *planned.validation)
    upright = sum(
        replay_motion(subject, motion).on_its_feet for subject in (robot, virtual) for motion in motions
    )
    safe = sum(motion["safe"] for motion in check["motions"])
    return [
        Row.at_least("G1: accepted candidates", plan["candidates"]["accepted"], 100),
        Row.holds(
            "G1: motions that pass the independent check",
            "all",
            f"{safe} of {len(check['motions'])}",
            safe == len(check["motions"]),
        ),
        Row.holds(
            "G1: replays in MuJoCo that stay up and touch nothing, nominal and +5 kg",
            "all",
            f"{upright} of {2 * len(motions)}",
            upright == 2 * len(motions),
        ),
    ]


def _identification(folder: Path) -> list[Row]:
    found = json.loads((folder / "identification.json").read_text())
    truth = json.loads((folder / "iteration_1" / "log" / "truth.json").read_text())
    ratios = {axis: fit["rmse"] / fit["reference_rmse"] for axis, fit in found["validation"].items()}
    true_mass = sum(truth["masses"].values())
    error = abs(found["total_mass"]["identified"] - true_mass) / true_mass
    named = {item["link"] for item in found["changed_segments"]}
    added = {item["link"] for item in truth["added"]}
    return [
        Row.at_most(
            "G1 +5 kg: cross-validation RMSE, worst axis, identified / nominal", max(ratios.values()), 1.0
        ),
        Row.at_most("G1 +5 kg: error of the total mass", 100.0 * error, 0.5, "%"),
        Row.holds(
            "G1 +5 kg: segments named as changed",
            ", ".join(sorted(added)),
            ", ".join(sorted(named)) or "none",
            named == added,
        ),
    ]
