"""What a folder's results come to: what was found, whether it is good enough, and the command to go on with."""

from __future__ import annotations

from excite.report.conclusions.campaigned import of_campaign
from excite.report.conclusions.diagnosed import of_diagnosis
from excite.report.conclusions.doctored import of_doctor
from excite.report.conclusions.identified import of_identification
from excite.report.conclusions.measured import of_person
from excite.report.conclusions.planned import of_check, of_plan, of_refusals
from excite.report.conclusions.result import Conclusion
from excite.report.folder import Findings


def draw_conclusion(findings: Findings) -> Conclusion | None:
    """Of the last step that the folder holds: what came before it is in the sections below."""
    if findings.diagnosis is not None:
        return of_diagnosis(findings.diagnosis, findings)
    if findings.campaign is not None and (findings.campaign["iterations"] or findings.campaign["awaits"]):
        return of_campaign(findings.campaign, findings)
    if findings.identification is not None:
        return of_identification(findings.identification, findings)
    if findings.plan is not None:
        return of_plan(findings.plan, findings)
    if findings.check is not None:
        return of_check(findings.check, findings)
    if findings.refusals is not None:
        return of_refusals(findings.refusals, findings)
    if findings.human is not None:
        return of_person(findings.human, findings)
    if findings.doctor is not None:
        return of_doctor(findings.doctor, findings)
    return None
