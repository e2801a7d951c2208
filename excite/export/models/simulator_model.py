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
from excite.export.models.mjcf import write_mjcf
from excite.export.models.model_format import (
    JOINT_TERMS,
    SERVO_TERMS,
    LoadedModel,
    Lost,
    ModelFormat,
    Subject,
    with_friction,
)
from excite.export.models.parameters import ASSUMED, InconsistentModelError, find_differences
from excite.export.models.subject import COLUMNS, Change, list_changes, subject_of
from excite.export.models.urdf import write_urdf
from excite.export.models.verification import States, WrittenModel, random_states
from excite.export.registry import MODEL_FORMATS
from excite.formats.tables import csv_text
from excite.identification.result import Identification
from excite.logs.robot import is_bare
from excite.regressor.columns import PARAMETERS
from excite.regressor.kernels import joint_torque_regressor
from excite.results import HIDDEN, FilePath, Name, Positive, Stated, write_json
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


# Proof that what is read of the files hears every parameter: all are changed at once, and torques have to follow.
#
# Torques are linear in the parameters, so what a change does is known beforehand: of ten parameters by the regressor,
# of a joint's friction and rotor inertia by its velocity and acceleration. What a servo is told (gains, limits, a
# delay) shows in no torque of the bodies: it is read back by itself. All bodies get a small body more, and that body is
# changed, so that what is written is always a body; its size is such that each part of it moves the torques well above
# their rounding.

# Torque of the added bodies, as share of the largest: large enough to be seen above rounding of single precision, and
# small enough that nothing of the model is lost in it.
_SHARE = 0.2
# Share of a change by which it may be missed.
_MISSED = 0.01
# A parameter whose whole torque is below this many times the format's rounding is not seen, in any format.
_ABOVE_ROUNDING = 200.0


@dataclass(frozen=True)
class Proof(Stated):
    """What became of the torques, read from the files, when the parameters were changed.

    Attributes:
        torque_error: of the files, against what was found, relative to the largest torque.
        felt: number of parameters whose change the torques, or a servo's settings, followed.
        unseen: parameters that no torque depends on, such as the mass of a link that turns about a vertical axis.
        not_held: parameters that the format does not have, and that change nothing.
    """

    torque_error: Positive
    felt: int
    unseen: tuple[Name, ...]
    not_held: tuple[Name, ...]


def prove_taken(model_format: ModelFormat, subject: Subject) -> Proof:
    """Render and read again, as it is and with every parameter changed.

    Args:
        model_format: the format.
        subject: what is to be written.

    Raises:
        InputError: the format takes no such robot.
        NoSolutionError: the torques are not those that were found, or do not follow a change (a bug here).
    """
    states = random_states(subject.robot, subject.parameters)

    def load(changed: Subject) -> LoadedModel:
        return model_format.load(changed, model_format.render(changed), states)

    own = load(subject)
    error = _torque_error(subject, own, states)
    if not error <= model_format.tolerance and model_format.exact(subject):
        raise NoSolutionError(
            f"{model_format.name} was not written: read again, its torques are {error:.1e} off",
            remedy="report this with the robot",
        )
    largest = max(float(np.abs(own.torques).max()), 1e-9)
    change = _changes(subject, states, largest)
    servos = {term: _told(model_format, subject, term) for term in model_format.servo(subject)}
    before = load(change.before)
    after = load(change.after.varied(servo_values={**subject.servo_values, **servos}))
    missed = change.missed(model_format, after.torques - before.torques)
    deaf = [name for name, share in missed.items() if share > _MISSED]
    known = {term: [*zip(subject.robot.joint_names, subject.servo(term), strict=True)] for term in servos}
    for term, told in servos.items():
        off = np.maximum(
            _servo_error(model_format, term, own.terms[term], subject.servo(term), 0.0),
            _servo_error(model_format, term, after.terms[term], told, told - subject.servo(term)),
        )
        deaf += [
            f"{term}.{name}" for (name, v), far in zip(known[term], off, strict=True) if v == v and far > 0
        ]
    if deaf:
        shown = ", ".join(deaf[:6]) + (f" and {len(deaf) - 6} more" if len(deaf) > 6 else "")
        raise NoSolutionError(
            f"{model_format.name} was not written: its torques do not follow {shown}",
            remedy="report this with the robot",
        )
    floor = _ABOVE_ROUNDING * model_format.tolerance * largest
    seen = zip(change.names, change.sizes, strict=True)
    unseen = tuple(name for name, size in seen if size <= floor and name not in change.drives)
    not_held = tuple(name for name in change.names if not change.is_held(name, model_format))
    told_joints = sum(v == v for values in known.values() for _, v in values)
    return Proof(error, len(change.names) - len(unseen) - len(not_held) + told_joints, unseen, not_held)


