"""What a results folder holds, read and checked for the report."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from excite.documents.document import model_of, read_document
from excite.errors import ExciteError, InputError
from excite.formats.file import MAX_DESCRIPTION_BYTES, check_file
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.registry import Registry
from excite.report.comparisons import Record, ReportData, load_report_data, read_record
from excite.results import Stated
from excite.robot.catalogue import find_robot
from excite.robot.load import load_robot
from excite.robot.robot import Robot

Document = dict[str, Any]

# Documents by the name of their file, each loaded when there is one.
_KINDS: Registry[Any] = Registry(
    "document",
    {
        "plan": "excite.documents.plan:PlanDocument",
        "check": "excite.safety.verdict:CheckReport",
        "identification": "excite.identification.result:Identification",
        "campaign": "excite.documents.campaign:Campaign",
        "diagnosis": "excite.diagnosis.answer.answer:Diagnosis",
        "human": "excite.human.measure:MeasuredPerson",
        "doctor": "excite.finding:Examination",
    },
)
# Commands that write them, where these have another name.
_COMMANDS = {
    "identification": "identify",
    "diagnosis": "diagnose",
}
# A thousand kilometres from the origin, where a picture cannot tell a robot's links apart any more.
_FARTHEST = 1e6
_ABSENT = {
    "plan": "the plan (plan.json: candidates, chosen motions), which excite plan ROBOT --out DIR writes",
    "check": "the independent safety check (check.json), which excite check ROBOT DIR --out DIR writes",
    "identification": "the identification (identification.json), which excite identify ROBOT LOG --out DIR writes",
    "campaign": "the campaign (campaign.json: certainty per iteration), which excite campaign ROBOT --out DIR writes",
}
_HELP = "give a folder that excite plan, check, identify, diagnose, doctor, campaign or human wrote to"
_OF_LOGS = "excite doctor, identify or diagnose make what a page shows of it: give their --out"


@dataclass(frozen=True)
class Origin:
    """How a document came to be.

    Attributes:
        command: that wrote it; empty where it does not say.
        version: of excite.
        seed: of the random numbers.
        written: when the file was written, as its folder says, to the minute (UTC).
    """

    command: str
    version: str
    seed: int | None
    written: str


@dataclass(frozen=True, eq=False)
class Findings:
    """Contents of a results folder.

    Attributes:
        folder: the folder.
        plan: contents of ``plan.json``, None where there is none.
        check: of ``check.json``.
        identification: of ``identification.json``, else the one inside ``campaign.json``.
        campaign: of ``campaign.json``.
        diagnosis: of ``diagnosis.json``, which only ``diagnose`` writes.
        human: of ``human.json``, which only ``human`` writes.
        doctor: of ``doctor.json``.
        data: of ``report_data.npz``; empty where there are none.
        robot: the robot, None where it cannot be found.
        record: the log that the result was made from, None where none is named or it is gone.
        motions: the plan's chosen motions, else those that were checked, as far as they could be read, in order.
        files: names of the files that were read.
        made: by name of a document, the command that wrote it and when.
        left_out: what is not shown, and why.
    """

    folder: Path
    plan: Document | None
    check: Document | None
    identification: Document | None
    campaign: Document | None
    diagnosis: Document | None
    human: Document | None
    doctor: Document | None
    data: ReportData
    robot: Robot | None
    record: Record | None
    motions: tuple[Motion, ...]
    files: tuple[str, ...]
    made: Mapping[str, Origin]
    left_out: tuple[str, ...]


def read_folder(folder: Path) -> Findings:
    """Read everything that a report can show.

    Raises:
        InputError: no such folder, nothing in it to report on, or a file in it that is malformed.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("is no folder", source=folder, remedy=_HELP)
    documents = {name: _folder_document(folder / f"{name}.json") for name in _KINDS}
    files = [f"{name}.json" for name, content in documents.items() if content is not None]
    made = {
        name: _document_origin(folder / f"{name}.json", content)
        for name, content in documents.items()
        if content is not None
    }
    if documents["identification"] is None and documents["campaign"] is not None:
        documents["identification"] = documents["campaign"]["identification"]
    # A diagnosis, or a look through a log, stands by itself: what belongs to excitation is not missed beside it.
    alone = bool(documents["diagnosis"] or documents["doctor"]) and not any(
        documents[name] for name in _ABSENT
    )
    left_out = [] if alone else [text for name, text in _ABSENT.items() if documents[name] is None]
    data, arrays = ReportData(), folder / "report_data.npz"
    if os.path.lexists(arrays):
        data = load_report_data(arrays)
        files.append(arrays.name)
    elif documents["diagnosis"] is not None or not alone:
        what = "measured forces, masses and the conditioning before and after"
        left_out.append(f"{'curves of a trial' if alone else what} ({arrays.name})")
    if not files:
        what, remedy = f"holds none of {', '.join(f'{name}.json' for name in _KINDS)}, report_data.npz", _HELP
        if os.path.lexists(folder / "log.yaml"):
            what, remedy = "is a log, which has no page of its own", _OF_LOGS
        raise InputError(what, source=folder, remedy=remedy)
    record = _folder_record(folder, documents, left_out)
    robot = None if alone else _folder_robot(folder, documents, record, left_out)
    return Findings(
        folder=folder,
        data=data,
        robot=robot,
        record=record,
        motions=_folder_motions(folder, documents, robot, left_out),
        files=tuple(files),
        made=made,
        left_out=tuple(left_out),
        **documents,
    )


