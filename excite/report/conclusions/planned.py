"""What a plan comes to, of motions or of none, and what the independent check says of motions."""

from __future__ import annotations

from excite.identification.judgement.poor import PATIENCE
from excite.report.conclusions.result import NAMED, Conclusion, robot_words
from excite.report.folder import Document, Findings
from excite.safety.verdict import conditions
from excite.shown import count, span


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
    more = _longer_motion(forecast)
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


def _longer_motion(forecast: Document) -> str:
    """How much motion of this kind the others take, as far as anybody would have the patience for it."""
    seconds = forecast["seconds"]
    needed = [s for s in forecast["needed_s"].values() if s > seconds]
    if not needed:
        return "; the others do not come within it by motion like this"
    near = [s for s in needed if s <= PATIENCE * seconds]
    far = len(needed) - len(near)
    said = ""
    if near:
        least, most = f"{min(near):.0f} s", f"{max(near):.0f} s"
        said += f"; {len(near)} more would take {span(least, most, ' to ')} of motion like this"
    if far:
        said += f"; {far} would take more than {PATIENCE:g} times as much as this"
    return said


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
