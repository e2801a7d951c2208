"""A first session without a laboratory: recordings of a virtual person as files, and the truth behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.errors import UnknownNameError
from excite.human.body import segment_box
from excite.human.segments import NAMES
from excite.human.subject import Subject
from excite.human.virtual.exercise import perform_exercise, repeat_exercise
from excite.human.virtual.files import write_mot, write_trc
from excite.human.virtual.laboratory import record_performance, record_standing
from excite.human.virtual.person import Belt, draw_subject
from excite.reading.number import check_number

# Shorter than ten seconds, legs and arms have no time to swing; longer than ten minutes, nobody does it.
_SECONDS = (10.0, 600.0)
_WEIGHT_KG = (0.0, 50.0)


@dataclass(frozen=True)
class SimulatedSession:
    """Files of a virtual person.

    Attributes:
        standing: markers while standing still, for calibration (TRC).
        moving: markers and ground reaction of the exercise (TRC, MOT).
        wearing: the exercise done again with a weight (TRC, MOT); empty without one.
        masses: true masses of the segments without the weight [kg].
    """

    standing: tuple[Path, ...]
    moving: tuple[Path, ...]
    wearing: tuple[Path, ...]
    masses: Mapping[str, float]


def simulate_person(
    out: Path,
    subject: Subject,
    *,
    seconds: float = 60.0,
    seed: int = 0,
    weight: tuple[str, float] | None = None,
) -> SimulatedSession:
    """Write recordings of a virtual person, to try `excite human` without a laboratory.

    Segments, joint centres and marker places differ from the tables' by chance; soft tissue, cameras and plates
    have the errors that are published of real ones. The person swings arms, trunk, head and legs, and squats.

    Args:
        out: folder for ``standing.trc``, ``moving.trc``, ``moving.mot``, and with a weight ``wearing.trc`` and
            ``wearing.mot``; made if it is not there.
        subject: mass, height and sex; the segments add up to this mass.
        seconds: of exercise, 10 to 600.
        seed: of person, exercise and noise.
        weight: segment and mass [kg] of a weight worn at the segment's middle while the exercise is done again.

    Returns:
        The files, and the true masses, to be looked at afterwards.

    Raises:
        InputError: absurd seconds or mass of the weight.
        UnknownNameError: no such segment.
    """
    check_number(seconds, "seconds", *_SECONDS, "s")
    if weight is not None:
        if weight[0] not in NAMES:
            raise UnknownNameError("segment", str(weight[0])[:60], list(NAMES))
        check_number(weight[1], "weight", *_WEIGHT_KG, "kg")
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    who = draw_subject(rng, subject)
    show = perform_exercise(who.body, seconds, seed=seed)
    moving = record_performance(who, show, rng)
    still = write_trc(record_standing(who, rng), out / "standing.trc")
    trial = (write_trc(moving, out / "moving.trc"), write_mot(moving, out / "moving.mot"))
    again: tuple[Path, ...] = ()
    if weight is not None:
        place = segment_box(who.body, NAMES.index(weight[0])).mean(axis=0)
        belt = Belt(weight[0], weight[1], tuple(place.tolist()))
        worn = record_performance(who, repeat_exercise(who.body, show, rng), rng, belt)
        again = (write_trc(worn, out / "wearing.trc"), write_mot(worn, out / "wearing.mot"))
    masses = {name: part.mass for name, part in zip(NAMES, who.body.inertias, strict=True)}
    return SimulatedSession((still,), trial, again, masses)
