"""Robots on their feet without force sensors, from plan to identified load, by the commands that a person types.

The robots are MuJoCo's: ``excite simulate`` gives them a load that the model does not have, noise on torques and IMU as
their descriptions state, and withholds it in ``truth.json``, which only this file reads.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from excite.robot.loading import load_robot
from tests.benchmarks.table import Row

_CANDIDATES, _SEED = 24, 1
# Each seed of the simulation puts the load to another place and draws other noise.
_LOADS = {"go2": (3, 4, 5), "g1_no_ft": (3,)}


def rows() -> list[Row]:
    """Plan once for each robot, then simulate and identify each load."""
    found: list[Row] = []
    for name, seeds in _LOADS.items():
        with tempfile.TemporaryDirectory() as folder:
            plan = Path(folder) / "plan"
            _excite("plan", name, "--candidates", str(_CANDIDATES), "--seed", str(_SEED), "--out", str(plan))
            for seed in seeds:
                log, result = Path(folder) / f"log_{seed}", Path(folder) / f"result_{seed}"
                _excite("simulate", name, str(plan), "--seed", str(seed), "--out", str(log))
                _excite("identify", name, str(log), "--out", str(result))
                truth = json.loads((log / "truth.json").read_text())
                found += judged(name, seed, json.loads((result / "identification.json").read_text()), truth)
    return found


def judged(name: str, seed: int, result: dict[str, Any], truth: dict[str, Any]) -> list[Row]:
    """One load against what was identified: masses, places, predictions."""
    robot = load_robot(name)
    links = [segment.link for segment in robot.segments]
    added = {item["link"]: 0.0 for item in truth["added"]}
    for item in truth["added"]:
        added[item["link"]] += item["mass"]
    change = np.reshape(np.array(truth["parameters"]) - robot.nominal_parameters, (-1, 10))
    named = {item["link"]: item for item in result["changed_segments"]}
    mass, centre, outside = 0.0, 0.0, []
    for link in sorted(set(added) & set(named)):
        body, item = change[links.index(link)], named[link]
        mass = max(mass, abs(item["mass_change_kg"] - body[0]) / body[0])
        if item["centre_m"] is None:
            centre = np.inf
            continue
        off = np.array(item["centre_m"]) - body[1:4] / body[0]
        centre = max(centre, float(np.linalg.norm(off)))
        deviations = np.abs([item["mass_change_kg"] - body[0], *off]) / [
            item["std_kg"],
            *item["centre_std_m"],
        ]
        outside += list(deviations > 1.96)
    true_total = sum(truth["masses"].values())
    total = abs(result["total_mass"]["identified"] - true_total) / true_total
    ratios = [fit["rmse"] / fit["reference_rmse"] for fit in result["validation"].values()]
    whole = sum(added.values())
    return [
        Row.holds(
            f"{name}, {whole:.2f} kg hidden, place and noise {seed}: links named as changed",
            ", ".join(sorted(added)),
            ", ".join(sorted(named)) or "none",
            set(named) == set(added),
        ),
        Row.at_most("… mass of each load off by", 100.0 * mass, 5.0, "%"),
        Row.at_most("… centre of each load off by", 100.0 * centre, 2.0, "cm"),
        Row(
            "… masses and coordinates outside their 95 % intervals",
            "",
            f"{sum(outside)} of {len(outside)}",
            None,
        ),
        Row.at_most("… total mass off by", 100.0 * total, 1.0, "%"),
        Row.at_most("… validation residual over the nominal model's, worst joint", max(ratios), 1.0),
    ]


def _excite(*arguments: str) -> None:
    command = [sys.executable, "-m", "excite", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()[-300:]}")
