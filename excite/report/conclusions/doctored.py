"""What a look through a log comes to."""

from __future__ import annotations

from excite.report.conclusions.result import Conclusion, log_words, measures_forces, robot_of_result
from excite.report.folder import Document, Findings
from excite.shown import count

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
