"""Every robot file of installed wheels, from the file to checked motions with no edit.

``python tests/benchmarks/foreign_robots.py [WORD…] [--under FOLDER…]`` prints for each file (whose path contains one of
the words) seconds and safe motions, or the line that it ended with.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from excite.robot.catalogue import example_robot_data

SECONDS = 180


def model_files(folders: list[Path], words: list[str]) -> list[Path]:
    """URDF files, and MJCF files named as robots, below the folders."""
    found = [path for folder in folders for path in sorted(folder.rglob("*.urdf"))]
    found += [path for folder in folders for path in sorted(folder.rglob("robot.xml"))]
    found += [path for folder in folders for path in sorted(folder.rglob("humanoid.xml"))]
    return [path for path in found if not words or any(word in str(path) for word in words)]


def attempt(path: Path, candidates: int) -> str:
    """One line on what became of a robot."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "excite", "plan", str(path), "--out", folder]
        start = time.perf_counter()
        try:
            done = subprocess.run(
                [*command, "--candidates", str(candidates)], capture_output=True, text=True, timeout=SECONDS
            )
        except subprocess.TimeoutExpired:
            return f"{time.perf_counter() - start:5.0f} s  did not end"
        seconds = time.perf_counter() - start
        plan = Path(folder) / "plan.json"
        if done.returncode == 0 and plan.exists():
            return f"{seconds:5.0f} s  {len(json.loads(plan.read_text())['selected'])} motions"
        lines = done.stderr.strip().splitlines()
        return f"{seconds:5.0f} s  {lines[-1] if lines else 'no word'}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--under", type=Path, action="append", default=None)
    parser.add_argument("--candidates", type=int, default=40)
    asked = parser.parse_args()
    for path in model_files(asked.under or [example_robot_data()], asked.words):
        print(f"{'/'.join(path.parts[-3:]):60s} {attempt(path, asked.candidates)}", flush=True)


if __name__ == "__main__":
    main()
