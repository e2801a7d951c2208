"""A person's own segment masses: identification of a measured person, and models with what was found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from excite.atomic import atomic_path
from excite.human.added_mass import AddedMass, locate_added_mass
from excite.human.measure import MeasuredPerson
from excite.human.osim import write_osim
from excite.human.segment_table import SegmentTable, identified_body, segment_table
from excite.human.urdf import ROBOT_FILE, urdf_text
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.json_document import write_json
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.robot.com_box import com_boxes
from excite.robot.loading import load_robot

IDENTIFIED = "human_identified"


@dataclass(frozen=True, eq=False)
class IdentifiedPerson:
    """What identification says of a person.

    Attributes:
        identification: parameters, fit and validation.
        table: masses by segment.
    """

    identification: Identification
    table: SegmentTable

    def summary(self) -> str:
        """Fit, validation and the table of masses."""
        return f"{self.identification.summary()}\n\n{self.table.summary()}"


def identify_person(
    person: MeasuredPerson, folder: Path, method: str = "lmi", settings: EstimatorSettings | None = None
) -> IdentifiedPerson:
    """Identify a person's segments from the log folder that was written, and write what was found beside it.

    ``identification.json``, ``segments.csv`` (both tables beside what was identified), ``human_identified.urdf``
    and ``human_identified.osim``.

    Args:
        person: the person as measured.
        folder: where :func:`~excite.human.measure.write_person` wrote.
        method: registry name of the estimator; ``lmi`` gives bodies that exist, ``hqp`` is the paper's.
        settings: of the estimator, for example ``mirror`` and ``segment_mass_range``.

    Raises:
        NoSolutionError: the estimator found no parameters that pass its checks.
    """
    robot = load_robot(folder / ROBOT_FILE)
    result = identify(robot, load_log(folder, robot), method, settings=settings)
    table = segment_table(person.body, result)
    body = identified_body(person.body, result)
    write_json(result.to_json(), folder / "identification.json")
    with atomic_path(folder / "segments.csv") as temporary:
        temporary.write_text(table.csv(), encoding="utf-8")
    with atomic_path(folder / f"{IDENTIFIED}.urdf") as temporary:
        temporary.write_text(urdf_text(body), encoding="utf-8")
    write_osim(body, folder / f"{IDENTIFIED}.osim", person.calibration.model, IDENTIFIED)
    return IdentifiedPerson(result, table)


def added_mass(folder: Path, loaded: int) -> AddedMass:
    """Where a weight is worn in the last ``loaded`` trials of a log folder, and how heavy it is.

    Args:
        folder: log folder of a person.
        loaded: how many of its trials, the last ones, were recorded with the weight.
    """
    robot = load_robot(folder / ROBOT_FILE)
    log = load_log(folder, robot)
    first = len(log.trials) - loaded
    boxes = com_boxes(robot)
    return locate_added_mass(robot, _trials(log, slice(0, first)), _trials(log, slice(first, None)), boxes)


def _trials(log: Log, span: slice) -> Log:
    header = log.header.model_copy(update={"trials": log.header.trials[span]})
    return replace(log, header=header, trials=log.trials[span])
