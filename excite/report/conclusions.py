"""What a folder's results come to: what was found, whether it is good enough, and the command to go on with."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import NamedTuple

from excite.display import count
from excite.finding import list_names
from excite.identification.judgement import POOR_RSD, Forecast
from excite.logs.log import LogHeader
from excite.report.folder import Document, Findings
from excite.report.html import format_number
from excite.report.plots.curves import channel_label
from excite.robot.catalogue import robot_of_log
from excite.safety.verdict import conditions

_SPOILS = {"fatal", "spoils"}


class Conclusion(NamedTuple):
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


# Results in the words in which commands take them.


def log_words(found: Document, findings: Findings) -> str:
    """The log of a result, as a command takes it."""
    stated = found.get("log_file")
    return os.path.normpath(findings.folder / stated) if stated else "LOG"


def _log_header(findings: Findings) -> LogHeader | None:
    return None if findings.record is None else findings.record.log.header


def robot_of_result(found: Document, findings: Findings) -> str:
    """The robot of a log as a command takes it: the file that was given, a bundled name, else the log's own."""
    if found["robot_file"]:
        return os.path.normpath(findings.folder / found["robot_file"])
    name, header = str(found["robot"] or "ROBOT"), _log_header(findings)
    return name if header is None else str(robot_of_log(name, header.robot, Path(log_words(found, findings))))


def _robot_documents(findings: Findings) -> list[Document]:
    named = (findings.plan, findings.identification, findings.campaign, findings.check)
    return [one for one in (*named, findings.doctor) if one]


def robot_words(findings: Findings) -> str:
    """The robot as a command takes it."""
    files = [one["robot_file"] for one in _robot_documents(findings) if one.get("robot_file")]
    return os.path.normpath(findings.folder / files[0]) if files else robot_name(findings)


def robot_name(findings: Findings) -> str:
    """The robot's name."""
    return next((str(one["robot"]) for one in _robot_documents(findings) if one.get("robot")), "ROBOT")


def _and_more(n: int, what: str) -> str:
    return f", and {count(n, what)}" if n > 0 else ""


# What a campaign comes to.


def of_campaign(campaign: Document, findings: Findings) -> Conclusion:
    """Of ``campaign.json``."""
    steps, target = campaign["iterations"], campaign["target_rsd_percent"]
    found, last = "Nothing is recorded yet, and so nothing is known", Document(not_met=[], helped=None)
    if steps:
        last, motions = steps[-1], sum(step["n_motions"] for step in steps)
        judged = {*last["rsd_percent"], *last["not_met"]}
        # How many of the motions were chosen to identify from, where others judge.
        chosen = len(findings.plan["selected"]) if findings.plan is not None else motions
        judging = (
            f" ({chosen} to identify from, {motions - chosen} to judge by)" if 0 < chosen < motions else ""
        )
        found = (
            f"After {count(len(steps), 'iteration')} and {count(motions, 'motion')}{judging}, "
            f"{len(judged) - len(last['not_met'])} of {len(judged)} parameters are known to within "
            f"{'their target' if target is None else f'{target:g} %'}"
        )
    if campaign["awaits"] or not steps:
        # It was stopped for its motions to be recorded.
        log = Path(campaign["awaits"])
        iteration = os.path.normpath(findings.folder / log.parent.name)
        return Conclusion(
            f"{found}; motions are planned in {iteration}, whose report shows them, and their log is awaited in "
            f"{iteration}/{log.name}.",
            None,
            ("capture", robot_words(findings), iteration),
            "the sheet for recording them; when the log is there, the campaign goes on with --resume",
        )
    if campaign["targets_met"]:
        return Conclusion(f"{found}: the targets are met.", True, *model_command(findings))
    missed, helped = last["not_met"], last["helped"]
    found += f"; not enough for {list_names(missed, 3)}"
    if helped == []:
        said = f"{found}, and more motion would help none of them, see Certainty for why."
        identified = findings.identification
        onward = Conclusion("", False) if identified is None else of_identification(identified, findings)
        return onward._replace(found=said, good=False)
    if helped is not None and len(helped) < len(missed):
        found += f"; more motion may help {len(helped)} of them"
    # It is resumed with the options that it was begun with.
    option = "--max-iterations"
    words = begun_with(findings, "campaign", option) or ["campaign", robot_words(findings)]
    words = [word for word in words if word not in {"--resume", option}]
    again = (*words, option, 2 * len(steps), "--resume", "--out", findings.folder)
    return Conclusion(f"{found}, see Certainty for why.", False, again, "go on with more motions")


