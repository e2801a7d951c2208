"""An identified robot in the format of a simulator: files, proof, and what a person wants to know of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.atomic import all_or_nothing, atomic_path, write_bytes, write_text
from excite.display import Row, Tabled, count
from excite.errors import InputError, NoSolutionError
from excite.export.models.model_format import JOINT_TERMS, SERVO_TERMS, Lost, ModelFormat, Rendered, Subject
from excite.export.models.parameters import (
    ASSUMED,
    Found,
    InconsistentModelError,
    changed_segments,
    find_differences,
    inconsistent_links,
    model_parameters,
    save_differences,
    with_servos,
)
from excite.export.models.subject import COLUMNS, Change, list_changes, subject_of
from excite.export.models.verification import random_states
from excite.export.registry import MODEL_FORMATS
from excite.finding import list_names
from excite.formats.arrays import NpzFormat
from excite.formats.tables import csv_text
from excite.identification.result import Identification
from excite.logs.robot import is_bare
from excite.regressor.columns import PARAMETERS
from excite.results import HIDDEN, FilePath, Name, Positive, Stated, stated, write_json
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot

# What a format has no place for: said beside the files, not left for the simulation to show.

# Terms of drives that no robot model of any simulator here has, and what to do without them.
_NOWHERE = {
    "offset": "no joint has a constant torque, nor Coulomb friction that differs by direction: add it to the command",
    "root": "friction that grows with the square root of speed is in no joint: coulomb and viscous alone are there",
    "joint_viscous": "friction behind a gear that two motors share belongs to no single joint of the model",
    "joint_coulomb": "friction behind a gear that two motors share belongs to no single joint of the model",
    "joint_armature": "inertia behind a gear that two motors share belongs to no single joint of the model",
    "encoder": "an encoder's zero is no part of the robot: correct the readings",
    "bending": "cross-talk of a torque sensor is no part of the robot: correct the readings",
    "gain": "a torque constant that is off is no part of the robot: scale the torques",
    "load_friction": "friction of joints does not grow with the load there: it is too small where the load is large",
}
_BELOW_ZERO = "was found below zero, which no joint can be: what the model had before stands there"


def lost_in(model_format: ModelFormat, subject: Subject) -> tuple[Lost, ...]:
    """All that was found of a robot and that its files in a format do not hold."""
    found: list[Lost] = []
    for name, value in subject.drives.items():
        term, _, joint = name.partition(".")
        if value == 0.0:
            continue
        if term not in JOINT_TERMS:
            found.append(Lost(term, joint, value, _NOWHERE.get(term, "no robot model has it")))
        elif value < 0.0:
            found.append(Lost(term, joint, value, _BELOW_ZERO))
        elif term not in model_format.held:
            found.append(Lost(term, joint, value, model_format.lacks[term]))
    held = model_format.servo(subject)
    for term in SERVO_TERMS:
        if term not in held and term in model_format.lacks and np.isfinite(subject.servo(term)).any():
            late = subject.delay_s if term == "delay" else None
            found.append(Lost(term, "every joint", late, model_format.lacks[term]))
    return (*found, *subject.beyond)


# Proof that files hold what was found: they are read again, and parameters, terms and torques are compared.


@dataclass(frozen=True)
class Proof(Stated):
    """What a reader that shares nothing with the writer found in the files.

    Attributes:
        torque_error: inverse dynamics of the bodies against the regression of what was found, relative to the largest
            torque.
        felt: number of parameters of bodies, joints and servos that were read as they were found.
        unseen: parameters that no torque depends on, such as the mass of a link that turns about a vertical axis.
        not_held: parameters that the format does not have, and that change nothing.
    """

    torque_error: Positive
    felt: int
    unseen: tuple[Name, ...]
    not_held: tuple[Name, ...]


def prove_taken(model_format: ModelFormat, subject: Subject, rendered: Rendered) -> Proof:
    """Read files again and compare them with what they are of.

    Raises:
        NoSolutionError: torques, parameters or terms are others than what was found (a bug here).
    """
    robot, states = subject.robot, random_states(subject.robot, subject.parameters)
    read = model_format.read(subject, rendered, states)
    names = [f"{segment.link}.{name}" for segment in robot.segments for name in PARAMETERS]
    off = np.abs(read.inertial - subject.parameters) > 10.0 * model_format.tolerance * _segment_sizes(subject)
    if not model_format.exact(subject):
        off &= np.repeat((subject.parameters != subject.found.nominal).reshape(-1, 10).any(axis=1), 10)
    wrong, felt = [name for name, is_off in zip(names, off, strict=True) if is_off], len(names)
    for term in (*JOINT_TERMS, *model_format.servo(subject)):
        if term not in model_format.held or term not in read.terms:
            continue
        wanted = subject.servo(term) if term in SERVO_TERMS else subject.term(term)
        known = np.isfinite(wanted)
        room = 4.0 * float(np.finfo(np.float32).eps) * np.abs(wanted)
        apart = known & ~(np.abs(read.terms[term] - wanted) <= room)
        wrong += [f"{term}.{robot.joint_names[k]}" for k in np.flatnonzero(apart)]
        felt += int(known.sum())
    error = states.error(read.torques)
    if wrong or (model_format.exact(subject) and not error <= model_format.tolerance):
        what = (
            f"{list_names(wrong, 6)} {'are' if len(wrong) > 1 else 'is'} not what was found"
            if wrong
            else "the bodies stand elsewhere"
        )
        raise NoSolutionError(
            f"{model_format.name} was not written: read again, {what}, its torques are {error:.1e} off",
            remedy="report this with the robot",
        )
    unseen = np.abs(states.regressor).max(axis=(0, 1)) <= 1e-9
    lacking = [term for term in JOINT_TERMS if term not in model_format.held]
    return Proof(
        error,
        felt - int(unseen.sum()),
        tuple(name for name, is_unseen in zip(names, unseen, strict=True) if is_unseen),
        tuple(f"{term}.{joint}" for term in lacking for joint in robot.joint_names),
    )


def _segment_sizes(subject: Subject) -> Array:
    """Mass, first moment and inertia that a body of each segment's mass and extent has, ``(10·n_segments,)``.

    Infinite of a segment without mass: what moves in a simulator is given a little.
    """
    ten = subject.parameters.reshape(-1, 10)
    mass = np.where(ten[:, 0] == 0.0, np.inf, np.abs(ten[:, 0]))
    length = np.sqrt(np.abs(ten[:, [4, 6, 9]]).max(axis=1) / mass)
    sizes = np.repeat(np.column_stack([np.ones_like(length), length, length**2]), (1, 3, 6), axis=1)
    return np.asarray(np.where(np.isinf(mass)[:, None], np.inf, ten[:, :1] * sizes)).ravel()


CHANGES, LOST, DOCUMENT = "changes.csv", "lost.csv", "model.json"


@dataclass(frozen=True, repr=False)
class SimulatorModel(Tabled, Stated):
    """A robot that was written for a simulator.

    Attributes:
        format: format of the files.
        robot: name of the robot.
        folder: where the files are.
        files: relative to this document's folder; the first is the one to open.
        changes: all parameters of bodies and joints, before and after.
        lost: what was found and is not in the files.
        notes: what a user of the files should know, one sentence each.
        proof: that the files are understood as they are meant.
    """

    SCHEMA = "excite.model/1"

    format: Name
    robot: Name
    folder: Path = field(metadata=HIDDEN)
    files: tuple[FilePath, ...]
    changes: tuple[Change, ...]
    lost: tuple[Lost, ...]
    notes: tuple[str, ...]
    proof: Proof

    tables = ("changes", "lost")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`: all parameters before and after, or what the format has no place for."""
        return [row.row() for row in (self.changes if table == "changes" else self.lost)]

    def summary(self) -> str:
        """What was written, proved and lost, in one line."""
        lost = f", {len(self.lost)} lost" if self.lost else ""
        where = self.folder / self.files[0]
        return f"{self.robot} as {self.format} in {where}: {count(self.proof.felt, 'parameter')} proved{lost}"


