"""What results come to, and the words in which commands take them."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path

from excite.report.folder import Document, Findings
from excite.robot.catalogue import robot_of_log

# Named worst offenders in a sentence.
NAMED = 3


@dataclass(frozen=True)
class Conclusion:
    """What results come to.

    Attributes:
        found: a sentence or two.
        good: whether it is good enough; None where that is for a person to say.
        command: words of the next command, without ``excite``; empty where there is none.
        purpose: what it is for.
    """

    found: str
    good: bool | None
    command: tuple[object, ...] = ()
    purpose: str = ""


def log_words(found: Document, findings: Findings) -> str:
    """The log of a result, as a command takes it."""
    stated = found.get("log_file")
    return os.path.normpath(findings.folder / stated) if stated else "LOG"


def measures_forces(findings: Findings) -> bool:
    """Whether anything can be identified from the log: of a fixed base not from commands alone."""
    header = None if findings.record is None else findings.record.log.header
    return header is None or header.measures_forces


def robot_of_result(found: Document, findings: Findings) -> str:
    """The robot of a log as a command takes it: the file that was given, a bundled name, else the log's own."""
    if found["robot_file"]:
        return os.path.normpath(findings.folder / found["robot_file"])
    name = str(found["robot"] or "ROBOT")
    if findings.record is None:
        return name
    return str(robot_of_log(name, findings.record.log.header.robot, Path(log_words(found, findings))))


def robot_words(findings: Findings) -> str:
    """The robot as a command takes it."""
    for document in filter(None, (findings.plan, findings.identification, findings.check, findings.refusals)):
        if document.get("robot_file"):
            return os.path.normpath(findings.folder / document["robot_file"])
    return robot_name(findings)


def robot_name(findings: Findings) -> str:
    """The robot's name."""
    documents = (
        findings.plan,
        findings.identification,
        findings.campaign,
        findings.check,
        findings.refusals,
        findings.doctor,
    )
    return next((str(d["robot"]) for d in documents if d and d.get("robot")), "ROBOT")


def begun_with(findings: Findings, document: str, *without: str) -> list[str]:
    """The words that a document was made with, less ``excite`` and some options with a value; none where not known."""
    made = findings.made.get(document)
    words = shlex.split(made.command)[1:] if made is not None and made.command else []
    for option in without:
        while option in words:
            at = words.index(option)
            del words[at : at + 2]
    return words
