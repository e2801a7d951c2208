"""From files of a motion laboratory to a person's model and log folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, indent, tostring

import numpy as np
import pinocchio as pin
import yaml

from excite.atomic import write_text
from excite.display import Shown
from excite.errors import InputError, UnknownNameError
from excite.finding import Finding, list_names
from excite.formats.documents import read_xml, read_yaml
from excite.formats.number import check_number
from excite.human.body import ANTHROPOMETRY, DIMENSIONS, Anthropometry, Body, body_of, segment_box
from excite.human.markers.marker_set import (
    MARKER_SETS,
    MarkerSet,
    MarkerSite,
    find_marker_set,
    read_marker_set,
)
from excite.human.plates import PlateReading, find_support, plate_readings
from excite.human.recording import (
    AXES,
    Recording,
    absent_markers,
    in_metres,
    turn_z_up,
    up_axis,
    with_known_labels,
)
from excite.human.recording_files import paired_recordings
from excite.human.segments import (
    JOINT_NAMES,
    NAMES,
    PAIRS,
    PARENTS,
    SEGMENTS,
    Subject,
    base_pose,
    frame_turn,
    joint_angles,
    place_segments,
)
from excite.human.trial_poses import Calibration, TrialPoses, calibrate_body, trial_poses
from excite.logs.files import save_log
from excite.logs.header_blocks import Role, TrialHeader
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.signals.butterworth import settling_samples
from excite.progress import Progress, silent
from excite.results import (
    ADDED,
    HIDDEN,
    FilePath,
    Name,
    Positive,
    Seconds,
    Stated,
    UnboundedPositive,
    stated,
    stated_later,
)
from excite.robot.urdf.writing import add_element, add_inertial, add_joint, add_solid
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

# A scaled OpenSim model: the masses of its segments as nominal ones, and which segment carries which marker.

# Which segment a body of OpenSim's models belongs to, by its name without the side.
_KINDS: Mapping[str, str] = {
    body: kind
    for kind, bodies in read_yaml(Path(__file__).with_name("segment_tables.yaml"))["opensim"].items()
    for body in bodies.split()
}


@dataclass(frozen=True)
class OpenSimModel:
    """What a scaled model says of a person.

    Attributes:
        masses: by segment that has a body of its own [kg].
        markers: segments by label, with the bony landmark where a known set has that label on that segment.
    """

    masses: Mapping[str, float]
    markers: MarkerSet

    def segment_masses(self, body: Body) -> dict[str, float]:
        """Masses of all segments, together the person's; what has no body of its own is part of what carries it.

        Args:
            body: the person by the tables, whose masses share out a body that holds several segments.
        """
        own = {name: inertia.mass for name, inertia in zip(NAMES, body.inertias, strict=True)}
        carriers: dict[str, str] = {}
        for name, parent in zip(NAMES, PARENTS, strict=True):
            carriers[name] = name if name in self.masses else carriers[NAMES[parent]]
        held = {name: sum(own[one] for one in NAMES if carriers[one] == name) for name in self.masses}
        scale = body.subject.mass / sum(self.masses.values())
        return {
            name: scale * self.masses[carrier] * own[name] / held[carrier]
            for name, carrier in carriers.items()
        }


def read_osim(path: str | Path) -> OpenSimModel:
    """Read a scaled model, of OpenSim 3 or 4.

    Raises:
        InputError: it is no such model, or a body with a mass is of no segment that is known.
    """
    path = Path(path)
    root = read_xml(path)
    if root.tag != "OpenSimDocument":
        raise InputError(
            "is no OpenSim model",
            source=path,
            field=root.tag,
            remedy="give the .osim that the scale tool wrote",
        )
    masses: dict[str, float] = {}
    unknown = []
    for body in root.iter("Body"):
        name, segment, mass = body.get("name", ""), _segment_of(body.get("name", "")), _read_mass(body, path)
        if segment is None:
            unknown += [name] if mass > 0.0 else []
        else:
            masses[segment] = masses.get(segment, 0.0) + mass
    if unknown:
        what = f"has bodies of no segment that is known: {list_names(unknown, 4)}"
        raise InputError(what, source=path, field="BodySet", remedy="give masses with --segment-mass instead")
    masses = {name: mass for name, mass in masses.items() if mass > 0.0}
    if "pelvis" not in masses:
        raise InputError(
            "has no pelvis with a mass", source=path, field="BodySet", remedy="give the scaled model"
        )
    known: dict[str, MarkerSite] = {}
    for name in MARKER_SETS:
        known = {**read_marker_set(name).sites, **known}
    sites = {}
    for marker in root.iter("Marker"):
        # ``/bodyset/NAME`` of OpenSim 4, ``body`` of OpenSim 3.
        carrier = marker.findtext("socket_parent_frame") or marker.findtext("body") or ""
        label, segment = marker.get("name", ""), _segment_of(carrier.strip().removeprefix("/bodyset/"))
        if segment is not None:
            site = known.get(label)
            sites[label] = site if site is not None and site.segment == segment else MarkerSite(segment)
    return OpenSimModel(masses, MarkerSet(path.stem, sites))


def _segment_of(body: str) -> str | None:
    """The segment that a body belongs to; None where that is not known."""
    if body in NAMES:
        return body
    side = {"_r": "right_", "_l": "left_"}.get(body[-2:].lower(), "")
    kind = _KINDS.get((body[:-2] if side else body).lower())
    if kind is None:
        return None
    return next((name for name in (kind, f"{side}{kind}") if name in NAMES), None)


def _read_mass(body: Element, path: Path) -> float:
    try:
        return float(body.findtext("mass") or 0.0)
    except ValueError as error:
        raise InputError(
            "is no number", source=path, field=f"{body.get('name')}/mass", remedy="give kg"
        ) from error


# A person as a URDF and a ``robot.yaml``: spherical joints are three axes with massless links between.

URDF_FILE, ROBOT_FILE = "human.urdf", "robot.yaml"

PLACES = {"robot_file": ROBOT_FILE, "log_file": "."}
"""Where the robot and the log of a person's results lie: in the same folder."""


