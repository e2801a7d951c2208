"""Make the motion library anew: ``python docs/make_motion_library.py [--judge] [ROBOT …]``.

For each robot, as ``excite plan --select rsd`` does: candidates of a fixed seed, filtered; those that together leave
the least RSD within a total duration, rehearsed in simulation. In between the motions are written coarsely, read back,
and judged by the independent check as they were read; what the written file no longer passes is left out. The verdict
travels in the file.

``--judge`` leaves the motions as they are and judges them anew, for a robot whose description has changed or a check
that has. What is beyond the jerk limit alone runs that much slower; a set of which a motion still does not pass has to
be made anew.
"""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

import excite
from excite.atomic import atomic_path
from excite.excitation.conditioning import compute_conditioning, motion_factor
from excite.excitation.precision import nominal_values, row_noise
from excite.excitation.selection import NEGLIGIBLE, TotalDeviation, candidate_information, greedy_choice
from excite.formats.documents import read_json
from excite.motion.content import with_verdict
from excite.motion.files import load_motion, save_motion
from excite.motion.generators.mixture import plan_candidates
from excite.motion.motion import Motion, jerk_peaks
from excite.regressor.base_parameters import structural_base_parameters
from excite.report.plots.postures import choose_motions, draw_snapshots
from excite.report.theme import to_png
from excite.results import write_json
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.filter import filter_candidates
from excite.safety.repairs.rows import Shares
from excite.safety.verdict import CheckReport, Verdict
from excite.simulation.rehearsal import rehearse_motions

LIBRARY = Path(__file__).resolve().parents[1] / "motion_library"
SEED = 1
LARGEST_PICTURE = 60_000


@dataclass(frozen=True)
class Recipe:
    """How a robot's set is made.

    Attributes:
        candidates: number of candidates.
        budget_s: total duration at most [s].
        rate_hz: samples per second of the files, between which motions are interpolated.
        without: generators whose motions are left out.
    """

    candidates: int
    budget_s: float
    rate_hz: float
    without: tuple[str, ...] = ()


RECIPES = {
    "ur10": Recipe(40, 60.0, 30.0),
    "panda": Recipe(40, 60.0, 30.0),
    "iiwa14": Recipe(40, 60.0, 30.0),
    "jaco2": Recipe(40, 110.0, 30.0),
    "g1": Recipe(60, 55.0, 25.0),
    "hrp2like": Recipe(60, 55.0, 25.0),
    "talos": Recipe(60, 55.0, 25.0),
    "so101": Recipe(24, 60.0, 30.0),
    "go2": Recipe(24, 55.0, 30.0),
    "g1_no_ft": Recipe(24, 55.0, 25.0),
    "g1_suspended": Recipe(24, 60.0, 25.0),
}


def make(name: str, recipe: Recipe) -> str:
    """Make one robot's set; returns a line about it."""
    robot = excite.load_robot(name)
    candidates = plan_candidates(robot, recipe.candidates, np.random.SeedSequence(SEED))
    candidates = [candidate for candidate in candidates if candidate.generator not in recipe.without]
    folder = LIBRARY / name
    shutil.rmtree(folder, ignore_errors=True)
    accepted = filter_candidates(robot, candidates).motions
    read_back = [_written(robot, motion, folder, recipe.rate_hz) for motion in accepted]
    written = [motion for motion in read_back if motion is not None]
    base = structural_base_parameters(robot)
    factors = [motion_factor(robot, motion) for motion in written]
    durations = np.array([motion.duration for motion in written])
    noise = row_noise(robot)
    known = candidate_information([motion_factor(robot, motion, row_std=noise) for motion in written], base)
    criterion = TotalDeviation(known.back, np.maximum(np.abs(nominal_values(robot, base)), NEGLIGIBLE))
    fallen = np.zeros(len(written), dtype=bool)
    stood: set[int] = set()
    while True:
        # What fell costs more than there is.
        price = np.where(fallen, 2.0 * recipe.budget_s, durations)
        chosen = greedy_choice(known, criterion, price, recipe.budget_s)
        new = [i for i in chosen if i not in stood]
        if not new:
            break
        for i, refused in zip(new, rehearse_motions(robot, [written[i] for i in new]), strict=True):
            if refused is None:
                stood.add(i)
            else:
                fallen[i] = True
    motions = [written[i] for i in chosen]
    for motion in written:
        if motion not in motions:
            (folder / "motions" / f"{motion.name}.parquet").unlink()
    found = compute_conditioning(robot, [factors[i] for i in chosen], base)
    write_json(excite.check(robot, motions).to_json(), folder / "check.json")
    write_json(
        {
            "schema": "excite.motion_set/1",
            "robot": name,
            "motions": [
                {
                    "motion": f"motions/{motion.name}.parquet",
                    "generator": motion.metadata.generator,
                    "duration_s": motion.duration,
                }
                for motion in motions
            ],
            "conditioning": dict(found.to_json()),
            "candidates": recipe.candidates,
            "seed": SEED,
            "without": list(recipe.without),
        },
        folder / "conditioning.json",
    )
    _draw(robot, motions, folder / "motions.png")
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    seconds = sum(motion.duration for motion in motions)
    return f"{name}: {len(motions)} motions, {seconds:.0f} s, {size / 1e3:.0f} kB; {found.summary()}"


