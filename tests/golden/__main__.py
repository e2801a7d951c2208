"""``make golden``: documents of the commands on fixed inputs beside those that were kept.

Each step is a command with ``--json``. Of its document numbers, truth values, keys and lengths are compared, words are
not; numbers to 1e-6 of their size. ``--write`` keeps the documents as they are, ``--only WORD`` runs the steps whose
names hold it, with those that they need. What differs is either a fault, or kept anew with its reason in the commit.
Times, versions and paths are left out.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.motion.collection import library_folder

KEPT = Path(__file__).with_name("documents")
DATA = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
# Fields that hold times, versions or places, and such as may differ from run to run.
_LEFT_OUT = {"seconds", "stages", "made", "versions", "processor_s", "origin", "command"}
_TOLERANCE = 1e-6
# Longer lists of numbers are kept by their length, mean, least and largest.
_LONG = 40
ARMS = ("ur10", "panda", "iiwa14", "jaco2", "so101")
STANDING = ("g1", "talos", "hrp2like", "go2")


@dataclass(frozen=True)
class Step:
    """A command: its name, its words, and the names of the steps that it needs."""

    name: str
    words: tuple[str, ...]
    needs: tuple[str, ...] = ()


def steps() -> list[Step]:
    """All commands; ``{out}`` in them is the folder of their results."""
    found = [Step("robots", ("robots",))]
    for robot in (*ARMS, *STANDING):
        motions = sorted((library_folder(robot) / "motions").glob("*.parquet"))
        few = [str(path) for path in motions[:3]]
        found += [
            Step(f"check {robot}", ("check", robot, *few)),
            Step(f"rank {robot}", ("rank", robot, *few)),
            Step(
                f"plan {robot}",
                ("plan", robot, "--candidates", "4", "--seed", "1", "--out", "{out}/plan_" + robot),
            ),
            Step(f"doctor robot {robot}", ("doctor", robot)),
            Step(
                f"simulate {robot}", ("simulate", robot, *few, "--seed", "3", "--out", "{out}/log_" + robot)
            ),
            Step(f"doctor {robot}", ("doctor", "{out}/log_" + robot), (f"simulate {robot}",)),
            Step(
                f"identify {robot}",
                ("identify", robot, "{out}/log_" + robot, "--out", "{out}/result_" + robot),
                (f"simulate {robot}",),
            ),
        ]
    for robot in ARMS:
        found += [
            Step(f"diagnose {robot}", ("diagnose", "{out}/log_" + robot), (f"simulate {robot}",)),
            Step(
                f"export {robot}",
                (
                    "export",
                    "{out}/plan_" + robot + "/motions",
                    "--format",
                    "csv",
                    "--out",
                    "{out}/sent_" + robot,
                ),
                (f"plan {robot}",),
            ),
            Step(f"capture {robot}", ("capture", robot, "{out}/plan_" + robot), (f"plan {robot}",)),
            Step(
                f"model {robot}",
                ("model", "{out}/result_" + robot, "--format", "mjcf", "--out", "{out}/model_" + robot),
                (f"identify {robot}",),
            ),
        ]
    recordings = {"lwr": "kuka_lwr4_flobaroid", "ar5": "rokae_ar5", "kr300": "kuka_kr300"}
    for name, folder in recordings.items():
        urdf = sorted((DATA / folder).glob("*.urdf")) if DATA.is_dir() else []
        if urdf:
            words = (
                "convert",
                str(DATA / folder),
                "--robot",
                str(urdf[0]),
                "--out",
                "{out}/converted_" + name,
            )
            needs, log = (f"convert {name}",), "{out}/converted_" + name
            found += [
                Step(f"convert {name}", words),
                Step(f"doctor {name}", ("doctor", log), needs),
                Step(
                    f"identify {name}",
                    ("identify", str(urdf[0]), log, "--out", "{out}/result_" + name),
                    needs,
                ),
                Step(f"diagnose {name}", ("diagnose", log), needs),
            ]
    return found


def main() -> int:
    """Run the steps; 1 if one differs from what was kept."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep the documents as they are now")
    parser.add_argument(
        "--only", default="", metavar="WORD", help="steps whose names hold this, and what they need"
    )
    parser.add_argument("--jobs", type=int, default=2, help="commands at a time")
    given = parser.parse_args()
    every = {step.name: step for step in steps()}
    wanted = {name for name in every if given.only in name}
    wanted |= {need for name in wanted for need in _needs(every, name)}
    different = 0
    with tempfile.TemporaryDirectory() as out, ThreadPoolExecutor(given.jobs) as crew:
        done: dict[str, Any] = {}
        # A step waits for those that it needs, which stand before it.
        for name, step in ((n, s) for n, s in every.items() if n in wanted):
            needs = [done[need] for need in step.needs]
            done[name] = crew.submit(_run, step, out, needs)
        for name, future in done.items():
            found, seconds = future.result()
            file = KEPT / f"{name.replace(' ', '_')}.json"
            if given.write:
                KEPT.mkdir(exist_ok=True)
                file.write_text(json.dumps(found, indent=0, ensure_ascii=False, sort_keys=True) + "\n")
                continue
            told = list(differences(json.loads(file.read_text()), found)) if file.is_file() else ["not kept"]
            different += bool(told)
            verdict = "differs" if told else "same"
            print(f"{verdict:8} {name} ({seconds:.1f} s)", *told[:5], sep="\n    ")
    print(f"{len(done)} documents, {different} differ")
    return int(different > 0)