def urdf_text(body: Body) -> str:
    """The URDF: one link a segment, angles named as in :data:`~excite.human.segments.JOINT_NAMES`."""
    robot, names = Element("robot", name="human"), iter(JOINT_NAMES)
    for k, segment in enumerate(SEGMENTS):
        _add_segment(robot, body, k)
        carrier = NAMES[PARENTS[k]]
        turn = frame_turn(PARENTS[k]) if k else np.eye(3)
        pose = pin.SE3(turn, turn @ body.offsets[k])
        for i, axis in enumerate(segment.axes):
            last = i == len(segment.axes) - 1
            child = segment.name if last else f"{segment.name}_axis_{i + 1}"
            if not last:
                add_element(robot, "link", name=child)
            bound = 1.57 if i == 1 else 3.1
            low, high = (-0.5, 2.9) if len(segment.axes) == 1 else (-bound, bound)
            joint = add_joint(robot, next(names), "revolute", carrier, child, pose)
            add_element(joint, "axis", xyz=np.eye(3)[axis.index] * axis.sign)
            add_element(joint, "limit", lower=low, upper=high, velocity=40.0, effort=400.0)
            carrier, pose = child, pin.SE3.Identity()
    indent(robot)
    return tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _add_segment(robot: Element, body: Body, k: int) -> None:
    """A segment's link: its inertia, and its box to be seen and to collide with."""
    link, inertia = add_element(robot, "link", name=NAMES[k]), body.inertias[k]
    turn, box = pin.SE3(frame_turn(k), np.zeros(3)), segment_box(body, k)
    moments = turn.rotation @ inertia.inertia @ turn.rotation.T
    centre = pin.SE3(np.eye(3), turn.rotation @ inertia.lever)
    add_inertial(link, centre, inertia.mass, moments[np.triu_indices(3)])
    for kind in ("visual", "collision"):
        add_solid(link, kind, turn * pin.SE3(np.eye(3), box.mean(axis=0)), "box", size=box[1] - box[0])


