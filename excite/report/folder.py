"""What a results folder holds, read and checked for the report."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.errors import ExciteError, InputError
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.report.data import ReportData, load_report_data
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

Document = dict[str, Any]

_SCHEMAS = {
    "plan": "excite.plan/1",
    "check": "excite.check/1",
    "identification": "excite.identification/1",
    "campaign": "excite.campaign/1",
    "signals": "excite.signals/1",
    "diagnosis": "excite.diagnosis/1",
}
_ABSENT = {
    "plan": "the plan (plan.json: candidates, chosen motions)",
    "check": "the independent safety check (check.json)",
    "identification": "the identification (identification.json)",
    "campaign": "the campaign (campaign.json: certainty per iteration)",
}


@dataclass(frozen=True, eq=False)
class Findings:
    """Contents of a results folder.

    Attributes:
        folder: the folder.
        plan: contents of ``plan.json``, None where there is none.
        check: of ``check.json``.
        identification: of ``identification.json``, else the one inside ``campaign.json``.
        campaign: of ``campaign.json``.
        signals: of ``signals.json``, which only ``identify --explain-signals`` writes.
        diagnosis: of ``diagnosis.json``, which only ``diagnose`` writes.
        data: of ``report_data.npz``; empty where there is none.
        robot: the robot, None where it cannot be found.
        motions: the plan's chosen motions that could be read, in the plan's order.
        files: names of the files that were read.
        left_out: what is not shown, and why.
    """

    folder: Path
    plan: Document | None
    check: Document | None
    identification: Document | None
    campaign: Document | None
    signals: Document | None
    diagnosis: Document | None
    data: ReportData
    robot: Robot | None
    motions: tuple[Motion, ...]
    files: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def of_diagnosis(self) -> bool:
        """Whether a diagnosis is all that the folder holds."""
        return self.diagnosis is not None and not (
            self.plan or self.check or self.identification or self.campaign
        )


def read_folder(folder: Path) -> Findings:
    """Read everything that a report can show.

    Raises:
        InputError: no such folder, nothing in it to report on, or a file in it that is malformed.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("is no folder", source=folder, remedy="give the --out folder of another command")
    documents = {name: _read_json(folder / f"{name}.json", schema) for name, schema in _SCHEMAS.items()}
    arrays = folder / "report_data.npz"
    files = [f"{name}.json" for name, content in documents.items() if content is not None]
    if documents["identification"] is None and documents["campaign"] is not None:
        documents["identification"] = documents["campaign"].get("identification")
    # A diagnosis stands by itself: what belongs to excitation and identification is not missed beside it.
    alone = documents["diagnosis"] is not None and not any(documents[name] for name in _ABSENT)
    left_out = [
        _ABSENT[name] for name in documents if documents[name] is None and name in _ABSENT and not alone
    ]
    if arrays.is_file():
        data = load_report_data(arrays)
        files.append(arrays.name)
    else:
        data = ReportData()
        what = (
            "curves of a trial" if alone else "measured forces, masses and the conditioning before and after"
        )
        left_out.append(f"{what} (report_data.npz)")
    if not files:
        raise InputError(
            "holds none of plan.json, check.json, identification.json, campaign.json, diagnosis.json, report_data.npz",
            source=folder,
            remedy="give the --out folder of another command",
        )
    robot = None if alone else _robot(folder, documents, left_out)
    return Findings(
        folder=folder,
        data=data,
        robot=robot,
        motions=_motions(folder, documents["plan"], robot, left_out),
        files=tuple(files),
        left_out=tuple(left_out),
        **documents,
    )


def _read_json(path: Path, schema: str) -> Document | None:
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"is no JSON ({error})", source=path, remedy="write it again") from error
    found = content.get("schema") if isinstance(content, dict) else None
    if found != schema:
        raise InputError(
            f"schema is {found!r}, not {schema!r}", source=path, field="schema", remedy="write it again"
        )
    return content


def _robot(folder: Path, documents: dict[str, Document | None], left_out: list[str]) -> Robot | None:
    """The robot that the documents name; a robot of one's own is named by its file."""
    names = [
        folder / document[key] if key == "robot_file" else document[key]
        for document in documents.values()
        if document
        for key in ("robot_file", "robot")
        if key in document
    ]
    reason = "no file here names it"
    for name in names:
        try:
            return load_robot(name)
        except ExciteError as error:
            reason = str(error)
    left_out.append(f"pictures of the robot: {reason}")
    return None


def _motions(
    folder: Path, plan: Document | None, robot: Robot | None, left_out: list[str]
) -> tuple[Motion, ...]:
    if plan is None or robot is None:
        return ()
    motions = []
    for entry in plan.get("selected", ()):
        try:
            motions.append(load_motion(folder / entry["motion"], robot))
        except ExciteError as error:
            left_out.append(f"pictures of motion {entry['motion']}: {error}")
    return tuple(motions)
