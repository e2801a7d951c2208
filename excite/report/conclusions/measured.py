"""What the measurement of a person comes to, before anything is identified."""

from __future__ import annotations

import os
from statistics import median

from excite.report.conclusions.result import Conclusion
from excite.report.folder import Document, Findings
from excite.shown import count


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