def write_simulator_model(
    result: str | Path | Identification,
    format_name: str,
    out: str | Path,
    *,
    robot: str | Robot | None = None,
    template: str | Path | None = None,
) -> SimulatorModel:
    """Write the robot of a result for a simulator, after proving that every parameter arrives there.

    Beside the model stand ``changes.csv``, ``lost.csv`` and ``model.json``; all of them appear together or none.

    Args:
        result: an identification; or what ``excite identify``, ``campaign`` or ``diagnose --apply`` wrote: its folder,
            or the document in it.
        format_name: one of :data:`~excite.export.registry.MODEL_FORMATS`.
        out: folder to write to.
        robot: the robot that the result is of, where the result does not say or it lies elsewhere now.
        template: its MuJoCo model, whose text ``mjcf`` keeps, where the robot is not named by that.

    Returns:
        What was written.

    Raises:
        UnknownNameError: no such format.
        InconsistentModelError: a segment is no rigid body.
        InputError: the result or the robot cannot be read, or the format takes no such robot.
        NoSolutionError: what is read of the files does not follow a parameter (a bug here); nothing is written.
    """
    model_format = MODEL_FORMATS.make(format_name)
    folder = Path(out)
    subject = subject_of(result, folder, robot=robot, template=None if template is None else Path(template))
    bad = inconsistent_links(subject.robot, subject.parameters)
    if bad:
        raise InconsistentModelError(bad, can_be_forced=False)
    rendered = model_format.render(subject)
    proof = prove_taken(model_format, subject, rendered)
    assumed = is_bare(subject.robot) and "kp" in model_format.servo(subject)
    written = SimulatorModel(
        format_name,
        subject.robot.name,
        folder,
        tuple(rendered.files),
        list_changes(subject),
        lost_in(model_format, subject),
        (*rendered.notes, *_describe_off(proof, model_format), *[ASSUMED] * assumed),
        proof,
    )
    with all_or_nothing():
        for name, content in rendered.files.items():
            write_bytes(folder / name, content)
        for name, columns in ((CHANGES, COLUMNS), (LOST, ("parameter", "where", "value", "why"))):
            rows = written.rows(name.removesuffix(".csv"))
            write_text(
                folder / name, csv_text(columns, [[row[column] for column in columns] for row in rows])
            )
        write_json(written.to_json(), folder / DOCUMENT)
    return written


