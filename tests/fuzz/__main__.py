"""``make fuzz``: damage good files at random for a while, and see that every command ends as it should.

A command that was handed a damaged file may do its work, or end in one line with the exit code that says what kind of
failure it is; anything else is kept with its file, and the exit code here is 1.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from excite.cli.main import _run_command
from excite.motion.collection import library_folder
from excite.motion.files import load_motion, save_motion
from excite.robot.loading import load_robot
from tests.corpus import arm, practice
from tests.documents import small
from tests.robot.small import ARM

KEPT = Path("out/fuzz")
_CODES = {0, 1, 2, 3, 4}
_LONGEST_S = 60.0
# What people and programs get wrong in text: numbers that are none or too large, other kinds, nothing, too much.
_TOKENS = (
    b"nan",
    b"-inf",
    b"1e300",
    b"-1",
    b"0",
    b"",
    b"null",
    b"[]",
    b"{}",
    b"true",
    b'"',
    b"<",
    b">",
    b"\0",
    b"\xff",
    b"9" * 400,
)


def _motion(suffix: str) -> Callable[[Path], tuple[Path, list[str]]]:
    def build(folder: Path) -> tuple[Path, list[str]]:
        robot = load_robot("ur10")
        ready = library_folder("ur10") / "motions" / "random_joint_001.parquet"
        path = save_motion(load_motion(ready, robot), folder / f"motion{suffix}")
        return path, ["export", str(path), "--format", "csv", "--out", str(folder / "out")]

    return build


def _description(folder: Path) -> tuple[Path, list[str]]:
    return folder / "robot.yaml", arm.check_robot(folder)


def _urdf(folder: Path) -> tuple[Path, list[str]]:
    arm.init_robot(folder, ARM)
    return folder / "arm.urdf", ["init-robot", str(folder / "arm.urdf"), "--out", str(folder / "out")]


def _mjcf(folder: Path) -> tuple[Path, list[str]]:
    arm.init_robot(folder, arm.MJCF, "arm.xml")
    return folder / "arm.xml", ["init-robot", str(folder / "arm.xml"), "--out", str(folder / "out")]


def _header(folder: Path) -> tuple[Path, list[str]]:
    return folder / "log.yaml", practice.write_log(folder)


def _trial(suffix: str) -> Callable[[Path], tuple[Path, list[str]]]:
    def build(folder: Path) -> tuple[Path, list[str]]:
        return practice.first_trial(folder, suffix), practice.arguments(folder)

    return build


def _document(folder: Path) -> tuple[Path, list[str]]:
    path = folder / "plan.json"
    path.write_text(json.dumps(small.PLAN, indent=1))
    return path, ["report", str(folder)]


def _c3d(folder: Path) -> tuple[Path, list[str]]:
    path = practice.c3d(folder)
    return path, practice.person(path)


SOURCES: dict[str, Callable[[Path], tuple[Path, list[str]]]] = {
    "robot.yaml": _description,
    "urdf": _urdf,
    "mjcf": _mjcf,
    "motion parquet": _motion(".parquet"),
    "motion csv": _motion(".csv"),
    "motion npz": _motion(".npz"),
    "log.yaml": _header,
    "trial csv": _trial(".csv"),
    "trial parquet": _trial(".parquet"),
    "trial npz": _trial(".npz"),
    "trial hdf5": _trial(".h5"),
    "document": _document,
    "c3d": _c3d,
}


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """A file's content with one to four things wrong."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(data))) if data else 0
        length = int(rng.integers(1, 64))
        way = int(rng.integers(6))
        if way == 0 and data:
            data[at] ^= 1 << int(rng.integers(8))
        elif way == 1:
            del data[at : at + length]
        elif way == 2:
            data[at : at + length] = bytes(min(length, len(data) - at))
        elif way == 3:
            data[at:at] = data[max(0, at - length) : at] * int(rng.integers(1, 20))
        elif way == 4:
            token = _TOKENS[int(rng.integers(len(_TOKENS)))]
            end = next(
                (k for k in range(at, min(at + 64, len(data))) if data[k : k + 1] in b' ,\n:]}"<>/='), at
            )
            data[at:end] = token
        elif rng.integers(4) == 0:
            del data[at:]
    return bytes(data)


def complaint(arguments: list[str]) -> str | None:
    """What is wrong with the end of a command; None where nothing is."""
    said, started = io.StringIO(), time.monotonic()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        code = _run_command(arguments)
    lines, seconds = said.getvalue().splitlines(), time.monotonic() - started
    if code not in _CODES:
        return f"exit code {code}: {' '.join(lines)[:300]}"
    if code in {2, 4} and (len(lines) != 1 or not lines[0].startswith("excite: ")):
        return f"{len(lines)} lines: {' '.join(lines)[:300]}"
    return f"{seconds:.0f} s" if seconds > _LONGEST_S else None


def main() -> int:
    """Damage files until the time is up."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=SOURCES, action="append")
    options = parser.parse_args()
    rng, tried, wrong = np.random.default_rng(options.seed), Counter[str](), 0
    kinds = options.only or list(SOURCES)
    until = time.monotonic() + options.seconds
    while time.monotonic() < until:
        kind = kinds[sum(tried.values()) % len(kinds)]
        with tempfile.TemporaryDirectory(prefix="fuzz_") as name:
            path, arguments = SOURCES[kind](Path(name))
            path.write_bytes(damaged(path.read_bytes(), rng))
            tried[kind] += 1
            found = complaint(arguments)
            if found is not None:
                wrong += 1
                kept = KEPT / f"{kind.replace(' ', '_')}_{options.seed}_{sum(tried.values())}{path.suffix}"
                kept.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, kept)
                print(f"{kept}: {found}", flush=True)
    print(", ".join(f"{count} {kind}" for kind, count in tried.items()))
    print(f"{sum(tried.values())} damaged files, {wrong} ended otherwise than in one line")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
