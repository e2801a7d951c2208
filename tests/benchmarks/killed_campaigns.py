"""A campaign that is killed at random moments, and resumed: the same bytes as never killed, nobody and nothing left."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.benchmarks.table import Row

KILLS = 100
_SEED = 20
_ORPHANS_S = 5.0
# Both iterations come to an end: of fewer candidates, or of other seeds, none may be safe in the second.
_CAMPAIGN = (
    "campaign",
    "ur10",
    "--candidates",
    "6",
    "--max-iterations",
    "2",
    "--target-rsd",
    "15",
    "--seed",
    "1",
)
# What says how long the work took, or shows it: of no two runs the same.
_TIMED = {"report.html"}


@dataclass
class _Tally:
    resumed: int = 0
    equal: int = 0
    orphans: int = 0
    left: int = 0
    early: int = 0
    different: set[str] = field(default_factory=set)


def rows() -> list[Row]:
    """What became of :data:`KILLS` campaigns, each killed once at a moment drawn over the time that one takes."""
    tally = measure(KILLS, _SEED)
    different = f" (different: {', '.join(sorted(tally.different)[:3])})" if tally.different else ""
    what = f"campaign killed at {KILLS} random moments"
    return [
        Row.holds(
            f"{what}: resumed to the end", "all", f"{tally.resumed} of {KILLS}", tally.resumed == KILLS
        ),
        Row.holds(
            "… to the same bytes, but for times",
            "all",
            f"{tally.equal} of {KILLS}{different}",
            tally.equal == KILLS,
        ),
        Row.holds("… processes alive 5 s after the kill", "0", str(tally.orphans), tally.orphans == 0),
        Row.holds("… temporary files left after the resumed run", "0", str(tally.left), tally.left == 0),
        Row("… killed before anything was there to resume, and begun anew", "", str(tally.early), None),
    ]


def measure(kills: int, seed: int) -> _Tally:
    """Kill and resume ``kills`` campaigns at moments drawn from ``seed``."""
    rng, tally = np.random.default_rng(seed), _Tally()
    with tempfile.TemporaryDirectory(prefix="killed_campaigns_") as name:
        root = Path(name)
        started = time.perf_counter()
        _run(root, "whole").wait()
        seconds = time.perf_counter() - started
        expected = _digests(root / "whole")
        for number in range(kills):
            moment = float(rng.random())
            # On a busy machine one run takes longer than the next; one that ended by itself was not killed.
            while (took := _one(root, f"kill_{number:03d}", moment * seconds, expected, tally)) is not None:
                seconds = min(seconds, took)
            print(f"{number + 1} killed of {kills}: {tally}", file=sys.stderr, flush=True)
    return tally


def _one(root: Path, folder: str, after_s: float, expected: dict[str, str], tally: _Tally) -> float | None:
    """Kill one run after some time and resume it; how long it took if it ended before [s]."""
    temporary = root / f"tmp_{folder}"
    temporary.mkdir()
    run, started = _run(root, folder, temporary), time.perf_counter()
    try:
        run.wait(after_s)
    except subprocess.TimeoutExpired:
        pass
    else:
        subprocess.run(["rm", "-rf", root / folder, temporary], check=True)
        return time.perf_counter() - started
    run.kill()
    run.wait()
    killed = time.perf_counter()
    while _processes(temporary) and time.perf_counter() - killed < _ORPHANS_S:
        time.sleep(0.1)
    tally.orphans += len(_processes(temporary))
    early = not (root / folder / "journal.json").exists()
    tally.early += early
    code = _run(root, folder, temporary, *(() if early else ("--resume",))).wait()
    tally.resumed += code in {0, 1} and (root / folder / "campaign.json").is_file()
    found = _digests(root / folder)
    different = {name for name in expected.keys() | found.keys() if expected.get(name) != found.get(name)}
    tally.equal += not different
    tally.different |= different
    left = [path for path in (root / folder).rglob(".*")] + [*temporary.iterdir()]
    tally.left += len(left)
    subprocess.run(["rm", "-rf", root / folder, temporary], check=True)
    return None


def _run(root: Path, folder: str, temporary: Path | None = None, *options: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "TMPDIR": str(temporary or root), "KILLED_CAMPAIGN": str(temporary or root)}
    command = [sys.executable, "-m", "excite", *_CAMPAIGN, "--jobs", "2", "--out", folder, *options]
    return subprocess.Popen(
        command, cwd=root, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def _processes(mark: Path) -> list[int]:
    """Processes that were started for one campaign, workers of workers among them: they inherit its environment."""
    wanted, found = f"KILLED_CAMPAIGN={mark}".encode(), []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if wanted in path.read_bytes().split(b"\0") and not _zombie(path.parent):
                found.append(int(path.parent.name))
        except OSError:
            continue
    return found


def _zombie(process: Path) -> bool:
    return process.joinpath("stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file by name, wall times left out."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(_content(path)).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in _TIMED
    }


def _content(path: Path) -> bytes:
    if path.suffix != ".json":
        return path.read_bytes()
    document = json.loads(path.read_text(encoding="utf-8"))
    document.pop("stages", None)
    return re.sub(rb"\s+", b" ", json.dumps(document, sort_keys=True).encode())


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    print(measure(int(sys.argv[1]), int(sys.argv[2])))