def begun_with(findings: Findings, document: str, *without: str) -> list[str]:
    """The words that a document was made with, less ``excite`` and some options with a value; none where not known."""
    made = findings.made.get(document)
    words = shlex.split(made.command)[1:] if made is not None else []
    for option in without:
        while option in words:
            at = words.index(option)
            del words[at : at + 2]
    return words


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
    verdict, following, log = found["verdict"], found["next_experiment"], log_words(found, findings)
    command = identify_fitted(found, _log_header(findings), robot_of_result(found, findings), log)
    if command:
        sentence += " Nothing beyond that needs to be corrected."
        return Conclusion(sentence, True, command, "see how far these bodies are from the file's")
    if verdict == "none":
        return Conclusion(sentence + " The model is good enough for what this record shows.", True)
    if verdict == "effect" or (verdict == "unknown" and found["effects"]):
        closed = found["gap"]["share_closed"]
        enough = None if closed is None else closed >= 1.0 - _LEFT
        said = (
            sentence
            + _times_the_noise(found, enough)
            + ("" if enough is not False else _describe_rest(found))
        )
        apply = ("diagnose", log, "--apply", "better", "--out", "first")
        return Conclusion(said, enough, apply, "write the effects into the robot, then see what is left")
    if following is None:
        purpose = "see whether the record is at fault; an effect of one's own can be added to the library"
        return Conclusion(sentence, False, ("doctor", log), purpose)
    command = ("export", following["motion"], "--format", "csv") if following["motion"] else ()
    tells = " One more experiment would tell." if command else ""
    return Conclusion(sentence + tells, False, command, following["why"])


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
    fitted = found["verdict"] == "none" and "rigid_body" in found["modelled"]
    if not fitted or (header is not None and not header.measures_forces):
        return ()
    if robot is None:
        robot = "ROBOT" if header is None else robot_of_log(found["robot"], header.robot, Path(log))
    return ("identify", robot, log, "--out", "result")


def _times_the_noise(found: Document, enough: bool | None) -> str:
    """What is left beside the noise, and what that is good for."""
    after, floor = found["gap"]["after"], found["gap"]["noise_floor"]
    if enough is None or after is None or not floor:
        return ""
    good = "good enough for motions like these." if enough else "not good enough yet."
    return f" What is left is {format_number(after / floor, 2)} times the noise: {good}"


def _describe_rest(found: Document) -> str:
    """Where most of the rest is, and what it follows where that is most of it."""
    accepted, left = {(e["effect"], e["location"]) for e in found["effects"]}, {}
    for name, item in found["budget"].items():
        shares = (e["share"] or 0.0 for e in item["effects"] if (e["effect"], e["location"]) in accepted)
        left[name] = (item["weight"] or 0.0) * (1.0 - sum(shares))
    most = max(left, key=lambda name: left[name], default=None)
    if most is None or left[most] <= 0.0:
        return ""
    channel, follows = found["budget"][most], ""
    unnamed: list[Document] = [*channel["unnamed"], {"share": None, "follows": ""}]
    strange = max(unnamed, key=lambda item: item["share"] or 0.0)
    if 2.0 * (strange["share"] or 0.0) * (channel["weight"] or 0.0) > left[most]:
        what = strange["follows"]
        follows = ", where it " + (what if what.startswith("does") else f"follows {what} and has no name")
    return f" Most of the rest is at {channel_label(most)}{follows}."


# What a look through a log comes to.


def of_doctor(found: Document, findings: Findings) -> Conclusion:
    """Of ``doctor.json``."""
    open_ = [item for item in found["findings"] if not item["repaired"]]
    spoils, limits = ([i for i in open_ if i["severity"] in kinds] for kinds in (_SPOILS, {"limits"}))
    mended = len(found["findings"]) - len(open_)
    also = f"; {count(mended, 'fault')} mended on the way" if mended else ""
    if spoils:
        worst, more = spoils[0], _and_more(len(spoils) - 1, "more fault")
        fatal = worst["severity"] == "fatal"
        nothing = "nothing can be told from it" if fatal else "it spoils what is computed from it"
        text = f"{worst['text'][:1].upper()}{worst['text'][1:]}{more}: {nothing} before that is mended{also}."
        return Conclusion(text, False, purpose=worst["remedy"])
    verdict = "Nothing in the log spoils what is computed from it"
    if limits:
        verdict += (
            f", but its use has limits: {limits[0]['text']}{_and_more(len(limits) - 1, 'more finding')}"
        )
    if not found["findings"]:
        verdict = "Nothing wrong was found in the log"
    source, header = found["repaired"] or log_words(found, findings), _log_header(findings)
    # Of a fixed base nothing can be identified from commands alone.
    command: tuple[object, ...] = ("diagnose", source, "--out", "diagnosis")
    purpose = "diagnose it"
    if header is None or header.measures_forces:
        command = ("identify", robot_of_result(found, findings), source, "--out", "result")
        purpose = "identify from it"
    return Conclusion(f"{verdict}{also}.", True, command, purpose)


# What an identification comes to.


