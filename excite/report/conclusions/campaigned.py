"""What a campaign comes to."""

from __future__ import annotations

import os
from pathlib import Path

from excite.report.conclusions.identified import model_command, of_identification
from excite.report.conclusions.result import NAMED, Conclusion, begun_with, robot_words
from excite.report.folder import Document, Findings
from excite.shown import count


def of_campaign(campaign: Document, findings: Findings) -> Conclusion:
    """Of ``campaign.json``."""
    if not campaign["iterations"]:
        return _awaiting_conclusion("Nothing is recorded yet, and so nothing is known", campaign, findings)
    last = campaign["iterations"][-1]
    judged, missed = {*last["rsd_percent"], *last["not_met"]}, last["not_met"]
    target, motions = (
        campaign["target_rsd_percent"],
        sum(step["n_motions"] for step in campaign["iterations"]),
    )
    wanted = "their target" if target is None else f"{target:g} %"
    done = f"{count(len(campaign['iterations']), 'iteration')} and {count(motions, 'motion')}"
    found = (
        f"After {done}{_judging_sentence(motions, findings)}, "
        f"{len(judged) - len(missed)} of {len(judged)} parameters are known to within {wanted}"
    )
    if campaign["awaits"]:
        return _awaiting_conclusion(found, campaign, findings)
    if campaign["targets_met"]:
        return Conclusion(f"{found}: the targets are met.", True, *model_command(findings))
    worst = ", ".join(missed[:NAMED]) + (f" and {len(missed) - NAMED} more" if len(missed) > NAMED else "")
    if last["helped"] == []:
        said = f"{found}; not enough for {worst}, and more motion would help none of them, see Certainty for why."
        identified = findings.identification
        onward = None if identified is None else of_identification(identified, findings)
        return (
            Conclusion(said, False)
            if onward is None
            else Conclusion(said, False, onward.command, onward.purpose)
        )
    some = last["helped"] is not None and len(last["helped"]) < len(missed)
    those = f"; more motion may help {len(last['helped'])} of them" if some else ""
    return Conclusion(
        f"{found}; not enough for {worst}{those}, see Certainty for why.",
        False,
        _resume_command(findings, "--max-iterations", 2 * len(campaign["iterations"])),
        "go on with more motions",
    )


def _awaiting_conclusion(found: str, campaign: Document, findings: Findings) -> Conclusion:
    """Of a campaign that was stopped for its motions to be recorded."""
    log = Path(campaign["awaits"])
    iteration = os.path.normpath(findings.folder / log.parent.name)
    return Conclusion(
        f"{found}; motions are planned in {iteration}, whose report shows them, and their log is awaited in "
        f"{iteration}/{log.name}.",
        None,
        ("capture", robot_words(findings), iteration),
        "the sheet for recording them; when the log is there, the campaign goes on with --resume",
    )


def _judging_sentence(motions: int, findings: Findings) -> str:
    """How many of the motions were chosen to identify from, where others judge."""
    chosen = len(findings.plan["selected"]) if findings.plan is not None else motions
    return f" ({chosen} to identify from, {motions - chosen} to judge by)" if 0 < chosen < motions else ""


def _resume_command(findings: Findings, *options: object) -> tuple[object, ...]:
    """The command that goes on with it: a campaign is resumed with the options that it was begun with."""
    begun = begun_with(findings, "campaign", "--max-iterations") or ["campaign", robot_words(findings)]
    words = [word for word in begun if word not in {"--resume", *options}]
    return (*words, *options, "--resume", "--out", findings.folder)
