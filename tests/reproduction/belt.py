"""Jovic et al. 2016 (IEEE T-RO), section VIII: a person with a weighted belt, here a virtual one.

A man of 70 kg and 1.82 m, 35 markers, two force plates; camera noise, soft tissue and the plates' noise and zeros
at published levels (benchmarks.virtual_person names them). Each trial repeats the same motion as people do, with
other timing and range.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.people.ground_reaction import ReactionTable
from benchmarks.people.identified import IdentifiedPerson, added_mass, identify_person, identify_wearing
from benchmarks.people.worn_weight import WornWeight
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
from excite.human.measure import MeasuredPerson, measure_recordings, write_person
from excite.human.segments import NAMES

# Table III: RMSE and CC by component, identified and Dumas.
TABLE_3: dict[str, tuple[float, float, float, float]] = {
    "fz": (8.65, 0.94, 9.62, 0.92),
    "fx": (0.18, 0.40, 0.18, 0.40),
    "fy": (2.95, 0.68, 2.95, 0.68),
    "tz": (9.0, 0.52, 9.0, 0.40),
    "tx": (26.8, 0.43, 51.4, -0.09),
    "ty": (19.4, 0.78, 58.0, 0.58),
}
PLACES = ("pelvis", "right_hand", "left_foot")
BELT_KG = 2.0
# Table IV, identified: no extra weight, then the belt at each of the places; its last row: the belt.
TABLE_4: dict[str, tuple[float, float, float, float]] = {
    "pelvis": (9.7, 12.2, 10.0, 10.0),
    "torso": (17.2, 17.4, 17.4, 17.4),
    "right_thigh": (11.3, 11.2, 11.3, 11.0),
    "left_thigh": (12.4, 12.3, 12.5, 12.0),
    "right_shank": (3.8, 3.5, 3.7, 3.5),
    "left_shank": (3.8, 3.9, 3.9, 3.5),
    "right_foot": (1.2, 0.9, 1.1, 0.9),
    "left_foot": (1.2, 1.0, 1.0, 3.2),
    "right_upper_arm": (1.6, 1.6, 1.6, 1.6),
    "left_upper_arm": (1.7, 1.6, 1.6, 1.6),
    "right_forearm": (0.85, 0.7, 0.8, 1.1),
    "left_forearm": (0.85, 0.9, 0.8, 1.1),
    "right_hand": (0.4, 0.5, 1.9, 0.5),
    "left_hand": (0.4, 0.4, 0.4, 0.4),
    "head": (3.6, 3.7, 3.7, 4.0),
}
BELT = {"pelvis": 2.5, "right_hand": 1.5, "left_foot": 2.0}
SECONDS, _SEED = 40.0, 2016
CONSISTENT = "lmi"


@dataclass(frozen=True, eq=False)
class BeltTrial:
    """One place of the belt.

    Attributes:
        place: segment that carries it.
        base: identified from the trial without it.
        worn: where it was found, and the segments identified with it.
        consistent: the same by ``lmi``, whose bodies exist.
    """

    place: str
    base: IdentifiedPerson
    worn: WornWeight
    consistent: WornWeight


class BeltExperiment:
    """The virtual subject, recorded without and with the belt.

    Attributes:
        who: the truth.
        folder: where logs are written.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._rng = np.random.default_rng(_SEED)
        self.who: VirtualSubject = draw_subject(self._rng)
        self._static = record_standing(self.who, self._rng)
        self._show = perform_exercise(self.who.body, SECONDS, seed=1)
        self._base = record_performance(self.who, self._show, self._rng, name="base")

    def truth(self) -> dict[str, float]:
        """True masses without the belt [kg]."""
        return {name: body.mass for name, body in zip(NAMES, self.who.body.inertias, strict=True)}

    def table_three(self, method: str) -> ReactionTable:
        """Ground reaction of the trial without belt, identified from 70 % of it."""
        person = measure_recordings(self.who.body.subject, [self._base], [self._static])
        return self._identified(person, "table_three", method).reaction_table

    def trials(self, method: str) -> Iterator[BeltTrial]:
        """Each place in turn."""
        for place in PLACES:
            box = segment_box(self.who.body, NAMES.index(place))
            belt = Belt(place, BELT_KG, tuple(box.mean(axis=0).tolist()))
            show = repeat_exercise(self.who.body, self._show, self._rng)
            loaded = record_performance(self.who, show, self._rng, belt, name=place)
            person = measure_recordings(self.who.body.subject, [self._base, loaded], [self._static])
            base = self._identified(person, place, method, loaded=1)
            folder = self.folder / place
            located = added_mass(folder, 1)
            worn = identify_wearing(person, folder, located, base, 1, method)
            other = identify_person(person, folder, CONSISTENT, loaded=1)
            consistent = identify_wearing(person, folder, located, other, 1, CONSISTENT)
            yield BeltTrial(place, base, worn, consistent)

    def _identified(
        self, person: MeasuredPerson, name: str, method: str, loaded: int = 0
    ) -> IdentifiedPerson:
        write_person(person, self.folder / name)
        return identify_person(person, self.folder / name, method, loaded=loaded)
