"""What a folder's results come to: what was found, whether it is good enough, and the command to go on with."""

from __future__ import annotations

import os
from dataclasses import dataclass
from statistics import median

from excite.identification.judgement.poor import POOR_RSD
from excite.report.doubt import doubt
from excite.report.folder import Document, Findings
from excite.report.html import number

VERDICTS = {
    "effect": "an effect is named and placed",
    "ambiguous": "several effects explain it alike",
    "unknown": "no effect of the library explains it",
    "none": "nothing stands above the noise",
}
# Named worst offenders in a sentence.
_NAMED = 3


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


def conclusion(findings: Findings) -> Conclusion | None:
    """Of the last step that the folder holds: what came before it is in the sections below."""
    if findings.diagnosis is not None:
        return _of_diagnosis(findings.diagnosis, findings)
    if findings.campaign is not None and findings.campaign["iterations"]:
        return _of_campaign(findings.campaign, findings)
    if findings.identification is not None:
        return _of_identification(findings.identification, findings)
    if findings.plan is not None:
        return _of_plan(findings.plan, findings)
    if findings.check is not None:
        return _of_check(findings.check, findings)
    if findings.refusals is not None:
        return _of_refusals(findings.refusals, findings)
    return None


def _of_diagnosis(found: Document, findings: Findings) -> Conclusion:
    sentence = found["sentence"] or f"{found['robot'] or 'a robot'}: {VERDICTS[found['verdict']]}."
    verdict, following = found["verdict"], found["next_experiment"]
    if verdict == "none":
        return Conclusion(sentence + " The model is good enough for what this record shows.", True)
    if verdict == "effect":
        purpose = "write the effects into the robot, then see what is left"
        return Conclusion(
            sentence,
            None,
            ("diagnose", _log(found, findings), "--apply", "better", "--out", "first"),
            purpose,
        )
    if following is not None and following["motion"]:
        sentence += " One more experiment would tell."
        return Conclusion(
            sentence, False, ("export", following["motion"], "--format", "csv"), following["why"]
        )
    if following is None:
        purpose = "see whether the record is at fault; an effect of one's own can be added to the library"
        return Conclusion(sentence, False, ("doctor", _log(found, findings)), purpose)
    return Conclusion(sentence, False, purpose=following["why"])


def _log(found: Document, findings: Findings) -> str:
    """The log of a result, as a command takes it."""
    stated = found.get("log_file")
    return os.path.normpath(findings.folder / stated) if stated else "LOG"


def _of_campaign(campaign: Document, findings: Findings) -> Conclusion:
    last = campaign["iterations"][-1]
    judged, missed = {*last["rsd_percent"], *last["not_met"]}, last["not_met"]
    target, motions = (
        campaign["target_rsd_percent"],
        sum(step["n_motions"] for step in campaign["iterations"]),
    )
    wanted = "their target" if target is None else f"{number(target)} %"
    found = (
        f"After {_count(len(campaign['iterations']), 'iteration')} and {_count(motions, 'motion')}, "
        f"{len(judged) - len(missed)} of {len(judged)} parameters are known to within {wanted}"
    )
    if campaign["awaits"]:
        return Conclusion(
            f"{found}; it waits for a recording in {campaign['awaits']}.",
            None,
            ("campaign", _robot(findings), "--on-robot", "--resume", "--out", findings.folder),
            "go on when the log is there",
        )
    if campaign["targets_met"]:
        return Conclusion(f"{found}: the targets are met.", True, *_take(findings))
    worst = ", ".join(missed[:_NAMED]) + (f" and {len(missed) - _NAMED} more" if len(missed) > _NAMED else "")
    return Conclusion(
        f"{found}; not enough for {worst}, see Certainty for why.",
        False,
        ("campaign", _robot(findings), "--resume", "--out", findings.folder),
        "go on with more motions",
    )


def _of_identification(found: Document, findings: Findings) -> Conclusion:
    base = found["base_parameters"]
    known = f"{len(base)} base parameters were identified from {found['n_samples']} samples"
    judged = [r for r in found["validation"].values() if r["reference_rmse"] and r["rmse"] is not None]
    if not judged:
        return Conclusion(
            f"{known}; no trial was left out to judge them, so nobody knows how good they are.",
            None,
            ("identify", _robot(findings), _log(found, findings), "--out", findings.folder),
            "again, with a trial of the role validation in log.yaml",
        )
    better = sum(row["rmse"] < row["reference_rmse"] for row in judged)
    change = median(row["rmse"] / row["reference_rmse"] for row in judged) - 1.0
    predicted = (
        f"on trials that they were not fitted to, {better} of {len(judged)} channels are predicted better than by the "
        f"nominal model (error {100.0 * change:+.0f} %, median channel)".replace("-", "−")
    )
    if better < len(judged) or not found["solved"]:
        solved = "" if found["solved"] else ", and the solver did not end well"
        return Conclusion(
            f"{known}, but {predicted}{solved}: not to be used before that is understood.",
            False,
            ("doctor", _log(found, findings)),
            "see what is wrong with the record",
        )
    rsd = [row["rsd_percent"] for row in base]
    vague = sum(value is None or value > POOR_RSD for value in rsd)
    single = f"{vague} of {len(rsd)} parameters by themselves are not known to within {POOR_RSD:.0f} %"
    said = f"{known}; {predicted}"
    why = doubt(found, len(judged))
    if why:
        command = ("diagnose", _log(found, findings), "--out", "diagnosis")
        return Conclusion(f"{said}, but {why}.", False, command, "see what the model lacks")
    single = f", though {single}" if vague else ""
    return Conclusion(f"{said}: good enough to predict motions like these{single}.", True, *_take(findings))


