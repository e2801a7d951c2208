"""The weight of a person, and a weight that is worn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import atomic_path
from excite.human.body import Body, BodyInertia
from excite.human.identified import IdentifiedPerson, split_trials
from excite.human.measure import MeasuredPerson
from excite.human.models import ROBOT_FILE, robot_yaml, urdf_text
from excite.human.segment_table import SegmentTable, segment_table
from excite.human.segments import NAMES
from excite.human.skeleton import frame_turn
from excite.human.weights import BELT_RADIUS, AddedMass
from excite.identification.estimators.method_settings import own_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.estimators.settings import EstimatorSettings, PairSettings
from excite.identification.identify import identify
from excite.logs.files import load_log, save_log
from excite.robot.loading import load_robot

# A weight that is worn: the body identified with it beside the body without (table IV of Jovic et al., T-RO
# 2016).

FOLDER = "with_weight"


@dataclass(frozen=True, eq=False)
class WornWeight:
    """Segments identified from the trials with a weight.

    Attributes:
        located: where it was found, and how heavy.
        without: masses from the trials without it.
        wearing: masses from the trials with it.
    """

    located: AddedMass
    without: SegmentTable
    wearing: SegmentTable

    @property
    def mass(self) -> float:
        """How much heavier the segment that carries it was identified [kg]: last row of the paper's table IV."""
        k = NAMES.index(self.located.best.segment)
        return self.wearing.rows[k].identified - self.without.rows[k].identified

    def to_json(self) -> dict[str, Any]:
        """``{"segment", "mass_by_segments_kg", "segments": [{"segment", "without_kg", "wearing_kg"}]}``."""
        pairs = zip(self.without.rows, self.wearing.rows, strict=True)
        return {
            "segment": self.located.best.segment,
            "mass_by_segments_kg": self.mass,
            "segments": [
                {"segment": a.segment, "without_kg": a.identified, "wearing_kg": b.identified}
                for a, b in pairs
            ],
        }

    def summary(self) -> str:
        """The table in words, for a terminal."""
        lines = ["segment masses [kg], identified:", f"  {'':16}{'without':>10}{'wearing':>10}{'more':>8}"]
        for a, b in zip(self.without.rows, self.wearing.rows, strict=True):
            more = b.identified - a.identified
            lines.append(f"  {a.segment:16}{a.identified:10.2f}{b.identified:10.2f}{more:+8.2f}")
        name = self.located.best.segment
        lines.append(f"weight by the masses of {name}: {self.mass:.2f} kg")
        return "\n".join(lines)


def identify_wearing(
    person: MeasuredPerson,
    folder: Path,
    located: AddedMass,
    without: IdentifiedPerson,
    loaded: int,
    method: str = "hqp",
    settings: EstimatorSettings | None = None,
) -> WornWeight:
    """Identify the segments from the trials with a weight, as section VIII of the paper does.

    The segment that carries it need not mirror the other side, and its reference is the nominal one and the
    weight. Written to the subfolder ``with_weight``: the log, the heavier model, ``segments.csv``.

    Args:
        person: the person as measured.
        folder: log folder of all trials.
        located: the weight.
        without: what was identified from the trials without it.
        loaded: how many trials, the last ones, were done wearing it.
        method: registry name of the estimator.
        settings: of the estimator.

    Returns:
        The weight, and the person with it.

    Raises:
        InputError: no trial is left without the weight.
        NoSolutionError: the estimator found no parameters that pass its checks.
    """
    body = wearing_body(person.body, located)
    log = load_log(folder, load_robot(folder / ROBOT_FILE))
    log = replace(split_trials(log, loaded)[1], robot_text=urdf_text(body))
    inside = folder / FOLDER
    save_log(log, inside)
    plates = tuple(sensor.name for sensor in log.header.sensors)
    with atomic_path(inside / ROBOT_FILE) as temporary:
        temporary.write_text(robot_yaml(body, log.header.rate_hz, plates), encoding="utf-8")
    robot = load_robot(inside / ROBOT_FILE)
    settings = own_settings(find_estimator(method), settings)
    if isinstance(settings, PairSettings):
        settings = replace(settings, asymmetric=(*settings.asymmetric, located.best.segment))
    result = identify(robot, load_log(inside, robot), method, settings=settings)
    table = segment_table(body, result)
    with atomic_path(inside / "segments.csv") as temporary:
        temporary.write_text(table.csv(), encoding="utf-8")
    return WornWeight(located, without.table, table)


def wearing_body(body: Body, located: AddedMass) -> Body:
    """The nominal body with the weight that was found."""
    best = located.best
    turn = frame_turn(NAMES.index(best.segment))
    inertia = best.mass * BELT_RADIUS**2 * np.eye(3)
    return body.wearing(best.segment, BodyInertia(best.mass, turn.T @ np.array(best.place), inertia))