def _torque_error(subject: Subject, own: LoadedModel, states: States) -> float:
    """Relative error of the torques as read, against the found parameters; what was not found is the file's."""
    drives = {}
    for term, value in own.joint_terms.items():
        found = subject.term(term)
        drives[term] = np.where(np.isfinite(found), found, value)
    wanted = with_friction(subject.robot, states.torque, states, drives)
    return float(np.abs(own.torques - wanted).max() / max(float(np.abs(wanted).max()), 1e-9))


@dataclass(frozen=True, eq=False)
class _Changes:
    """Changes of all parameters of bodies and joints, and the torques that they are.

    Attributes:
        before: the robot with a small body more in each of its own.
        after: the same, changed.
        drives: names of the joints' terms among ``names``.
        names: of the parameters, bodies' first.
        torques: ``(n·nv, n_parameters)`` torque of each change.
        sizes: ``(n_parameters,)`` largest torque of each one's whole.
    """

    before: Subject
    after: Subject
    drives: frozenset[str]
    names: tuple[str, ...]
    torques: Array
    sizes: Array

    def missed(self, model_format: ModelFormat, found: Array) -> dict[str, float]:
        """By parameter, worst first, the share of its change that torques ``(n, nv)`` have not followed."""
        held = np.array([self.is_held(name, model_format) for name in self.names])
        left = found.ravel() - self.torques[:, held].sum(axis=1)
        room = 0.1 * _ABOVE_ROUNDING * model_format.tolerance * float(np.abs(self.torques).max(axis=0).sum())
        if np.abs(left).max() <= room:
            return {}
        shares = np.abs(np.linalg.lstsq(self.torques, left, rcond=1e-9)[0])
        return {self.names[k]: float(shares[k]) for k in np.argsort(-shares)}

    def is_held(self, name: str, model_format: ModelFormat) -> bool:
        """Whether a format has a parameter."""
        return name not in self.drives or name.partition(".")[0] in model_format.held


