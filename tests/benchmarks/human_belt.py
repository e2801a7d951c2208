"""Belts on a virtual subject (Jovic et al., T-RO 2016, section VIII), blind: which segment, how heavy.

The paper's subject of 70 kg and 1.82 m wears a belt in a session after one without; ours is virtual, so the truth is
known. Person, motion, soft tissue, marker and plate noise, the segment (any of the fifteen), the weight (1 to 3 kg)
and where on the segment it sits are drawn, and nothing of it is handed over; the exercise is repeated as people repeat
it, with other timing and range. The paper's own three places are in its reproduction table.
"""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.people.identified import identify_person
from benchmarks.people.worn_weight import AddedMass, locate_added_mass
from benchmarks.virtual_person import (
    Belt,
    VirtualSubject,
    draw_subject,
    perform_exercise,
    record_performance,
    record_standing,
    repeat_exercise,
)
from excite.human.body import segment_box
from excite.human.measure import MeasureSettings, measure_person, measure_recordings, write_person
from excite.human.segments import NAMES
from excite.logs.files import load_log
from excite.robot.loading import load_robot
from excite.robot.shapes.collision import com_boxes
from tests.benchmarks.table import Row
from tests.human.recordings import write_c3d

DRAWS = int(os.environ.get("EXCITE_BELT_DRAWS", "100"))
SECONDS = 40.0
_ALLOWED = 0.5


def rows() -> list[Row]:
    """The blind draws, and what a long trial costs."""
    return [*blind_rows(DRAWS), long_trial_row()]


def blind_rows(draws: int) -> list[Row]:
    """The blind draws."""
    right, errors = 0, []
    for number in range(draws):
        belt, result = experiment(np.random.default_rng([number, 7]), number)
        error = result.best.mass - belt.mass
        hit = result.best.segment == belt.segment and abs(error) <= _ALLOWED
        right += hit
        errors.append(abs(error))
    share = 100.0 * right / max(draws, 1)
    return [
        Row.at_least(
            f"Blind belts, right segment of fifteen and within 0.5 kg ({draws} draws)", share, 95.0, "%"
        ),
        Row("Blind belts, median error of the mass", "", f"{np.median(errors):.2f} kg", None),
    ]


def long_trial_row() -> Row:
    """Processor time from a C3D file of 60 s, 35 markers at 200 Hz and two plates, to the table of segment masses."""
    rng = np.random.default_rng(3)
    who = draw_subject(rng)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        short = write_c3d(
            record_performance(who, perform_exercise(who.body, 5.0, seed=3), rng), folder / "short.c3d"
        )
        trial = write_c3d(
            record_performance(who, perform_exercise(who.body, 60.0, rate_hz=200.0, seed=3), rng),
            folder / "trial.c3d",
        )
        # Compiled once, as on a user's second trial.
        _segments(who, short, folder / "first")
        start = time.process_time()
        _segments(who, trial, folder / "log")
        spent = time.process_time() - start
    return Row.at_most(
        "A person's trial of 60 s, from C3D to segment masses, processor time", spent, 30.0, "s"
    )


def _segments(who: VirtualSubject, trial: Path, folder: Path) -> None:
    person = measure_person(who.body.subject, [trial])
    write_person(person, folder)
    identify_person(person, folder, "lmi")


def experiment(rng: np.random.Generator, motion: int) -> tuple[Belt, AddedMass]:
    """A session without and one with a belt; returns the truth and what was found."""
    who = draw_subject(rng)
    show = perform_exercise(who.body, SECONDS, seed=motion)
    segment = NAMES[rng.integers(len(NAMES))]
    mass = float(rng.uniform(1.0, 3.0))
    box = segment_box(who.body, NAMES.index(segment))
    place = box.mean(axis=0) + 0.25 * (box[1] - box[0]) * rng.uniform(-1.0, 1.0, 3)
    belt = Belt(segment, mass, tuple(place.tolist()))
    again = repeat_exercise(who.body, show, rng)
    sessions = [
        record_performance(who, show, rng, name="without"),
        record_performance(who, again, rng, belt, name="with"),
    ]
    person = measure_recordings(who.body.subject, sessions, [record_standing(who, rng)], MeasureSettings())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "log"
        write_person(person, folder)
        robot = load_robot(folder / "robot.yaml")
        log = load_log(folder, robot)
        parts = [
            replace(
                log,
                header=log.header.model_copy(update={"trials": (log.header.trials[i],)}),
                trials=(log.trials[i],),
            )
            for i in (0, 1)
        ]
        return belt, locate_added_mass(robot, parts[0], parts[1], com_boxes(robot))