def _describe_off(proof: Proof, model_format: ModelFormat) -> list[str]:
    if proof.torque_error <= model_format.tolerance:
        return []
    return [
        f"its torques are {proof.torque_error:.1e} of the largest off those found: that is what the file has of its"
        " own, such as springs or bodies that were left alone"
    ]


@dataclass(frozen=True)
class WrittenModel(Stated):
    """A model file with identified inertials, and the proof that it is read so.

    Attributes:
        path: the file.
        changed: links (or bodies) whose inertial was changed.
        notes: what a user of the file should know, one sentence each.
        pinocchio_error: largest difference between inverse dynamics of the file read by pinocchio and the
            identified parameters' regression, relative to the largest torque; None where MuJoCo has read it.
        mujoco_error: the same for the file read by MuJoCo.
    """

    path: Path = field(metadata=HIDDEN)
    changed: tuple[str, ...]
    notes: tuple[str, ...]
    pinocchio_error: float | None
    mujoco_error: float | None

    @property
    @stated
    def file(self) -> str:
        """Its name."""
        return self.path.name


def write_urdf(
    robot: Robot, identification: Found, path: Path, *, drives: bool = False, force: bool = False
) -> WrittenModel:
    """Write the robot's URDF with the identified inertials in place of its own.

    The original text is edited: geometry, comments, order and white space stay as they are, ``rpy`` of an
    inertial too (its moments are expressed in that frame), and links whose segment did not change are not
    touched. What pinocchio reads back from the new text has to be the identified parameters and their torques.

    Args:
        robot: the robot that was identified.
        identification: what was identified.
        path: file to write; mesh paths that are relative are made relative to it.
        drives: also write viscous and Coulomb friction that were identified into ``<dynamics>``.
        force: write parameters that no rigid body has, too.

    Returns:
        The file and what was checked.

    Raises:
        InconsistentModelError: a changed segment is no rigid body, and ``force`` is not set.
        InputError: the identification is of another robot, or the URDF has changed since it was loaded.
        NoSolutionError: pinocchio does not read the identified parameters (a bug here).
    """
    found = model_parameters(identification, drives=drives)
    return _write_file("urdf", Subject(robot, found, Path(path).parent, force=force), path)


def write_mjcf(
    robot: Robot, identification: Found, path: Path, *, template: Path | None = None, drives: bool = False
) -> WrittenModel:
    """Write a MuJoCo model with the identified inertials.

    With a template its text is edited: only inertials change (one is added where the template leaves them to
    its geometry). Without one the model is what :func:`~excite.simulation.mjcf.build_spec` makes of the
    robot, all digits written. What MuJoCo then reads has to agree with the identified parameters.

    Args:
        robot: the robot that was identified.
        identification: what was identified.
        path: file to write; mesh paths of a template are made relative to it.
        template: an MJCF file of the same robot.
        drives: also write viscous and Coulomb friction and rotor inertia that were identified.

    Returns:
        The file and what was checked.

    Raises:
        InconsistentModelError: a segment is no rigid body; MuJoCo refuses such models.
        InputError: the identification is of another robot, or the template is another robot's or not there.
        NoSolutionError: MuJoCo does not read the identified parameters (a bug here).
    """
    found = model_parameters(identification, drives=drives)
    made = robot if template is not None else with_servos(robot)
    return _write_file("mjcf", Subject(made, found, Path(path).parent, template), path)


def _write_file(name: str, subject: Subject, path: Path) -> WrittenModel:
    changed_segments(subject.robot, subject.found, force=subject.force)
    model_format = MODEL_FORMATS.make(name)
    rendered = model_format.render(subject)
    proof = prove_taken(model_format, subject, rendered)
    write_bytes(Path(path), rendered.files[rendered.main])
    errors = {"urdf": None, "mjcf": None, name: proof.torque_error}
    notes = (*rendered.notes, *_describe_off(proof, model_format))
    return WrittenModel(Path(path), rendered.changed, notes, errors["urdf"], errors["mjcf"])