def _folder_document(path: Path) -> Document | None:
    """A document with every field, those that the file leaves out with their defaults; None where there is none."""
    if not os.path.lexists(path):
        return None
    kind = _KINDS[path.stem]
    model = model_of(kind) if issubclass(kind, Stated) else kind
    remedy = f"write it again with excite {_COMMANDS.get(path.stem, path.stem)} --out DIR, or take it out of the folder"
    content: Document = read_document(path, model, remedy=remedy).content()
    return content


def _document_origin(path: Path, document: Document) -> Origin:
    made = document["made"] or {"command": "", "version": "", "seed": None}
    written = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    return Origin(**made, written=written.strftime("%Y-%m-%d %H:%M UTC"))


def _folder_robot(
    folder: Path, documents: dict[str, Document | None], record: Record | None, left_out: list[str]
) -> Robot | None:
    """The robot that the documents name, or that of their record; a robot of one's own is named by its file."""
    reasons = []
    for document in filter(None, documents.values()):
        for key in ("robot_file", "robot"):
            name = document.get(key)
            if not name:
                continue
            try:
                path = find_robot(os.path.normpath(folder / name) if key == "robot_file" else name)
                return load_robot(check_file(path, limit=MAX_DESCRIPTION_BYTES))
            except ExciteError as error:
                reasons.append(str(error))
            except OSError as error:
                reasons.append(f"{name[:60]}: cannot be read ({error.strerror})")
    if record is not None:
        return record.robot
    # Of a robot of one's own the file says more than that no bundled robot has its name.
    left_out.append(f"pictures of the robot: {next(iter(reasons), 'no file here names it')}")
    return None


def _folder_record(folder: Path, documents: dict[str, Document | None], left_out: list[str]) -> Record | None:
    """The log of the diagnosis, of the identification, of a person, or the one that was looked through."""
    named = (documents[name] for name in ("diagnosis", "identification", "human", "doctor"))
    document = next(filter(None, named), None)
    record = None if document is None else read_record(folder, document)
    if isinstance(record, str):
        left_out.append(f"the trial in motion: {record}")
        return None
    return record


def _folder_motions(
    folder: Path, documents: dict[str, Document | None], robot: Robot | None, left_out: list[str]
) -> tuple[Motion, ...]:
    """The plan's chosen motions, else those that were checked."""
    plan, check, motions = documents["plan"], documents["check"] or {"motions": ()}, []
    files = (
        [one["file"] for one in check["motions"]]
        if plan is None
        else [one["motion"] for one in plan["selected"]]
    )
    for file in filter(None, files):
        if robot is None:
            break
        try:
            motion = load_motion(folder / file, robot)
        except ExciteError as error:
            left_out.append(f"pictures of motion {file}: {error}")
            continue
        if np.abs(motion.q).max() > _FARTHEST:
            left_out.append(f"pictures of motion {file}: it goes beyond {_FARTHEST:g} rad or m")
            continue
        motions.append(motion)
    return tuple(motions)