def _needs(every: dict[str, Step], name: str) -> Iterator[str]:
    for need in every[name].needs:
        yield need
        yield from _needs(every, need)


def _run(step: Step, out: str, needs: list[Any]) -> tuple[Any, float]:
    for need in needs:
        need.result()
    started = time.monotonic()
    words = [word.format(out=out) if "{out}" in word else word for word in step.words]
    command = [sys.executable, "-m", "excite", *words, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=out)
    document = json.loads(done.stdout) if done.stdout.strip() else {}
    return {"exit": done.returncode, "document": reduced(document)}, time.monotonic() - started


def reduced(value: Any) -> Any:
    """A document without words, times and places; long lists of numbers by four figures."""
    if isinstance(value, dict):
        return {key: reduced(item) for key, item in value.items() if key not in _LEFT_OUT}
    if isinstance(value, list):
        if len(value) > _LONG and all(isinstance(item, int | float) for item in value):
            mean, ends = sum(value) / len(value), (min(value), max(value))
            return {"length": len(value), "mean": _digits(mean), "ends": [_digits(end) for end in ends]}
        return [reduced(item) for item in value]
    if isinstance(value, float):
        return _digits(value)
    return "" if isinstance(value, str) else value


def _digits(value: float) -> float | None:
    return float(f"{value:.9g}") if math.isfinite(value) else None


def differences(kept: Any, found: Any, at: str = "") -> Iterator[str]:
    """Where two reduced documents differ."""
    if isinstance(kept, dict) and isinstance(found, dict):
        for key in sorted({*kept, *found}):
            if key not in kept or key not in found:
                yield f"{at}.{key}: {'new' if key in found else 'gone'}"
            else:
                yield from differences(kept[key], found[key], f"{at}.{key}")
    elif isinstance(kept, list) and isinstance(found, list) and len(kept) == len(found):
        for i, pair in enumerate(zip(kept, found, strict=True)):
            yield from differences(*pair, f"{at}[{i}]")
    elif isinstance(kept, float | int) and isinstance(found, float | int):
        if abs(kept - found) > _TOLERANCE * max(abs(kept), abs(found), 1e-3):
            yield f"{at}: {kept!r} -> {found!r}"
    elif kept != found:
        yield f"{at}: {str(kept)[:60]} -> {str(found)[:60]}"


if __name__ == "__main__":
    sys.exit(main())
