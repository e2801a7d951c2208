"""Generating, filtering and ranking candidates: seconds for 300 of a humanoid, and how the work grows."""

from __future__ import annotations

import json
import subprocess
import sys

from tests.benchmarks.table import Row

# Each size in a process of its own, so that the peak memory is that of this size.
_SCRIPT = """
import json, resource, sys, time
import numpy as np
from excite.excitation.conditioning import motion_factor
from excite.excitation.ranking import rank
from excite.motion.generators.registry import plan_candidates
from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.loading import load_robot
from excite.safety.filter import filter_candidates

name, count = sys.argv[1], int(sys.argv[2])
robot = load_robot(name)
base = structural_base_parameters(robot)
filter_candidates(robot, plan_candidates(robot, 2, np.random.SeedSequence(0)), jobs=2)
started = time.perf_counter()
report = filter_candidates(robot, plan_candidates(robot, count, np.random.SeedSequence(1)), jobs=2)
filtered = time.perf_counter()
rank(robot, [motion_factor(robot, motion) for motion in report.motions], base)
ended = time.perf_counter()
peaks = [resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(json.dumps({
    "seconds": ended - started,
    "rank": ended - filtered,
    "accepted": len(report.motions),
    "memory": (peaks[0] + 2 * peaks[1]) / 2**20,
}))
"""
_SIZES = (30, 100, 300)
_ROBOTS = (("ur10", 6), ("panda", 7), ("talos", 32), ("hrp2like", 30))


def rows() -> list[Row]:
    """G1 at several sizes, other robots at one."""
    measured = {count: _measure("g1", count) for count in _SIZES}
    largest = measured[_SIZES[-1]]
    each = ", ".join(f"{count}: {1e3 * found['seconds'] / count:.0f} ms" for count, found in measured.items())
    memory = ", ".join(f"{count}: {found['memory']:.2f} GB" for count, found in measured.items())
    growth = (largest["seconds"] / 300.0) / (measured[100]["seconds"] / 100.0)
    found = [
        Row.at_most(
            "G1: 300 candidates generated, filtered and ranked, two cores", largest["seconds"], 60.0, "s"
        ),
        Row.at_least("… of which accepted", largest["accepted"], 270),
        Row.at_most("… memory, three processes together", largest["memory"], 1.5, "GB"),
        Row.holds("… time for each of 30, 100, 300 candidates", "linear", each, growth < 1.15),
        Row("… memory", "flat", memory, largest["memory"] < 1.3 * measured[30]["memory"]),
    ]
    for name, joints in _ROBOTS:
        one = _measure(name, 60)
        found.append(
            Row(
                f"{name}, {joints} joints: time for each of 60 candidates",
                "",
                f"{1e3 * one['seconds'] / 60:.0f} ms, {one['accepted']:.0f} accepted",
                None,
            )
        )
    return found


def _measure(robot: str, count: int) -> dict[str, float]:
    command = [sys.executable, "-c", _SCRIPT, robot, str(count)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])