def robot_yaml(body: Body, rate_hz: float, plates: tuple[str, ...] = ()) -> str:
    """The ``robot.yaml`` beside the URDF: pairs, boxes of the centres of mass, soles, joint ranges.

    Args:
        rate_hz: rate of the recordings.
        plates: names of the force plates; two below the feet where there are none.
    """
    subject, d = body.subject, body.dimensions
    content = read_yaml(Path(__file__).with_name("robot_template.yaml"))
    content["title"] = f"Person of {subject.height:g} m, {subject.mass:g} kg, {subject.sex}, 34 DoF"
    # Massless links between the axes of the spherical joints.
    axes = [f"{s.name}_axis_{i}" for s in SEGMENTS for i in range(1, len(s.axes))]
    content["model"] |= {
        "acknowledged": {link: "massless, an axis of a spherical joint" for link in axes},
        "source": f"segments by table {body.mass_origin}, joints from stature or markers",
    }
    # A rectangle of the foot's length, 8 cm wide.
    front, back = round(float(d.foot_length - d.heel), 4), round(float(-d.heel), 4)
    corners = ((back, -0.04), (back, 0.04), (front, 0.04), (front, -0.04))
    for foot in content["feet"]:
        foot["sole"] = [[x, y, round(float(-d.ankle_height), 4)] for x, y in corners]
    plate = {"kind": "force_plate", "link": "world"}
    noise = {"noise_force": 1.0, "noise_moment": 0.3}
    content["sensors"] |= {
        "rate_hz": float(rate_hz),
        "wrench": [
            {"name": name, **plate, "foot": content["feet"][i % 2]["name"], **noise}
            for i, name in enumerate(plates or ("plate_right", "plate_left"))
        ],
    }
    boxes = {}
    for k, name in enumerate(NAMES):
        low, high = segment_box(body, k)
        turned = np.array([frame_turn(k) @ corner for corner in product(*zip(low, high, strict=True))])
        boxes[name] = [turned.min(axis=0).round(4).tolist(), turned.max(axis=0).round(4).tolist()]
    content["segments"] = {"pairs": [list(pair) for pair in PAIRS], "com_box": boxes}
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


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
        osim: scaled OpenSim model, whose masses are the nominal ones and whose markers are those of the recordings.
    """

    table: Anthropometry = "de_leva"
    markers: str | None = None
    up: str | None = None
    cutoff_hz: float = 6.0
    hold_out: float = 0.3
    segment_mass: Mapping[str, float] = field(default_factory=dict)
    osim: str | None = None

    def __post_init__(self) -> None:
        """Check every choice; raises UnknownNameError or InputError that names it."""
        if self.table not in ANTHROPOMETRY:
            raise UnknownNameError("table of segment inertias", str(self.table)[:60], list(ANTHROPOMETRY))
        if self.up is not None and self.up not in AXES:
            raise UnknownNameError("axis that points up", str(self.up)[:60], list(AXES))
        if self.cutoff_hz != 0.0:
            # People move below 20 Hz; a filter far below what they do leaves nothing of it [Hz].
            check_number(self.cutoff_hz, "cutoff_hz", 0.05, 1e4, "Hz, or 0 for none")
        # So much of a trial has to be left to identify from.
        check_number(self.hold_out, "hold_out", 0.0, 0.9)
        for segment, mass in self.segment_mass.items():
            if segment not in NAMES:
                raise UnknownNameError("segment", segment[:60], list(NAMES))
            # From nothing, after an amputation, to a segment as heavy as the heaviest person [kg].
            check_number(mass, f"segment_mass.{segment}", 0.0, 400.0, "kg")


@dataclass(frozen=True)
class TableMass(Stated):
    """A segment's mass by two tables.

    Attributes:
        segment: name of the segment.
        de_leva_kg: de Leva 1996 [kg].
        dumas_kg: Dumas 2007 [kg].
    """

    segment: Name
    de_leva_kg: Positive
    dumas_kg: Positive


@dataclass(frozen=True)
class Dimension(Stated):
    """A length of the calibrated body.

    Attributes:
        value_m: the length [m].
        std_m: its standard deviation [m].
    """

    value_m: float
    std_m: Positive


@dataclass(frozen=True)
class StoodOn(Stated):
    """A force plate, and what stands on it.

    Attributes:
        plate: its name.
        foot: the foot.
        pressure_center_distance_m: from the centre of pressure to the foot, median [m].
    """

    plate: Name
    foot: Name
    pressure_center_distance_m: UnboundedPositive


@dataclass(frozen=True)
class TrialReport(Stated):
    """A trial of a person.

    Attributes:
        trial: its name.
        seconds: in which the plates carry the whole person [s].
        rate_hz: of the frames [Hz].
        plates_kg: mass that the plates say [kg]; null where they do not tell.
        marker_rms_m: distance from its place on the calibrated body by marker, RMS [m].
        plates: force plates and what stands on them.
    """

    trial: Name
    seconds: Seconds = field(metadata=ADDED)
    rate_hz: Positive = field(metadata=ADDED)
    plates_kg: float = field(metadata=ADDED)
    marker_rms_m: Mapping[Name, UnboundedPositive] = field(metadata=ADDED)
    plates: tuple[StoodOn, ...] = field(metadata=ADDED)


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredPerson(Shown, Stated):
    """What ``excite human`` found of a person.

    Attributes:
        body: dimensions calibrated, nominal inertial parameters.
        calibration: markers on the body.
        log: trials, ready to be identified from.
        trials: in order.
        findings: what was wrong with the recordings and what was done about it.
        files: names of all files that were written, which the next run into the folder replaces.
    """

    SCHEMA = "excite.human/1"

    body: Body = field(metadata=HIDDEN)
    calibration: Calibration = field(metadata=HIDDEN)
    log: Log = field(metadata=HIDDEN)
    trials: tuple[TrialReport, ...] = ()
    findings: tuple[Finding, ...] = ()
    files: tuple[Name, ...] = ()

    @property
    @stated_later
    def robot_file(self) -> FilePath:
        """robot.yaml of the person, relative to this file."""
        return PLACES["robot_file"]

    @property
    @stated_later
    def log_file(self) -> FilePath:
        """Log folder of the trials, relative to this file."""
        return PLACES["log_file"]

    @property
    @stated_later
    def subject(self) -> Subject:
        """The person."""
        return self.body.subject

    @property
    @stated
    def table(self) -> Name:
        """Table of the nominal masses."""
        return self.body.table

    @property
    @stated
    def segments(self) -> tuple[TableMass, ...]:
        """Masses by the tables."""
        tables = [self.body.with_table(table).inertias for table in ("de_leva", "dumas")]
        return tuple(
            TableMass(name, *(part.mass for part in parts))
            for name, *parts in zip(NAMES, *tables, strict=True)
        )

    @property
    @stated_later
    def dimensions(self) -> Mapping[Name, Dimension]:
        """Lengths of the calibrated body by name."""
        found = self.calibration.dimensions
        pairs = zip(DIMENSIONS, found.values.tolist(), found.spread.tolist(), strict=True)
        return {name: Dimension(value, spread) for name, value, spread in pairs}

    @property
    @stated_later
    def marker_rms_m(self) -> UnboundedPositive:
        """Distance of the markers from the calibrated body, RMS [m]."""
        return self.calibration.rms

    def summary(self) -> str:
        """In words, for a terminal."""
        subject = self.body.subject
        lines = [
            f"person of {subject.mass:g} kg, {subject.height:g} m, {subject.sex}; segments by {self.body.mass_origin}",
            f"markers fit the calibrated body to {1e3 * self.calibration.rms:.1f} mm",
        ]
        for trial in self.trials:
            rms = trial.marker_rms_m
            worst = max(rms, key=rms.__getitem__)
            typical = np.sqrt(np.mean(np.square(list(rms.values()))))
            plates = ", ".join(f"{item.plate} under {item.foot}" for item in trial.plates)
            lines.append(
                f"{trial.trial}: {trial.seconds:.1f} s, markers {1e3 * typical:.1f} mm (worst {worst}, "
                f"{1e3 * rms[worst]:.1f} mm), plates say {trial.plates_kg:.2f} kg; {plates}"
            )
        return "\n".join([*lines, *(f"note: {finding.text}" for finding in self.findings)])


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
    labels = {label for recording in (*standing, *moving) for label in recording.markers}
    model = None if settings.osim is None else read_osim(settings.osim)
    if settings.markers is None:
        markers = find_marker_set(labels) if model is None or not model.markers.sites else model.markers
    else:
        markers = read_marker_set(settings.markers)
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
    body = body_of(subject, calibration.dimensions, settings.table)
    if model is not None:
        body = body.with_masses(model.segment_masses(body), Path(str(settings.osim)).name)
    body = body.with_masses(settings.segment_mass)
    measured: list[MeasuredTrial] = []
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
        measured.append(measured_trial(body, calibration, recording, cutoff))
        findings += measured[-1].findings
    progress("trials", len(upright_trials), len(upright_trials))
    log = human_log(body, measured, settings.hold_out, cutoff)
    return MeasuredPerson(body, calibration, log, tuple(one.report for one in measured), tuple(findings))


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
    write_text(folder / ROBOT_FILE, robot_yaml(person.body, person.log.header.rate_hz, plates))


# From recordings of a person to a log folder that identification reads as it does a robot's.


@dataclass(frozen=True, eq=False)
class MeasuredTrial:
    """A trial ready for the log.

    Attributes:
        poses: postures of all frames.
        readings: plates at the same times.
        frames: which frames the plates carry.
        report: what is said of it.
        findings: what was found on the way.
    """

    poses: TrialPoses
    readings: tuple[PlateReading, ...]
    frames: slice
    report: TrialReport
    findings: tuple[Finding, ...]


def human_log(body: Body, trials: Sequence[MeasuredTrial], hold_out: float, cutoff_hz: float | None) -> Log:
    """The log of a person's trials.

    Of several trials the last one validates; a single one is cut in two, whose files overlap by what filters take
    away at either end, so that no row is used twice.

    Args:
        trials: measured trials.
        hold_out: share of a single trial's time that validates, 0 for none.
        cutoff_hz: low-pass that markers and forces went through.

    Raises:
        InputError: rates differ.
    """
    rate = trials[0].report.rate_hz
    for report in (trial.report for trial in trials):
        if abs(report.rate_hz / rate - 1.0) > 1e-3:
            raise InputError(
                f"runs at {report.rate_hz:g} Hz, the first trial at {rate:g} Hz",
                source=report.trial,
                field="rate",
                remedy="make logs of each",
            )
    names, plates = _sensor_names(trials), dict[str, PlateReading]()
    for number, trial in enumerate(trials):
        for reading in trial.readings:
            plates.setdefault(names[number, reading.name], reading)
    sensors = [
        {"name": own, "kind": "force_plate", "parent": "world", "xyz": one.center.tolist(), "foot": one.foot}
        for own, one in plates.items()
    ]
    edge = settling_samples(rate, cutoff_hz) // 2 if cutoff_hz is not None else 0
    parts: list[tuple[dict[str, Any], Role]] = []
    for number, trial in enumerate(trials):
        whole = _trial_channels(trial, number, names, list(plates), edge)
        if len(trials) > 1 or hold_out == 0.0:
            parts.append((whole, "validation" if number and number == len(trials) - 1 else "identification"))
        else:
            first, second = _cut_trial(whole, rate, hold_out, cutoff_hz)
            parts += [(first, "identification"), (second, "validation")]
    logged, headers = [], []
    for number, (part, role) in enumerate(parts):
        file = f"trial_{number:02d}.parquet"
        headers.append(TrialHeader(file=file, role=role))
        logged.append(Trial(**part, name=Path(file).stem, role=role))
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": URDF_FILE,
            "base": "floating",
            "gravity": (0.0, 0.0, -9.81),
            "rate_hz": round(rate, 6),
            "lowpass_hz": cutoff_hz,
            "posture": "computed",
            "joints": JOINT_NAMES,
            "torque": "none",
            "base_link": "pelvis",
            "wrench": "on_robot_in_sensor_frame",
            "sensors": sensors,
            "modelled": ("rigid_body",),
            "trials": headers,
        }
    )
    return Log(header=header, trials=tuple(logged), robot_text=urdf_text(body))


def _sensor_names(trials: Sequence[MeasuredTrial]) -> dict[tuple[int, str], str]:
    """One name for each plate that stands at one place; the same name elsewhere gets the trial's number."""
    places: dict[str, np.ndarray] = {}
    names = {}
    for number, trial in enumerate(trials):
        for reading in trial.readings:
            name = reading.name
            if name in places and np.abs(places[name] - reading.center).max() > 1e-6:
                name = f"{reading.name}_trial_{number}"
            places.setdefault(name, reading.center)
            names[number, reading.name] = name
    return names


