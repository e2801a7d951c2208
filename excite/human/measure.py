"""From files of a motion laboratory to a person's model and log folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import atomic_path
from excite.errors import InputError, UnknownNameError
from excite.finding import Finding
from excite.human.body import Body, body_of
from excite.human.dimensions import DIMENSIONS, Dimensions
from excite.human.inertials import ANTHROPOMETRY, Anthropometry
from excite.human.laboratory import AXES, absent_markers, in_metres, turn_z_up, up_axis, with_known_labels
from excite.human.log_folder import MeasuredTrial, human_log
from excite.human.markers.calibration import Calibration, calibrate_body
from excite.human.markers.marker_set import MarkerSet, find_marker_set, read_marker_set
from excite.human.measured_trial import measured_trial
from excite.human.pairing import paired_recordings
from excite.human.recording import Recording
from excite.human.segments import NAMES
from excite.human.subject import Subject
from excite.human.urdf import PLACES, ROBOT_FILE, robot_yaml
from excite.logs.files import save_log
from excite.logs.log import Log
from excite.progress import Progress, silent
from excite.reading.number import check_number
from excite.shown import Shown
from excite.threads import one_blas_thread

# People move below 20 Hz; a filter far below what they do leaves nothing of it [Hz].
_CUTOFFS_HZ = (0.05, 1e4)
# So much of a trial has to be left to identify from.
_LARGEST_SHARE = 0.9
# From nothing, after an amputation, to a segment as heavy as the heaviest person [kg].
_SEGMENT_KG = (0.0, 400.0)


@dataclass(frozen=True)
class MeasureSettings:
    """Choices.

    Attributes:
        table: of the nominal inertial parameters, ``de_leva`` or ``dumas``.
        markers: name of a marker set or path of a mapping file; None finds the set by its labels.
        up: laboratory axis that points up; None finds it.
        cutoff_hz: low-pass on markers and forces [Hz]; 0 for none.
        hold_out: share of a single trial that validates.
        segment_mass: nominal masses that are known better than by the table, by segment [kg].
    """

    table: Anthropometry = "de_leva"
    markers: str | None = None
    up: str | None = None
    cutoff_hz: float = 6.0
    hold_out: float = 0.3
    segment_mass: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check every choice; raises UnknownNameError or InputError that names it."""
        if self.table not in ANTHROPOMETRY:
            raise UnknownNameError("table of segment inertias", str(self.table)[:60], list(ANTHROPOMETRY))
        if self.up is not None and self.up not in AXES:
            raise UnknownNameError("axis that points up", str(self.up)[:60], list(AXES))
        if self.cutoff_hz != 0.0:
            check_number(self.cutoff_hz, "cutoff_hz", *_CUTOFFS_HZ, "Hz, or 0 for none")
        check_number(self.hold_out, "hold_out", 0.0, _LARGEST_SHARE)
        for segment, mass in self.segment_mass.items():
            if segment not in NAMES:
                raise UnknownNameError("segment", segment[:60], list(NAMES))
            check_number(mass, f"segment_mass.{segment}", *_SEGMENT_KG, "kg")


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredPerson(Shown):
    """A person as measured.

    Attributes:
        body: dimensions calibrated, nominal inertial parameters.
        calibration: markers on the body.
        log: trials, ready to be identified from.
        trials: by trial: RMS distance of each marker [m], mass that the plates say [kg], plates and their feet.
        findings: what was odd in the files and what was done about it.
    """

    body: Body
    calibration: Calibration
    log: Log
    trials: Mapping[str, Mapping[str, Any]]
    findings: tuple[Finding, ...] = field(default=())

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.human/1``."""
        subject, d = self.body.subject, self.calibration.dimensions
        other = {table: self.body.with_table(table) for table in ANTHROPOMETRY}  # type: ignore[arg-type]
        return {
            "schema": "excite.human/1",
            **PLACES,
            "subject": {"mass": subject.mass, "height": subject.height, "sex": subject.sex},
            "table": self.body.table,
            "segments": [
                {"segment": name, **{f"{table}_kg": body.inertias[k].mass for table, body in other.items()}}
                for k, name in enumerate(NAMES)
            ],
            "dimensions": _dimensions_json(d),
            "marker_rms_m": self.calibration.rms,
            "trials": [{"trial": name, **values} for name, values in self.trials.items()],
            "findings": [finding.to_json() for finding in self.findings],
        }

    def summary(self) -> str:
        """In words, for a terminal."""
        subject = self.body.subject
        lines = [
            f"person of {subject.mass:g} kg, {subject.height:g} m, {subject.sex}; segments by {self.body.table}",
            f"markers fit the calibrated body to {1e3 * self.calibration.rms:.1f} mm",
        ]
        for name, values in self.trials.items():
            rms = values["marker_rms_m"]
            worst = max(rms, key=rms.get)
            typical = np.sqrt(np.mean(np.square(list(rms.values()))))
            plates = ", ".join(f"{p['plate']} under {p['foot']}" for p in values["plates"])
            lines.append(
                f"{name}: {values['seconds']:.1f} s, markers {1e3 * typical:.1f} mm (worst {worst}, "
                f"{1e3 * rms[worst]:.1f} mm), plates say {values['plates_kg']:.2f} kg; {plates}"
            )
        return "\n".join([*lines, *(f"note: {finding.text}" for finding in self.findings)])


def _dimensions_json(dimensions: Dimensions) -> dict[str, dict[str, float]]:
    pairs = zip(DIMENSIONS, dimensions.values, dimensions.spread, strict=True)
    return {name: {"value_m": float(value), "std_m": float(spread)} for name, value, spread in pairs}


@one_blas_thread
def measure_person(
    subject: Subject,
    trials: Sequence[Path],
    static: Sequence[Path] = (),
    settings: MeasureSettings | None = None,
    progress: Progress = silent,
) -> MeasuredPerson:
    """Calibrate a person's body and turn trials to joint angles and contact wrenches.

    Args:
        subject: mass, height, sex.
        trials: files with markers and forces (C3D, CSV), or with one of the two (TRC; MOT, STO), which are paired.
        static: recordings of standing, for calibration only.
        settings: table, marker set, axes, filter.
        progress: told of each trial.

    Returns:
        The person's model, the log, and what was found on the way.

    Raises:
        LogError: a file is malformed, or markers and forces cannot be true; names the file and the remedy.
        InputError: markers are too few, or settings absurd.
    """
    moving, standing = paired_recordings(trials, static)
    return measure_recordings(subject, moving, standing, settings, progress)


@one_blas_thread
def measure_recordings(
    subject: Subject,
    moving: Sequence[Recording],
    standing: Sequence[Recording] = (),
    settings: MeasureSettings | None = None,
    progress: Progress = silent,
) -> MeasuredPerson:
    """:func:`measure_person` of recordings that have been read."""
    settings = settings or MeasureSettings()
    markers = _marker_set(settings, [*standing, *moving])
    up = settings.up
    prepared = []
    for recording in (*standing, *moving):
        known = in_metres(with_known_labels(recording, markers), subject)
        up = up_axis(known, markers) if up is None else up
        prepared.append(turn_z_up(known, up))
    still, upright_trials = prepared[: len(standing)], prepared[len(standing) :]
    wanted = tuple(label for label in markers.sites if any(label in r.markers for r in prepared))
    cutoff = settings.cutoff_hz or None
    calibration = calibrate_body(subject, markers.sites, [item.markers for item in (*still, *upright_trials)])
    body = body_of(subject, calibration.dimensions, settings.table).with_masses(settings.segment_mass)
    measured: list[MeasuredTrial] = []
    reports: dict[str, dict[str, Any]] = {}
    findings: list[Finding] = [found for recording in still for found in recording.findings]
    for number, recording in enumerate(upright_trials):
        progress("trials", number, len(upright_trials))
        findings += [*recording.findings, *absent_markers(recording, wanted)]
        if cutoff is not None and cutoff >= 0.5 * recording.rate_hz:
            raise InputError(
                f"is {cutoff:g} Hz, and markers at {recording.rate_hz:g} Hz hold nothing beyond half of that",
                source=recording.source,
                field="cutoff_hz",
                remedy=f"choose one below {0.5 * recording.rate_hz:g} Hz, or 0 for none",
            )
        trial, report, found = measured_trial(body, calibration, recording, cutoff)
        measured.append(trial)
        reports[trial.name] = report
        findings += found
    progress("trials", len(upright_trials), len(upright_trials))
    log = human_log(body, measured, settings.hold_out, cutoff)
    return MeasuredPerson(body, calibration, log, reports, tuple(findings))


def _marker_set(settings: MeasureSettings, recordings: Sequence[Recording]) -> MarkerSet:
    if settings.markers is not None:
        return read_marker_set(settings.markers)
    return find_marker_set({label for recording in recordings for label in recording.markers})


def write_person(person: MeasuredPerson, folder: Path) -> None:
    """Write a log folder with the person's model: ``log.yaml``, trials, ``human.urdf``, ``robot.yaml``.

    Args:
        person: as measured.
        folder: the log folder to write; made if it is not there.

    Raises:
        LogError: the folder holds something that is no log.
    """
    save_log(person.log, folder)
    plates = tuple(sensor.name for sensor in person.log.header.sensors)
    with atomic_path(folder / ROBOT_FILE) as temporary:
        text = robot_yaml(person.body, person.log.header.rate_hz, plates)
        temporary.write_text(text, encoding="utf-8")
