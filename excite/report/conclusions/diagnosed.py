"""What a diagnosis comes to, and what it leaves."""

from __future__ import annotations

from excite.report.conclusions.result import Conclusion, log_words, measures_forces, robot_of_log
from excite.report.folder import Document, Findings
from excite.report.plots.forces import channel_label

VERDICTS = {
    "effect": "an effect is named and placed",
    "ambiguous": "several effects explain it alike",
    "unknown": "no effect of the library explains it",
    "none": "nothing stands above the noise",
}
# More than this left of the gap is worth a word.
_LEFT = 0.1


def of_diagnosis(found: Document, findings: Findings) -> Conclusion:
    """Of ``diagnosis.json``."""
    sentence = found["sentence"] or f"{found['robot'] or 'a robot'}: {VERDICTS[found['verdict']]}."
    verdict, following = found["verdict"], found["next_experiment"]
    if verdict == "none" and "rigid_body" in found["modelled"] and measures_forces(findings):
        command = ("identify", robot_of_log(found, findings), log_words(found, findings), "--out", "result")
        purpose = "see how far these bodies are from the file's"
        return Conclusion(sentence + " Nothing beyond that needs to be corrected.", True, command, purpose)
    if verdict == "none":
        return Conclusion(sentence + " The model is good enough for what this record shows.", True)
    if verdict == "effect":
        purpose = "write the effects into the robot, then see what is left"
        return Conclusion(
            sentence + _left(found),
            None,
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


def _left(found: Document) -> str:
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