def _trial_channels(
    trial: MeasuredTrial, number: int, names: dict[tuple[int, str], str], sensors: list[str], edge: int
) -> dict[str, Any]:
    """Channels of a trial; ``edge`` frames that the filter's transient reaches are left out at either end."""
    pose = trial.poses.pose
    n = len(pose)
    wrenches = {name: np.zeros((n, 6)) for name in sensors}
    for reading in trial.readings:
        wrenches[names[number, reading.name]] = reading.wrench
    whole = {
        "time": np.arange(n) / trial.report.rate_hz + trial.poses.time[0],
        "q": joint_angles(pose),
        "base": base_pose(pose),
        "wrenches": wrenches,
    }
    return _part_of(whole, slice(max(trial.frames.start, edge), min(trial.frames.stop, n - edge)))


def _cut_trial(
    whole: dict[str, Any], rate: float, hold_out: float, cutoff_hz: float | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    filters = ProblemSettings().filters(floating=True, lowpass_hz=cutoff_hz)
    margin = settling_samples(rate, filters.kinematics_cutoff_hz) + settling_samples(rate, filters.cutoff_hz)
    n = len(whole["time"])
    middle = margin + round((1.0 - hold_out) * (n - 2 * margin))
    if n < 3 * margin:
        margin, middle = 0, round((1.0 - hold_out) * n)
    return _part_of(whole, slice(0, middle + margin)), _part_of(whole, slice(middle - margin, n))


def _part_of(whole: dict[str, Any], span: slice) -> dict[str, Any]:
    wrenches = {name: values[span] for name, values in whole["wrenches"].items()}
    return {name: whole[name][span] for name in ("time", "q", "base")} | {"wrenches": wrenches}


# A recording of a person as a trial: postures, plates, and what stood on them.


def measured_trial(
    body: Body, calibration: Calibration, recording: Recording, cutoff_hz: float | None
) -> MeasuredTrial:
    """Postures, plates and spans of a recording; ``cutoff_hz`` of the markers' low-pass, None for none [Hz]."""
    poses = trial_poses(calibration, recording, cutoff_hz)
    placement = place_segments(poses.pose, body.offsets)
    readings, odd = plate_readings(recording, placement, body, cutoff_hz)
    held = find_support(body, placement, readings, recording.rate_hz, recording.source)
    span = held.frames
    report = TrialReport(
        trial=recording.source.stem,
        seconds=(span.stop - span.start) / recording.rate_hz,
        rate_hz=recording.rate_hz,
        plates_kg=held.mass,
        marker_rms_m=dict(poses.marker_rms),
        plates=tuple(StoodOn(r.name, r.foot, r.distance) for r in readings),
    )
    return MeasuredTrial(poses, readings, span, report, (*poses.findings, *odd, *held.findings))
