"""An identified robot in the format of a simulator: files, proof, and what a person wants to know of them."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from excite.atomic import all_or_nothing, write_bytes, write_text
from excite.export.models.bodies import InconsistentModelError
from excite.export.models.servos import ASSUMED
from excite.export.simulators.comparison import Change, changes_csv, list_changes
from excite.export.simulators.lost import lost_in
from excite.export.simulators.model_format import ModelFormat
from excite.export.simulators.proof import Proof, prove_taken
from excite.export.simulators.registry import MODEL_FORMATS
from excite.export.simulators.result import subject_of
from excite.export.simulators.subject import Lost, Subject
from excite.identification.result import Identification
from excite.json_document import write_json
from excite.logs.bare_urdf import is_bare
from excite.robot.robot import Robot
from excite.shown import Row, Tabled, count

SCHEMA = "excite.model/1"
CHANGES, LOST, DOCUMENT = "changes.csv", "lost.csv", "model.json"


@dataclass(frozen=True, repr=False)
class SimulatorModel(Tabled):
    """A robot that was written for a simulator.

    Attributes:
        format: name of the format.
        robot: name of the robot.
        folder: where the files are.
        files: their names, the one that a simulator opens first.
        changes: all parameters, before and after.
        lost: what the format has no place for.
        notes: what a user of the files should know, one sentence each.
        proof: that what is read again follows every parameter.
    """

    format: str
    robot: str
    folder: Path
    files: tuple[str, ...]
    changes: tuple[Change, ...]
    lost: tuple[Lost, ...]
    notes: tuple[str, ...]
    proof: Proof

    tables = ("changes", "lost")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.shown.Tabled`: all parameters before and after, or what the format has no place for."""
        if table == "changes":
            return [row.to_json() for row in self.changes]
        return [asdict(item) for item in self.lost]

    def summary(self) -> str:
        """What was written, proved and lost, in one line."""
        lost = f", {len(self.lost)} lost" if self.lost else ""
        where = self.folder / self.files[0]
        return f"{self.robot} as {self.format} in {where}: {count(self.proof.felt, 'parameter')} proved{lost}"

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.model/1``; names of files are relative to the folder."""
        return {
            "schema": SCHEMA,
            "format": self.format,
            "robot": self.robot,
            "files": list(self.files),
            "changes": [row.to_json() for row in self.changes],
            "lost": [
                {"parameter": item.parameter, "where": item.where, "value": item.value, "why": item.why}
                for item in self.lost
            ],
            "notes": list(self.notes),
            "proof": {
                "torque_error": self.proof.error,
                "felt": self.proof.felt,
                "unseen": list(self.proof.unseen),
                "not_held": list(self.proof.not_held),
            },
        }


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
        format_name: one of :data:`~excite.export.simulators.registry.MODEL_FORMATS`.
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
        write_text(folder / CHANGES, changes_csv(written.changes))
        write_text(folder / LOST, _lost_csv(written.lost))
        write_json(written.to_json(), folder / DOCUMENT)
    return written


def _servo_lines(model_format: ModelFormat, subject: Subject) -> list[str]:
    return [ASSUMED] if is_bare(subject.robot) and "kp" in model_format.servo(subject) else []


def _describe_off(proof: Proof, tolerance: float) -> list[str]:
    if proof.error <= tolerance:
        return []
    return [
        f"its torques are {proof.error:.1e} of the largest off those found: that is what the file has of its own,"
        " such as springs or bodies that were left alone"
    ]


def _lost_csv(lost: tuple[Lost, ...]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["parameter", "where", "value", "why"])
    for item in lost:
        writer.writerow(
            [item.parameter, item.where, "" if item.value is None else repr(item.value), item.why]
        )
    return stream.getvalue()
