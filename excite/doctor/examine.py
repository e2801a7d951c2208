"""The log doctor: faults of a record that are no physics, found before anything is fitted, repaired where sound."""

from __future__ import annotations

from dataclasses import dataclass, replace

from excite.doctor.registry import CHECKS
from excite.errors import IllLogError
from excite.finding import Finding, worst_first
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread


@dataclass(frozen=True, eq=False)
class Chart:
    """What the doctor found and made of a log.

    Attributes:
        log: the log, repaired where that is sound.
        findings: what was found, worst first.
        imitated: effects of a diagnosis that a fault, repaired or not, could still be taken for.
    """

    log: Log
    findings: tuple[Finding, ...]
    imitated: tuple[str, ...] = ()

    @property
    def healthy(self) -> bool:
        """Whether nothing was found that spoils results."""
        return all(finding.severity in {"note", "limits"} for finding in self.findings)

    def check_usable(self) -> None:
        """Raise IllLogError with the findings, worst first, where no check could save the log."""
        lost = [finding for finding in self.findings if finding.severity == "fatal" and not finding.repaired]
        if not lost:
            return
        others = [f for f in self.findings if f not in lost and f.severity != "note" and not f.repaired]
        said = "; ".join(f.text for f in (*lost, *others))
        source = None if self.log.folder is None else self.log.folder / "log.yaml"
        raise IllLogError(said, source=source, remedy=lost[0].remedy or None, findings=(*lost, *others))


@one_blas_thread
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
    imitated: list[str] = []
    if settings is not None:
        log = _as_set(log, settings)
    for check in CHECKS:
        outcome = check.examine(robot, log)
        log = outcome.log
        findings += outcome.findings
        imitated += outcome.imitated
    return Chart(log, worst_first(tuple(findings)), tuple(dict.fromkeys(imitated)))


def _as_set(log: Log, settings: ProblemSettings) -> Log:
    """The log with what the settings say of its drives."""
    constants = {**log.header.torque_constants, **settings.drive_gains}
    coupling = settings.coupling or log.header.coupling
    update = {"torque_constants": constants, "coupling": coupling}
    return replace(log, header=log.header.model_copy(update=update))
