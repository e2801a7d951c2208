"""What a diagnosis comes to, and what it leaves."""

from __future__ import annotations

from pathlib import Path

from excite.logs.log import LogHeader
from excite.report.conclusions.result import Conclusion, log_words, robot_of_result
from excite.report.folder import Document, Findings
from excite.report.html import format_number
from excite.report.plots.forces import channel_label
from excite.robot.catalogue import robot_of_log

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