def _changes(subject: Subject, states: States, largest: float) -> _Changes:
    """Changes whose torques are a share of the ``largest``; joints' terms that were not found start at the nominal."""
    robot, rng = subject.robot, np.random.default_rng(11)
    n, ten = len(robot.segments), subject.parameters.reshape(-1, 10)
    columns = joint_torque_regressor(robot.model, states.q, states.v, states.a)
    heavy = ten[:, 0] > 0.0
    # Of a body that has none of its own: 0.1 m.
    length = np.full(n, 0.1)
    spread = np.abs(ten[:, [4, 6, 9]]).max(axis=1)
    length[heavy] = np.clip(np.sqrt(spread[heavy] / ten[heavy, 0]), 1e-3, 1.0)
    body = np.zeros((n, 10))
    body[:, 0] = 1.0
    body[:, [4, 6, 9]] = 2.0 * (length**2)[:, None]
    # Half of what would leave its pseudo-inertia, diag(l², l², l², 1), singular; a fifth of that of all ten together.
    whole = 0.5 * np.column_stack([np.ones(n), *[length] * 3, *[length**2] * 6])
    parts = columns.reshape(*columns.shape[:2], n, 10)
    effect = np.abs(np.einsum("srnk,nk->srn", parts, body)).max(axis=(0, 1))
    size = _SHARE * largest / np.maximum(effect, 1e-3 * max(float(effect.max()), 1e-12))
    whole *= size[:, None]
    step = whole * rng.uniform(0.15, 0.25, whole.shape) * rng.choice([-1.0, 1.0], whole.shape)
    names = [f"{segment.link}.{name}" for segment in robot.segments for name in PARAMETERS]
    torques = [(columns * step.ravel()).reshape(-1, 10 * n)]
    sizes, ends = [np.abs(columns * whole.ravel()).max(axis=(0, 1))], (dict[str, float](), dict[str, float]())
    for term in JOINT_TERMS:
        more = _SHARE * largest * rng.uniform(0.5, 1.0, robot.n_joints)
        for end, values in zip(ends, (subject.written(term), subject.written(term) + more), strict=True):
            end |= {f"{term}.{joint}": float(v) for joint, v in zip(robot.joint_names, values, strict=True)}
        nothing = np.zeros_like(states.torque)
        each = [with_friction(robot, nothing, states, {term: row}).ravel() for row in np.diag(more)]
        torques.append(np.column_stack(each))
        sizes.append(np.abs(torques[-1]).max(axis=0))
    # What is written as a whole is read once; changes are of what torques depend on.
    start, alone = subject.parameters + (body * size[:, None]).ravel(), subject.varied(shapes=False)
    return _Changes(
        alone.but(start, ends[0]),
        alone.but(start + step.ravel(), ends[1]),
        frozenset(ends[1]),
        (*names, *ends[1]),
        np.hstack(torques),
        np.concatenate(sizes),
    )


def _told(model_format: ModelFormat, subject: Subject, term: str) -> Array:
    """What joints' servos are told instead; all joints have one delay, and a change of it is several steps."""
    own = subject.servo(term)
    if term == "delay":
        return own + 10.0 * max(model_format.delay_step_s, 1e-3)
    return own * np.random.default_rng(11).uniform(1.2, 1.5, len(own))


def _servo_error(
    model_format: ModelFormat, term: str, seen: Array, told: Array, change: Array | float
) -> Array:
    """How far a term that is read is off what servos were told, beyond what may be missed of a change."""
    room = 0.5 * model_format.delay_step_s if term == "delay" else 0.0
    rounding = 4.0 * float(np.finfo(np.float32).eps) * np.abs(told)
    return np.asarray(np.abs(seen - told) - room - _MISSED * np.abs(change) - rounding)


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
    bad = subject.inconsistent()
    if bad:
        raise InconsistentModelError(bad, can_be_forced=False)
    rendered = model_format.render(subject)
    proof = prove_taken(model_format, subject)
    written = SimulatorModel(
        format_name,
        subject.robot.name,
        folder,
        tuple(rendered.files),
        list_changes(subject),
        lost_in(model_format, subject),
        (
            *rendered.notes,
            *_describe_off(proof, model_format.tolerance),
            *_servo_lines(model_format, subject),
        ),
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


def _servo_lines(model_format: ModelFormat, subject: Subject) -> list[str]:
    return [ASSUMED] if is_bare(subject.robot) and "kp" in model_format.servo(subject) else []


def _describe_off(proof: Proof, tolerance: float) -> list[str]:
    if proof.torque_error <= tolerance:
        return []
    return [
        f"its torques are {proof.torque_error:.1e} of the largest off those found: that is what the file has of its"
        " own, such as springs or bodies that were left alone"
    ]


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
    differences = rows.save(folder / "differences.csv")
    refused: list[str] = []
    urdf, mjcf = folder / "identified.urdf", folder / "identified.xml"

    def attempt(path: Path, write: Callable[..., WrittenModel], **options: Any) -> WrittenModel | None:
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
        attempt(urdf, write_urdf, force=force),
        attempt(mjcf, write_mjcf, template=template),
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
        np.savez_compressed(temporary, **arrays)
    return path