def _take(findings: Findings) -> tuple[tuple[object, ...], str]:
    command = ("model", findings.folder, "--format", "mjcf", "--out", f"{_name(findings)}_mujoco")
    return command, "take the identified robot into a simulator"


def _of_plan(plan: Document, findings: Findings) -> Conclusion:
    chosen, candidates, forecast = plan["selected"], plan["candidates"], plan["forecast"]
    if not chosen:
        return _of_refusals({**plan, "generated": candidates["generated"]}, findings)
    seconds = sum(entry["duration_s"] for entry in chosen)
    found = (
        f"{_count(len(chosen), 'motion')} of {seconds:.0f} s in all, chosen from {candidates['accepted']} safe ones "
        f"of {_count(candidates['generated'], 'candidate')}"
    )
    unsafe = [m["motion"] for m in (findings.check or {"motions": ()})["motions"] if not m["safe"]]
    if unsafe:
        return Conclusion(
            f"{found}; but {len(unsafe)} do not pass the independent check: do not run {', '.join(unsafe[:_NAMED])}.",
            False,
            ("check", _robot(findings), findings.folder),
            "see where and when",
        )
    capture = ("capture", _robot(findings), findings.folder)
    purpose = "the sheet for the minutes at the robot"
    if forecast is None:
        return Conclusion(f"{found}.", None, capture, purpose)
    n, within, target = forecast["essential"], forecast["within"], number(forecast["target_rsd_percent"])
    promise = f"{within} of {n} essential parameters are to be expected within {target} %"
    if within == n:
        return Conclusion(f"{found}: {promise}, which is enough.", True, capture, purpose)
    more = _longer(forecast)
    return Conclusion(f"{found}: {promise}{more}.", None, capture, purpose)


def _of_refusals(found: Document, findings: Findings) -> Conclusion:
    """Of a plan that has no motion: ``generated``, ``refused`` and ``remedy``."""
    sentence, remedy = f"None of {found['generated']} candidate motions is safe", found["remedy"]
    if found["refused"]:
        most = max(found["refused"], key=lambda item: item["candidates"])
        reason = most["reason"].replace("_", " ")
        sentence += f"; most are refused for {reason} ({most['where']}, {most['candidates']} of them)"
    again = ("plan", _robot(findings), "--out", findings.folder)
    if remedy:
        return Conclusion(
            f"{sentence}. What would help most: {remedy['change']}.", False, again, "again, with that changed"
        )
    purpose = "again, once its limits, posture at rest and feet are seen to be right"
    return Conclusion(f"{sentence}. No single limit lifted helps.", False, again, purpose)


def _longer(forecast: Document) -> str:
    """How much motion of this kind the others take, where any amount does."""
    needed = [s for s in forecast["needed_s"].values() if s > forecast["seconds"]]
    if not needed:
        return "; the others do not come within it by motion like this"
    return f"; {len(needed)} more would take {max(needed):.0f} s of motion like this"


def _of_check(check: Document, findings: Findings) -> Conclusion:
    motions = check["motions"]
    unsafe = [motion["motion"] for motion in motions if not motion["safe"]]
    if not unsafe and motions:
        return Conclusion(
            f"All of {_count(len(motions), 'motion')} pass the independent check: safe to run, as far as the model is "
            "true.",
            True,
        )
    named = ", ".join(unsafe[:_NAMED]) + (" …" if len(unsafe) > _NAMED else "")
    found = f"{len(unsafe)} of {_count(len(motions), 'motion')} do not pass the independent check: do not run {named}."
    return Conclusion(found, False)


def _robot(findings: Findings) -> str:
    """The robot as a command takes it."""
    for document in filter(None, (findings.plan, findings.identification, findings.check, findings.refusals)):
        if document.get("robot_file"):
            return os.path.normpath(findings.folder / document["robot_file"])
    return _name(findings)


def _name(findings: Findings) -> str:
    documents = (
        findings.plan,
        findings.identification,
        findings.campaign,
        findings.check,
        findings.refusals,
    )
    return next((str(d["robot"]) for d in documents if d and d.get("robot")), "ROBOT")


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
