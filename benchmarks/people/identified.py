"""A person's own segment masses: identification of a measured person, and models with what was found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from benchmarks.people.ground_reaction import GroundReaction, ReactionTable, ground_reactions
from benchmarks.people.segment_table import SegmentTable, segment_table
from benchmarks.people.worn_weight import BELT_RADIUS, AddedMass, WornWeight, locate_added_mass
from excite.atomic import write_text
from excite.display import Shown
from excite.errors import InputError
from excite.human.body import Body
from excite.human.measure import PLACES, ROBOT_FILE, MeasuredPerson, robot_yaml, urdf_text
from excite.human.segments import NAMES, frame_turn
from excite.identification.estimators.method_settings import own_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.estimators.settings import EstimatorSettings, PairSettings
from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.results import write_json
from excite.robot.loading import load_robot
from excite.robot.shapes.collision import com_boxes


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedPerson(Shown):
    """What identification says of a person.

    Attributes:
        identification: parameters, fit and validation.
        table: masses by segment.
        reactions: ground reaction of each trial, measured and by both models.
    """

    identification: Identification
    table: SegmentTable
    reactions: tuple[GroundReaction, ...]

    @property
    def reaction_table(self) -> ReactionTable:
        """RMSE and correlation of the ground reaction."""
        return ReactionTable.of(self.reactions)

    def summary(self) -> str:
        """Fit, validation, ground reaction and the table of masses."""
        parts = (self.identification.summary(), self.reaction_table.summary(), self.table.summary())
        return "\n\n".join(parts)


def identify_person(
    person: MeasuredPerson,
    folder: Path,
    method: str = "lmi",
    settings: EstimatorSettings | None = None,
    *,
    loaded: int = 0,
) -> IdentifiedPerson:
    """Identify a person's segments from the log folder that was written, and write what was found beside it.

    ``identification.json`` and ``segments.csv`` (both tables beside what was identified).

    Args:
        person: the person as measured.
        folder: where :func:`~excite.human.measure.write_person` wrote.
        method: registry name of the estimator; ``lmi`` gives bodies that exist, ``hqp`` is the paper's.
        settings: of the estimator, for example ``asymmetric`` and ``segment_mass_range``.
        loaded: how many trials, the last ones, were done wearing a weight and say nothing of the body.

    Returns:
        The parameters, and measured beside reconstructed ground reactions.

    Raises:
        UnknownNameError: no such method.
        NoSolutionError: the estimator found no parameters that pass its checks.
    """
    find_estimator(method)
    robot = load_robot(folder / ROBOT_FILE)
    log = load_log(folder, robot)
    if loaded:
        log = split_trials(log, loaded)[0]
    result = identify(robot, log, method, settings=settings)
    found = IdentifiedPerson(
        result, segment_table(person.body, result), ground_reactions(robot, log, result.parameters)
    )
    write_json({**result.to_json(), **PLACES}, folder / "identification.json")
    write_text(folder / "segments.csv", found.table.csv())
    return found


def added_mass(folder: Path, loaded: int) -> AddedMass:
    """Where a weight is worn in the last ``loaded`` trials of a log folder, and how heavy it is.

    Args:
        folder: log folder of a person.
        loaded: how many of its trials, the last ones, were recorded with the weight.

    Returns:
        Mass and place of the weight, with intervals.

    Raises:
        InputError: no trial is left without it.
    """
    robot = load_robot(folder / ROBOT_FILE)
    without, wearing = split_trials(load_log(folder, robot), loaded)
    return locate_added_mass(robot, without, wearing, com_boxes(robot))


def split_trials(log: Log, loaded: int) -> tuple[Log, Log]:
    """Trials without and with a weight; in either the last of several validates.

    Raises:
        InputError: no trial is left without it.
    """
    first = len(log.trials) - loaded
    if first < 1:
        raise InputError(
            f"{loaded} of {len(log.trials)} trials with a weight",
            field="loaded",
            remedy="give a trial without it too, before those with it",
        )
    return _trials_within(log, slice(0, first)), _trials_within(log, slice(first, None))


def _trials_within(log: Log, span: slice) -> Log:
    headers, trials = log.header.trials[span], log.trials[span]
    roles = ["identification"] * len(trials)
    if len(trials) > 1:
        roles[-1] = "validation"
    header = log.header.model_copy(
        update={
            "trials": tuple(h.model_copy(update={"role": r}) for h, r in zip(headers, roles, strict=True))
        }
    )
    return replace(
        log, header=header, trials=tuple(replace(t, role=r) for t, r in zip(trials, roles, strict=True))
    )


# The body identified with a weight beside the body without (section VIII of Jovic et al., T-RO 2016).

_WITH_WEIGHT = "with_weight"


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
    inside = folder / _WITH_WEIGHT
    save_log(log, inside)
    plates = tuple(sensor.name for sensor in log.header.sensors)
    write_text(inside / ROBOT_FILE, robot_yaml(body, log.header.rate_hz, plates))
    robot = load_robot(inside / ROBOT_FILE)
    settings = own_settings(find_estimator(method), settings)
    if isinstance(settings, PairSettings):
        settings = replace(settings, asymmetric=(*settings.asymmetric, located.best.segment))
    result = identify(robot, load_log(inside, robot), method, settings=settings)
    table = segment_table(body, result)
    write_text(inside / "segments.csv", table.csv())
    return WornWeight(located, without.table, table)


def wearing_body(body: Body, located: AddedMass) -> Body:
    """The nominal body with the weight that was found."""
    best = located.best
    turn = frame_turn(NAMES.index(best.segment))
    inertia = best.mass * BELT_RADIUS**2 * np.eye(3)
    return wearing(body, best.segment, pin.Inertia(best.mass, turn.T @ np.array(best.place), inertia))


def wearing(body: Body, segment: str, weight: pin.Inertia) -> Body:
    """The body with a weight on a segment, in the segment's frame."""
    inertias = list(body.inertias)
    inertias[NAMES.index(segment)] = inertias[NAMES.index(segment)] + weight
    subject = replace(body.subject, mass=body.subject.mass + weight.mass)
    return replace(body, subject=subject, inertias=tuple(inertias))