def _written(robot: Robot, motion: Motion, folder: Path, rate_hz: float) -> Motion | None:
    """Write a motion as the library holds it and read it back; None, and no file, if that is not safe."""
    path = folder / "motions" / f"{motion.name}.parquet"
    save_motion(motion.resampled(robot, rate_hz), path, single=True)
    if _judged(robot, path) is None:
        path.unlink()
        return None
    return load_motion(path, robot)


def _judged(robot: Robot, path: Path) -> Verdict | None:
    """Judge a file and write the verdict into it; None, and the file as it was, if it is not safe."""
    found = load_motion(path, robot)
    motion = replace(found, metadata=replace(found.metadata, robot_hash=robot.hash, verdict=None))
    verdict = check_motion(robot, motion)
    if not verdict.safe:
        return None
    sealed = with_verdict(motion, verdict.to_json(), robot.hash)
    again = load_motion(save_motion(sealed, path, single=True), robot)
    if again.metadata.verdict != sealed.metadata.verdict:
        raise SystemExit(f"{path} does not hold what was judged")
    return verdict


def _slower(robot: Robot, path: Path) -> Verdict | None:
    """Run a motion whose only fault is its jerk as much slower as the limit asks, and judge that."""
    motion = load_motion(path, robot)
    found = check_motion(robot, motion).violations
    if {one.kind for one in found} != {"joint_jerk"}:
        return None
    peaks = jerk_peaks(
        motion.time, motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations()
    )
    k = float((peaks / (Shares().jerk * robot.limits.jerk)).max()) ** (1.0 / 3.0)
    slower = replace(motion, time=k * motion.time, v=motion.v / k, a=motion.a / k**2)
    save_motion(slower, path, single=True)
    return _judged(robot, path) if rehearse_motions(robot, [load_motion(path, robot)]) == (None,) else None


def judge(name: str) -> str:
    """Judge one robot's set anew; returns a line about it."""
    robot, folder = excite.load_robot(name), LIBRARY / name
    verdicts, document = [], read_json(folder / "conditioning.json")
    for entry in document["motions"]:
        verdict = _judged(robot, folder / entry["motion"]) or _slower(robot, folder / entry["motion"])
        if verdict is None:
            raise SystemExit(f"{entry['motion']} is no longer safe: make the set of {name} anew")
        verdicts.append(verdict)
    motions = [load_motion(folder / entry["motion"], robot) for entry in document["motions"]]
    durations = [motion.duration for motion in motions]
    if durations != [entry["duration_s"] for entry in document["motions"]]:
        factors = [motion_factor(robot, motion) for motion in motions]
        found = compute_conditioning(robot, factors, structural_base_parameters(robot))
        document["conditioning"] = dict(found.to_json())
        for entry, duration in zip(document["motions"], durations, strict=True):
            entry["duration_s"] = duration
        write_json(document, folder / "conditioning.json")
    write_json(CheckReport(tuple(verdicts)).to_json(), folder / "check.json")
    return f"{name}: {len(verdicts)} motions, all safe"


def _draw(robot: Robot, motions: list[Motion], path: Path) -> None:
    """The picture, as fine as its size allows."""
    sketch = draw_snapshots(robot, choose_motions(motions, 3))
    for dpi in range(110, 40, -10):
        drawn = Image.open(BytesIO(to_png(sketch, dpi))).convert("RGB")
        stream = BytesIO()
        drawn.quantize(64).save(stream, format="png", optimize=True)
        if stream.tell() <= LARGEST_PICTURE:
            break
    with atomic_path(path) as temporary:
        temporary.write_bytes(stream.getvalue())


def main() -> None:
    """Make the sets that are named, or all of them; with ``--judge``, judge them."""
    arguments = sys.argv[1:]
    work = judge if "--judge" in arguments else lambda name: make(name, RECIPES[name])
    names = [argument for argument in arguments if argument != "--judge"] or list(RECIPES)
    unknown = [name for name in names if name not in RECIPES]
    if unknown:
        raise SystemExit(f"no recipe for {unknown[0]!r}; choose from {', '.join(RECIPES)}")
    for name in names:
        sys.stdout.write(work(name) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
