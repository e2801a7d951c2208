"""The log doctor: faults of a record that are no physics, found before anything is fitted, repaired where sound."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from excite.doctor.doubt import Doubt
from excite.doctor.registry import CHECKS
from excite.errors import IllLogError
from excite.finding import Finding, FindingList, merge_findings, worst_first
from excite.logs.log import Log
from excite.progress import step
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

SCHEMA = "excite.doctor/1"


@dataclass(frozen=True, eq=False, repr=False)
class Chart(FindingList):
    """What the doctor found and made of a log.

    Attributes:
        robot: name of the robot.
        log: the log, repaired where that is sound.
        findings: what was found, worst first.
        doubts: what the log tells only about, repaired or not.
    """

    robot: str
    log: Log
    findings: tuple[Finding, ...]
    doubts: frozenset[Doubt] = frozenset()

    @property
    def usable(self) -> bool:
        """Whether anything can be told from the log."""
        return all(finding.severity != "fatal" or finding.repaired for finding in self.findings)

    def check_usable(self) -> None:
        """Raise IllLogError with the findings, worst first, where no check could save the log."""
        if self.usable:
            return
        worst = [finding for finding in self.findings if finding.severity != "note" and not finding.repaired]
        said = "; ".join(f"{finding.text}: {finding.remedy}" for finding in worst)
        source = None if self.log.folder is None else self.log.folder / "log.yaml"
        raise IllLogError(said, source=source, findings=worst)

    def to_json(self, repaired: Path | None = None) -> dict[str, Any]:
        """The document ``excite.doctor/1``; ``repaired`` is where the repaired log was written."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "healthy": self.healthy,
            "findings": [finding.to_json() for finding in self.findings],
            "repaired": None if repaired is None else str(repaired),
        }

    def summary(self, repaired: Path | None = None) -> str:
        """One finding a paragraph, worst first: what, and what was done or is to be done."""
        if not self.findings:
            return "nothing wrong was found"
        lines = []
        for finding in self.findings:
            state = "repaired" if finding.repaired else finding.severity
            sure = "" if finding.sure == 1.0 else f", {100 * finding.sure:.0f} % sure"
            lines += [f"{finding.kind} ({state}{sure}): {finding.text}", f"    {finding.remedy}"]
        if not self.healthy:
            last = "what is said to be repaired is so for identify and diagnose, too"
            lines.append(last if repaired is None else f"repaired log written to {repaired}")
        return "\n".join(lines)


@one_blas_thread
@step("look the log through")
def examine(robot: Robot, log: Log, settings: ProblemSettings | None = None) -> Chart:
    """Look a log through with every check, one after the other, each on what those before have repaired.

    Args:
        robot: the nominal model.
        log: the log.
        settings: coupling and torque constants that the log does not state; none if None.

    Returns:
        The repaired log and the findings.
    """
    findings: list[Finding] = []
    doubts: set[Doubt] = set()
    if settings is not None:
        log = _as_set(log, settings)
    for check in CHECKS:
        outcome = check.examine(robot, log)
        log = outcome.log
        findings += outcome.findings
        doubts |= outcome.doubts
    return Chart(robot.name, log, worst_first(merge_findings(tuple(findings))), frozenset(doubts))


def _as_set(log: Log, settings: ProblemSettings) -> Log:
    """The log with what the settings say of its drives."""
    constants = {**log.header.torque_constants, **settings.drive_gains}
    coupling = settings.coupling or log.header.coupling
    update = {"torque_constants": constants, "coupling": coupling}
    return replace(log, header=log.header.model_copy(update=update))