def of_identification(found: Document, findings: Findings) -> Conclusion:
    """Of ``identification.json``."""
    base, log = found["base_parameters"], log_words(found, findings)
    known = (
        f"{count(len(base), 'base parameter')} {'was' if len(base) == 1 else 'were'} identified from "
        f"{found['n_samples']} samples"
    )
    judged = [r for r in found["validation"].values() if r["reference_rmse"] and r["rmse"] is not None]
    if not judged:
        return Conclusion(
            f"{known}; no trial was left out to judge them, so nobody knows how good they are.",
            None,
            ("identify", robot_words(findings), log, "--out", findings.folder),
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
        text = f"{known}, but {predicted}{solved}: not to be used before that is understood."
        return Conclusion(text, False, ("doctor", log), "see what is wrong with the record")
    said, doubt = f"{known}; {predicted}", describe_doubt(found, len(judged))
    diagnose = ("diagnose", log, "--out", "diagnosis")
    if doubt:
        return Conclusion(f"{said}, but {doubt}.", False, diagnose, "see what the model lacks")
    vague = sum(row["rsd_percent"] is None or row["rsd_percent"] > POOR_RSD for row in base)
    said += ": good enough to predict motions like these"
    if vague:
        said += f", though {vague} of {len(base)} parameters by themselves are not known to within {POOR_RSD:.0f} %"
    if any(finding["kind"] == "extension" for finding in found["findings"]):
        said += "; but more than bodies and friction is in the torques."
        return Conclusion(said, True, diagnose, "see what it is")
    return Conclusion(f"{said}.", True, *model_command(findings))


def model_command(findings: Findings) -> tuple[tuple[object, ...], str]:
    """The command that takes it into a simulator, and what for."""
    command = ("model", findings.folder, "--format", "mjcf", "--out", f"{robot_name(findings)}_mujoco")
    return command, "take the identified robot into a simulator"


def describe_doubt(found: Document, judged: int) -> str:
    """Why it is not good enough though each of so many channels is predicted better; empty where it is."""
    spoils = [f for f in found["findings"] if f["severity"] in _SPOILS and not f["repaired"]]
    if spoils:
        return f"{spoils[0]['text']}; not to be relied on before that is cleared up"
    gaps = sum(finding["kind"] == "validation_gap" for finding in found["findings"])
    both = found["fit"].keys() & found["validation"].keys()
    fits = [(found["validation"][name]["rmse"], found["fit"][name]["rmse"]) for name in both]
    times = [judging / fitted for judging, fitted in fits if judging is not None and fitted]
    if 2 * gaps < judged or not times:
        return ""
    return (
        f"{gaps} of them leave up to {format_number(max(times))} times what they leave on the trials "
        "that were fitted to; not to be relied on for other motions"
    )


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
        said += f"; {open_[0]}{_and_more(len(open_) - 1, 'more finding')}"
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
        again = ("plan", robot_words(findings), "--out", findings.folder)
        said = f"None of {candidates['generated']} candidate motions is safe."
        return Conclusion(said, False, again, "again, once its limits, posture at rest and feet are right")
    seconds = sum(entry["duration_s"] for entry in chosen)
    found = (
        f"{count(len(chosen), 'motion')} of {seconds:.0f} s in all, chosen from {candidates['accepted']} safe ones "
        f"of {count(candidates['generated'], 'candidate')}"
    )
    unsafe = [m["motion"] for m in (findings.check or {"motions": ()})["motions"] if not m["safe"]]
    if unsafe:
        found += f"; but {len(unsafe)} do not pass the independent check: do not run {', '.join(unsafe[:3])}."
        return Conclusion(
            found, False, ("check", robot_words(findings), findings.folder), "see where and when"
        )
    enough = None
    if forecast is not None:
        within, n = forecast["within"], forecast["essential"]
        enough = True if within == n else None
        promise = f"{within} of {n} essential parameters are to be expected within {forecast['target_rsd_percent']:g} %"
        longer = (
            Forecast.from_json(forecast).longer() or "; the others do not come within it by motion like this"
        )
        found += f": {promise}{', which is enough' if enough else longer}"
    capture = ("capture", robot_words(findings), findings.folder)
    return Conclusion(f"{found}.", enough, capture, "the sheet for the minutes at the robot")


def of_check(check: Document, findings: Findings) -> Conclusion:
    """Of ``check.json``."""
    motions = check["motions"]
    unsafe, n = [motion["motion"] for motion in motions if not motion["safe"]], count(len(motions), "motion")
    if unsafe or not motions:
        named = ", ".join(unsafe[:3]) + " …" * (len(unsafe) > 3)
        found = f"{len(unsafe)} of {n} do not pass the independent check: do not run {named}."
        return Conclusion(found, False, purpose="see Violations for what, where and when, and plan them anew")
    held = {"the model is true": None, **{one: None for m in motions for one in m.get("as_far_as", ())}}
    found = f"All of {n} pass the independent check: safe to run{conditions(held)}."
    export = "export them for the controller (excite export MOTION --format F), and run them slowly first"
    return Conclusion(found, True, purpose=export)


# By document, the last step first.
_STEPS: dict[str, Callable[[Document, Findings], Conclusion]] = {
    "diagnosis": of_diagnosis,
    "campaign": of_campaign,
    "identification": of_identification,
    "plan": of_plan,
    "check": of_check,
    "human": of_person,
    "doctor": of_doctor,
}


def draw_conclusion(findings: Findings) -> Conclusion | None:
    """Of the last step that the folder holds: what came before it is in the sections below."""
    for name, conclude in _STEPS.items():
        found = getattr(findings, name)
        if found is not None and (name != "campaign" or found["iterations"] or found["awaits"]):
            return conclude(found, findings)
    return None
