"""What a folder comes to, one file a kind of result."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from excite.display import count
from excite.identification.judgement.forecast import Forecast
from excite.identification.judgement.judgement import POOR_RSD
from excite.logs.log import LogHeader
from excite.report.folder import Document, Findings
from excite.report.html import format_number
from excite.report.plots.curves import channel_label
from excite.robot.catalogue import robot_of_log
from excite.safety.verdict import conditions

# What results come to, and the words in which commands take them.

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


# What a campaign comes to.


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


# What a diagnosis comes to, and what it leaves.

VERDICTS = {
    "effect": "an effect is named and placed",
    "ambiguous": "several effects explain it alike",
    "unknown": "no effect of the library explains most of it",
    "none": "nothing stands above the noise",
}
# More than this left of the gap is worth a word.
_LEFT = 0.1


def of_diagnosis(found: Document, findings: Findings) -> Conclusion:
    """Of ``diagnosis.json``."""
    sentence = found["sentence"] or f"{found['robot'] or 'a robot'}: {VERDICTS[found['verdict']]}."
    verdict, following = found["verdict"], found["next_experiment"]
    header = None if findings.record is None else findings.record.log.header
    command = identify_fitted(found, header, robot_of_result(found, findings), log_words(found, findings))
    if command:
        purpose = "see how far these bodies are from the file's"
        return Conclusion(sentence + " Nothing beyond that needs to be corrected.", True, command, purpose)
    if verdict == "none":
        return Conclusion(sentence + " The model is good enough for what this record shows.", True)
    if verdict == "effect" or (verdict == "unknown" and found["effects"]):
        purpose = "write the effects into the robot, then see what is left"
        enough = _is_enough(found)
        return Conclusion(
            sentence + _times_the_noise(found, enough) + _describe_rest(found),
            enough,
            ("diagnose", log_words(found, findings), "--apply", "better", "--out", "first"),
            purpose,
        )
    if following is not None and following["motion"]:
        sentence += " One more experiment would tell."
        return Conclusion(
            sentence, False, ("export", following["motion"], "--format", "csv"), following["why"]
        )
    if following is None:
        purpose = "see whether the record is at fault; an effect of one's own can be added to the library"
        return Conclusion(sentence, False, ("doctor", log_words(found, findings)), purpose)
    return Conclusion(sentence, False, purpose=following["why"])


def identify_fitted(
    found: Document, header: LogHeader | None, robot: object, log: str | Path
) -> tuple[object, ...]:
    """Words of the command that tells how far bodies are from the file's, where a diagnosis without an effect has
    fitted them: they were taken up by the fit, and are no gap.

    Args:
        found: contents of ``diagnosis.json``.
        header: the log's; None where it is not known.
        robot: as the command takes it; None for the log's own.
        log: as the command takes it.

    Returns:
        The words without ``excite``; none where nothing is to be identified.
    """
    if found["verdict"] != "none" or "rigid_body" not in found["modelled"]:
        return ()
    if header is not None and not header.measures_forces:
        return ()
    if robot is None:
        robot = "ROBOT" if header is None else robot_of_log(found["robot"], header.robot, Path(log))
    return ("identify", robot, log, "--out", "result")


def _is_enough(found: Document) -> bool | None:
    """Whether the effects leave so little of the gap that the model will do; None where nobody knows."""
    closed = found["gap"]["share_closed"]
    return None if closed is None else closed >= 1.0 - _LEFT


def _times_the_noise(found: Document, enough: bool | None) -> str:
    """What is left beside the noise, and what that is good for."""
    after, floor = found["gap"]["after"], found["gap"]["noise_floor"]
    if enough is None or after is None or not floor:
        return ""
    left = f" What is left is {format_number(after / floor, 2)} times the noise: "
    return left + ("good enough for motions like these." if enough else "not good enough yet.")


def _describe_rest(found: Document) -> str:
    """What most of the rest is, where the accepted effects leave much."""
    closed, accepted = found["gap"]["share_closed"], {(e["effect"], e["location"]) for e in found["effects"]}
    if closed is None or closed >= 1.0 - _LEFT:
        return ""
    left = {
        name: (item["weight"] or 0.0)
        * (1.0 - sum(e["share"] or 0.0 for e in item["effects"] if (e["effect"], e["location"]) in accepted))
        for name, item in found["budget"].items()
    }
    if not any(size > 0.0 for size in left.values()):
        return ""
    most = max(left, key=lambda name: left[name])
    strange = max(found["budget"][most]["unnamed"], key=lambda item: item["share"] or 0.0, default=None)
    follows = ""
    if (
        strange is not None
        and 2.0 * (strange["share"] or 0.0) * (found["budget"][most]["weight"] or 0.0) > left[most]
    ):
        what = strange["follows"]
        follows = ", where it " + (what if what.startswith("does") else f"follows {what} and has no name")
    return f" Most of the rest is at {channel_label(most)}{follows}."


# What a look through a log comes to.

_SPOILS = {"fatal", "spoils"}


def of_doctor(found: Document, findings: Findings) -> Conclusion:
    """Of ``doctor.json``."""
    open_ = [item for item in found["findings"] if not item["repaired"]]
    spoils = [item for item in open_ if item["severity"] in _SPOILS]
    mended = len(found["findings"]) - len(open_)
    log = log_words(found, findings)
    also = f"; {count(mended, 'fault')} mended on the way" if mended else ""
    if spoils:
        worst, more = spoils[0], f", and {count(len(spoils) - 1, 'more fault')}" if len(spoils) > 1 else ""
        nothing = (
            "nothing can be told from it"
            if worst["severity"] == "fatal"
            else "it spoils what is computed from it"
        )
        return Conclusion(
            f"{_as_sentence(worst['text'])}{more}: {nothing} before that is mended{also}.",
            False,
            purpose=worst["remedy"],
        )
    limits = [item for item in open_ if item["severity"] == "limits"]
    verdict = "Nothing in the log spoils what is computed from it"
    if limits:
        more = f", and {count(len(limits) - 1, 'more finding')}" if len(limits) > 1 else ""
        verdict += f", but its use has limits: {limits[0]['text']}{more}"
    if not found["findings"]:
        verdict = "Nothing wrong was found in the log"
    source = found["repaired"] or log
    if not measures_forces(findings):
        return Conclusion(
            f"{verdict}{also}.", True, ("diagnose", source, "--out", "diagnosis"), "diagnose it"
        )
    command = ("identify", robot_of_result(found, findings), source, "--out", "result")
    return Conclusion(f"{verdict}{also}.", True, command, "identify from it")


def _as_sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


# What an identification comes to.


def of_identification(found: Document, findings: Findings) -> Conclusion:
    """Of ``identification.json``."""
    base = found["base_parameters"]
    verb = "was" if len(base) == 1 else "were"
    known = f"{count(len(base), 'base parameter')} {verb} identified from {found['n_samples']} samples"
    judged = [r for r in found["validation"].values() if r["reference_rmse"] and r["rmse"] is not None]
    if not judged:
        return Conclusion(
            f"{known}; no trial was left out to judge them, so nobody knows how good they are.",
            None,
            ("identify", robot_words(findings), log_words(found, findings), "--out", findings.folder),
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
            ("doctor", log_words(found, findings)),
            "see what is wrong with the record",
        )
    rsd = [row["rsd_percent"] for row in base]
    vague = sum(value is None or value > POOR_RSD for value in rsd)
    single = f"{vague} of {len(rsd)} parameters by themselves are not known to within {POOR_RSD:.0f} %"
    said = f"{known}; {predicted}"
    why = describe_doubt(found, len(judged))
    if why:
        command = ("diagnose", log_words(found, findings), "--out", "diagnosis")
        return Conclusion(f"{said}, but {why}.", False, command, "see what the model lacks")
    single = f", though {single}" if vague else ""
    if any(finding["kind"] == "extension" for finding in found["findings"]):
        more = "more than bodies and friction is in the torques"
        command = ("diagnose", log_words(found, findings), "--out", "diagnosis")
        return Conclusion(
            f"{said}: good enough to predict motions like these{single}; but {more}.",
            True,
            command,
            "see what it is",
        )
    return Conclusion(
        f"{said}: good enough to predict motions like these{single}.", True, *model_command(findings)
    )


def model_command(findings: Findings) -> tuple[tuple[object, ...], str]:
    """The command that takes it into a simulator, and what for."""
    command = ("model", findings.folder, "--format", "mjcf", "--out", f"{robot_name(findings)}_mujoco")
    return command, "take the identified robot into a simulator"


# What the measurement of a person comes to, before anything is identified.


def of_person(found: Document, findings: Findings) -> Conclusion:
    """Of ``human.json``."""
    trials, rms, subject = found["trials"], found["marker_rms_m"], found["subject"]
    said = f"{count(len(trials), 'trial')} of a person"
    if rms is not None:
        said += f", whose markers fit the calibrated body to {1e3 * rms:.1f} mm"
    weighed = [trial["plates_kg"] for trial in trials if trial["plates_kg"] is not None]
    if weighed and subject is not None:
        said += f"; the plates say {median(weighed):.1f} kg, the person weighs {subject['mass']:g} kg"
    open_ = [item["text"] for item in found["findings"] if not item["repaired"]]
    if open_:
        more = f", and {count(len(open_) - 1, 'more finding')}" if len(open_) > 1 else ""
        said += f"; {open_[0]}{more}"
    if not found["robot_file"] or not found["log_file"]:
        return Conclusion(f"{said}.", None)
    robot, log = (os.path.normpath(findings.folder / found[name]) for name in ("robot_file", "log_file"))
    command = ("identify", robot, log, "--out", "segments")
    return Conclusion(f"{said}.", None if open_ else True, command, "identify the segments")


# What a plan comes to, of motions or of none, and what the independent check says of motions.


def of_plan(plan: Document, findings: Findings) -> Conclusion:
    """Of ``plan.json``."""
    chosen, candidates, forecast = plan["selected"], plan["candidates"], plan["forecast"]
    if not chosen:
        return of_refusals({**plan, "generated": candidates["generated"]}, findings)
    seconds = sum(entry["duration_s"] for entry in chosen)
    found = (
        f"{count(len(chosen), 'motion')} of {seconds:.0f} s in all, chosen from {candidates['accepted']} safe ones "
        f"of {count(candidates['generated'], 'candidate')}"
    )
    unsafe = [m["motion"] for m in (findings.check or {"motions": ()})["motions"] if not m["safe"]]
    if unsafe:
        return Conclusion(
            f"{found}; but {len(unsafe)} do not pass the independent check: do not run {', '.join(unsafe[:NAMED])}.",
            False,
            ("check", robot_words(findings), findings.folder),
            "see where and when",
        )
    capture = ("capture", robot_words(findings), findings.folder)
    purpose = "the sheet for the minutes at the robot"
    if forecast is None:
        return Conclusion(f"{found}.", None, capture, purpose)
    n, within, target = forecast["essential"], forecast["within"], f"{forecast['target_rsd_percent']:g}"
    promise = f"{within} of {n} essential parameters are to be expected within {target} %"
    if within == n:
        return Conclusion(f"{found}: {promise}, which is enough.", True, capture, purpose)
    more = Forecast.from_json(forecast).longer() or "; the others do not come within it by motion like this"
    return Conclusion(f"{found}: {promise}{more}.", None, capture, purpose)


def of_refusals(found: Document, findings: Findings) -> Conclusion:
    """Of a plan that has no motion: ``generated``, ``refused`` and ``remedy``."""
    sentence, remedy = f"None of {found['generated']} candidate motions is safe", found["remedy"]
    if found["refused"]:
        most = max(found["refused"], key=lambda item: item["candidates"])
        reason = most["reason"].replace("_", " ")
        sentence += f"; most are refused for {reason} ({most['where']}, {most['candidates']} of them)"
    again = ("plan", robot_words(findings), "--out", findings.folder)
    if remedy:
        return Conclusion(
            f"{sentence}. What would help most: {remedy['change']}.", False, again, "again, with that changed"
        )
    purpose = "again, once its limits, posture at rest and feet are seen to be right"
    return Conclusion(f"{sentence}. No single limit lifted helps.", False, again, purpose)


def of_check(check: Document, findings: Findings) -> Conclusion:
    """Of ``check.json``."""
    motions = check["motions"]
    unsafe = [motion["motion"] for motion in motions if not motion["safe"]]
    if not unsafe and motions:
        held = {"the model is true": None, **{one: None for m in motions for one in m.get("as_far_as", ())}}
        return Conclusion(
            f"All of {count(len(motions), 'motion')} pass the independent check: safe to run{conditions(held)}.",
            True,
            purpose="export them for the controller (excite export MOTION --format F), and run them slowly first",
        )
    named = ", ".join(unsafe[:NAMED]) + (" …" if len(unsafe) > NAMED else "")
    found = f"{len(unsafe)} of {count(len(motions), 'motion')} do not pass the independent check: do not run {named}."
    return Conclusion(found, False, purpose="see Violations for what, where and when, and plan them anew")


# What keeps an identification from being good enough, however well it predicts.

_DOUBT_SPOILS = {"fatal", "spoils"}


def describe_doubt(found: Document, judged: int) -> str:
    """Why it is not good enough though each of so many channels is predicted better; empty where it is."""
    for finding in found["findings"]:
        if finding["severity"] in _DOUBT_SPOILS and not finding["repaired"]:
            return f"{finding['text']}; not to be relied on before that is cleared up"
    gaps = sum(finding["kind"] == "validation_gap" for finding in found["findings"])
    both = found["fit"].keys() & found["validation"].keys()
    fits = [(found["validation"][name]["rmse"], found["fit"][name]["rmse"]) for name in both]
    times = [judging / fitted for judging, fitted in fits if judging is not None and fitted]
    if 2 * gaps < judged or not times:
        return ""
    return (
        f"{gaps} of them leave up to {format_number(max(times))} times what they leave on the trials "
        "that were fitted to; not "
        "to be relied on for other motions"
    )


# What a folder's results come to: what was found, whether it is good enough, and the command to go on with.

# By document, the last step first.
_STEPS: dict[str, Callable[[Document, Findings], Conclusion]] = {
    "diagnosis": of_diagnosis,
    "campaign": of_campaign,
    "identification": of_identification,
    "plan": of_plan,
    "check": of_check,
    "refusals": of_refusals,
    "human": of_person,
    "doctor": of_doctor,
}


def draw_conclusion(findings: Findings) -> Conclusion | None:
    """Of the last step that the folder holds: what came before it is in the sections below."""
    for name, conclude in _STEPS.items():
        found = getattr(findings, name)
        is_begun = name != "campaign" or (found is not None and (found["iterations"] or found["awaits"]))
        if found is not None and is_begun:
            return conclude(found, findings)
    return None
