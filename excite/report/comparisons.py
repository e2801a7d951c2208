"""What a report compares: measured with modelled, before with after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

Names = tuple[str, ...]

NORMAL_95 = 1.96
"""Deviations of a normal distribution within which 95 of 100 values lie."""


@dataclass(frozen=True, eq=False)
class ForceComparison:
    """One validation trial, measured and predicted.

    Attributes:
        trial: name of the trial.
        channels: what each column is: ``fx`` … ``tz`` in the base frame, or joint names.
        units: unit of each column.
        time: ``(n,)`` [s].
        measured: ``(n, n_channels)``.
        nominal: prediction of the nominal model, ``(n, n_channels)``.
        identified: prediction of the identified model, ``(n, n_channels)``; of a diagnosis, the model with the effects.

    Of a log that was looked through, ``measured`` is what the nominal model needs, ``nominal`` the torques as they
    stand in the log, and ``identified`` the same as they were repaired.
    """

    trial: str
    channels: Names
    units: Names
    time: Array
    measured: Array
    nominal: Array
    identified: Array


@dataclass(frozen=True, eq=False)
class MassComparison:
    """Masses of the segments [kg], each ``(n_segments,)``.

    Attributes:
        names: readable names of the segments.
        nominal: of the model as supplied.
        identified: of the identified model.
        true: of the virtual robot; None where nobody knows, as on a real robot.
        changed: True where the identification says that the segment differs; None where not judged.
        half_width: half of each identified mass's 95 % interval, of the data and of what the nominal model is granted;
            None where it was not computed.
        determined: share of what the nominal model is granted that the data took away, 0 to 1; likewise.
    """

    names: Names
    nominal: Array
    identified: Array
    true: Array | None = None
    changed: NDArray[np.bool_] | None = None
    half_width: Array | None = None
    determined: Array | None = None


@dataclass(frozen=True, eq=False)
class ConditioningComparison:
    """Condition numbers of the segments' sub-regressors, before and after the choice of motions.

    Attributes:
        segments: readable names.
        before: ``(n_segments,)``, infinite where nothing excites the segment.
        after: ``(n_segments,)``, likewise.
        full_before: condition number of the base columns.
        full_after: likewise.
        before_label: what "before" is, for the legend.
        after_label: what "after" is.
    """

    segments: Names
    before: Array
    after: Array
    full_before: float
    full_after: float
    before_label: str = "before"
    after_label: str = "chosen motions"


@dataclass(frozen=True, eq=False)
class PathComparison:
    """A trial as its joints moved, and as simulators move them; where nothing was simulated these are the record.

    Attributes:
        trial: its name.
        joints: of the columns.
        time: ``(n,)`` [s].
        measured: positions, ``(n, n_joints)`` [rad or m].
        nominal: of the nominal simulator, likewise.
        identified: of the simulator with the effects, likewise; of an identification, of the identified model.
        horizon_s: how long a model ran before it started anew from the record [s]; None where the document says it.
    """

    trial: str
    joints: Names
    time: Array
    measured: Array
    nominal: Array
    identified: Array
    horizon_s: float | None = None