# All files of an identified model, as a command leaves them.


@dataclass(frozen=True)
class ModelFiles:
    """The files of an identified model.

    Attributes:
        differences: the table nominal → identified.
        urdf: ``identified.urdf``; None where it was refused.
        mjcf: ``identified.xml``; None where it was refused.
        refused: why models were refused, one sentence each.
        uncertainty: ``uncertainty.npz``, the parameters with their covariance, which ``uncertainty.identified`` of a
            robot.yaml names; None where it was not computed.
    """

    differences: Path
    urdf: WrittenModel | None
    mjcf: WrittenModel | None
    refused: tuple[str, ...]
    uncertainty: Path | None = None

    def to_json(self) -> dict[str, Any]:
        """The block ``models`` of the command's document."""
        return {
            "differences": self.differences.name,
            "urdf": None if self.urdf is None else self.urdf.to_json(),
            "mjcf": None if self.mjcf is None else self.mjcf.to_json(),
            "refused": list(self.refused),
            "uncertainty": None if self.uncertainty is None else self.uncertainty.name,
        }

    def summary(self) -> str:
        """What was written and what was not, a line each."""
        lines = []
        for model in (self.urdf, self.mjcf):
            if model is not None:
                lines.append(
                    f"wrote {model.path.name}: parameters of {count(len(model.changed), 'link')} as identified"
                )
                lines += [f"  {note}" for note in model.notes]
        lines.append(f"wrote {self.differences.name}")
        if self.uncertainty is not None:
            lines.append(
                f"wrote {self.uncertainty.name}: named under uncertainty.identified of robot.yaml, it is what "
                "`excite check` and `plan --robust` keep their margins for"
            )
        return "\n".join([*lines, *(f"not written: {reason}" for reason in self.refused)])


def write_models(
    robot: RobotLike,
    identification: Identification,
    folder: Path,
    *,
    drives: bool = False,
    force: bool = False,
    template: Path | None = None,
) -> ModelFiles:
    """Write ``identified.urdf``, ``identified.xml`` (MJCF), ``differences.csv`` and ``uncertainty.npz`` into a folder.

    Models that no rigid body matches, and those of torques in an unknown unit, are refused, and a file of an earlier
    run under their name removed; the table is written in any case.

    Args:
        robot: the robot that was identified, or its name or file.
        identification: what was identified.
        folder: folder to write to.
        drives: also write the identified friction.
        force: write the URDF of physically inconsistent parameters, too (MuJoCo takes none).
        template: a MuJoCo model of the robot whose text is kept but for its inertials; None makes a plain one.

    Returns:
        The files, and what of the robot changed in them.

    Raises:
        InputError: the identification is of another robot.
    """
    robot, folder = as_robot(robot), Path(folder)
    rows = find_differences(identification.to_json()["standard_parameters"])
    differences = save_differences(rows, folder / "differences.csv")
    refused: list[str] = []
    urdf, mjcf = folder / "identified.urdf", folder / "identified.xml"

    def try_write(path: Path, write: Callable[..., WrittenModel], **options: Any) -> WrittenModel | None:
        try:
            return write(robot, identification, path, drives=drives, **options)
        except InconsistentModelError as error:
            path.unlink(missing_ok=True)
            refused.append(f"{path.name}: {error.what}; {error.remedy}")
        except InputError as error:
            path.unlink(missing_ok=True)
            refused.append(f"{path.name}: {error}")
        return None

    if identification.in_unknown_unit and not force:
        for path in (urdf, mjcf):
            path.unlink(missing_ok=True)
        said = "no model: the torques are in an unknown unit, and so would be its weight"
        return ModelFiles(differences, None, None, (f"{said}; state the unit and identify again",))
    return ModelFiles(
        differences,
        try_write(urdf, write_urdf, force=force),
        try_write(mjcf, write_mjcf, template=template),
        tuple(refused),
        _write_uncertainty(identification, folder / "uncertainty.npz"),
    )


def _write_uncertainty(identification: Identification, path: Path) -> Path | None:
    """Links, inertial parameters and their covariance; None, and no file, where there is none."""
    known, n = identification.uncertainty, len(identification.parameters)
    if known is None or known.covariance is None:
        path.unlink(missing_ok=True)
        return None
    arrays: dict[str, Any] = {
        "links": np.array(identification.links),
        "parameters": identification.parameters,
        "covariance": known.covariance[:n, :n],
    }
    with atomic_path(path) as temporary:
        NpzFormat().write(arrays, temporary)
    return path
