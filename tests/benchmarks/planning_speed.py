"""Generating, filtering and ranking candidates: seconds and memory, against their number and the joints'.

The figure ``docs/images/planning_work.png`` is drawn from what is measured.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.atomic import atomic_path
from excite.report.theme import IDENTIFIED, MUTED, NOMINAL, draw_figure, to_png
from tests.benchmarks.table import Row
from tests.benchmarks.tree_memory import TreeMemory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

IMAGE = Path(__file__).resolve().parents[2] / "docs" / "images" / "planning_work.png"

# Each size in a process of its own, from the start of Python on. Workers that wait for more work are ended before
# their processor time is asked for: RUSAGE_CHILDREN holds that of processes that are no more.
_SCRIPT = """
import json, os, resource, sys, time
started = time.perf_counter()
import numpy as np
from excite.robot.loading import load_robot

name, count, whole = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "plan"
robot = load_robot(name)
if whole:
    from excite.campaign.plan import plan
    made = plan(robot, n_candidates=count, seed=1, jobs=2)
    made.to_json()
    accepted, repairs = len(made.accepted), 0.0
else:
    from excite.temporary_folder import TemporaryFolder
    from excite.campaign.pool import Keeper, Pool, ranked_segments
    from excite.motion.generators.mixture import plan_candidates
    from excite.safety.filter import filter_candidates
    folder = TemporaryFolder()
    candidates = plan_candidates(robot, count, np.random.SeedSequence(1))
    report = filter_candidates(robot, candidates, jobs=2, keep=Keeper(folder.path))
    Pool(report.kept, folder, ranked_segments(robot)).ranking
    accepted, repairs = len(report.kept), report.seconds
from excite.parallel.engine import _IDLE, _kill_workers
_kill_workers(_IDLE.pop(os.getpid(), None))
used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print(json.dumps({
    "wall": time.perf_counter() - started,
    "cpu": sum(u.ru_utime + u.ru_stime for u in used),
    "accepted": accepted,
    "repairs": repairs,
}))
"""
_SIZES = (30, 100, 300, 1000)
# One size of every robot, by its number of joints.
_JOINTS = {"ur10": 6, "panda": 7, "g1": 29, "hrp2like": 30, "talos": 32}
_COUNT = 60


@dataclass(frozen=True)
class Work:
    """What a number of candidates took, all processes together.

    Attributes:
        wall: seconds on the clock, imports included.
        cpu: seconds of processor time.
        accepted: candidates that were.
        repairs: seconds of processor time that repairs and checks took, without what starts a process.
        memory: peak [GB], shared pages counted once.
        resident: peak [GB], shared pages counted in every process.
    """

    wall: float
    cpu: float
    accepted: int
    repairs: float
    memory: float
    resident: float


def rows() -> list[Row]:
    """G1 at several sizes, a whole plan of it, other robots at one size."""
    g1 = {count: _measure("g1", count) for count in _SIZES}
    plan = _measure("g1", 300, "plan")
    joints = {name: _measure(name, _COUNT) for name in _JOINTS}
    exponent, start, each = _growth(g1)
    _draw(g1, joints, start, each)
    return [
        Row.at_most("G1: 300 candidates generated, filtered and ranked, two cores", g1[300].wall, 60.0, "s"),
        Row("… processor time", "", f"{g1[300].cpu:.0f} s", None),
        Row.at_least("… of which accepted", g1[300].accepted, 270),
        Row.at_most("… memory, three processes together", g1[300].memory, 1.5, "GB"),
        Row.at_most("… of the whole plan, rehearsal and prediction included", plan.memory, 1.5, "GB"),
        Row.holds(
            "… memory (pages counted in every process that maps them)",
            "flat",
            ", ".join(f"{n}: {w.memory:.2f} ({w.resident:.2f}) GB" for n, w in g1.items()),
            g1[1000].memory < 1.15 * g1[30].memory,
        ),
        Row.holds(
            "… processor time against candidates",
            "linear",
            ", ".join(f"{n}: {w.cpu:.0f} s" for n, w in g1.items())
            + f"; {start:.0f} s to start, then exponent {exponent:.2f}",
            abs(exponent - 1.0) < 0.1,
        ),
        *(
            Row(
                f"{name}, {count} joints: processor time of repairs and checks, each of {_COUNT} candidates",
                "",
                f"{1e3 * joints[name].repairs / _COUNT:.0f} ms, {joints[name].accepted} accepted",
                None,
            )
            for name, count in _JOINTS.items()
        ),
    ]


def _measure(robot: str, count: int, what: str = "rank") -> Work:
    command = [sys.executable, "-c", _SCRIPT, robot, str(count), what]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        memory = TreeMemory(process)
        printed = process.communicate()[0]
        memory.join()
    found = json.loads(printed.splitlines()[-1])
    return Work(**found, memory=memory.peak_gb, resident=memory.rss_gb)


def _growth(sizes: dict[int, Work]) -> tuple[float, float, float]:
    """Exponent of the work beyond the start, the start itself [s], and seconds for each candidate.

    The start is what a straight line through the two smallest sizes leaves at none.
    """
    counts, cpu = np.array(list(sizes)), np.array([work.cpu for work in sizes.values()])
    each = (cpu[1] - cpu[0]) / (counts[1] - counts[0])
    start = float(cpu[0] - each * counts[0])
    exponent = np.polyfit(np.log(counts), np.log(cpu - start), 1)[0]
    return float(exponent), start, float(each)


def _draw(g1: dict[int, Work], joints: dict[str, Work], start: float, each: float) -> None:
    def paint(figure: Figure) -> None:
        left, middle, right = figure.subplots(1, 3)
        counts = np.array(list(g1))
        left.loglog(counts, start + each * counts, color=MUTED.light, linestyle="--", label="straight line")
        left.loglog(counts, [w.cpu for w in g1.values()], "o", color=IDENTIFIED.light, label="G1")
        left.set(title="Processor time [s]", xlabel="candidates")
        left.legend()
        middle.semilogx(counts, [w.memory for w in g1.values()], "o-", color=IDENTIFIED.light)
        middle.axhline(1.5, color=NOMINAL.light, linestyle="--")
        middle.set(title="Memory, three processes [GB]", xlabel="candidates", ylim=(0.0, 1.7))
        for axes in (left, middle):
            axes.set_xticks(counts, counts)
            axes.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
        for name, work in joints.items():
            each_ms = 1e3 * work.repairs / _COUNT
            right.plot(_JOINTS[name], each_ms, "o", color=IDENTIFIED.light)
            # Names on the side where there is room.
            side = 1 if _JOINTS[name] < 20 else -1
            right.annotate(
                name,
                (_JOINTS[name], each_ms),
                (7 * side, -4),
                textcoords="offset points",
                ha="left" if side > 0 else "right",
            )
        right.set(title="Repairs and checks of each [ms]", xlabel="joints", xlim=(0, 38))
        right.set_ylim(0.0, 1.25e3 * max(work.repairs for work in joints.values()) / _COUNT)

    with atomic_path(IMAGE) as temporary:
        temporary.write_bytes(to_png(draw_figure(paint, 2.6), dpi=100))
