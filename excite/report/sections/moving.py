"""A trial in motion: the robot as it was measured, and beside it as a simulator or its command has it."""

from __future__ import annotations

from typing import Any

from excite.errors import ExciteError
from excite.logs.columns import BASE_POSE
from excite.logs.log import Trial
from excite.report.data import PathComparison
from excite.report.folder import Findings
from excite.report.html import paragraph, section
from excite.report.live import replay
from excite.report.record import Record
from excite.report.replay.scene import scene
from excite.report.replay.trial import trial_frames
from excite.report.sections.section import Section

_COMMANDED = "commanded"


class Moving(Section):
    """The trial that judges; with a diagnosis its simulator before and after the effects."""

    identifier = "moving"
    title = "The trial in motion"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        record = findings.record
        if record is None:
            return ""
        path = findings.data.path
        found = findings.diagnosis or {}
        if path is not None and not set(path.joints) - set(BASE_POSE) <= set(record.robot.joint_names):
            path = None
        trial = record.trial(path.trial if path else "")
        try:
            tracks = (
                _simulated(record, path, bool(found.get("effects"))) if path else _recorded(record, trial)
            )
        except ExciteError:
            return ""
        still = paragraph("Open this page in a browser that runs scripts to see it move.", "lead")
        lead = _lead(trial.name, path is not None, (found.get("simulation") or {}).get("horizon_s"), tracks)
        shown = replay("moving-replay", scene(record.robot), tracks, still)
        return section(self.identifier, self.title, lead, shown)


def _lead(trial: str, simulated: bool, horizon_s: float | None, tracks: dict[str, Any]) -> str:
    if simulated:
        again = f"; it starts anew from the record every {horizon_s:g} s" if horizon_s else ""
        return (
            f"Trial {trial}: the robot as it was measured, and transparent where the simulator takes it{again}, and "
            "where nothing was simulated the two coincide. Joints that part are those that the model gets wrong."
        )
    if any("ghost" in track for track in tracks.values()):
        return f"Trial {trial}: the robot as it was measured, and transparent where it was told to be."
    return f"Trial {trial}: the robot as it was measured."


def _simulated(record: Record, path: PathComparison, closed: bool) -> dict[str, Any]:
    """Measured, with the simulator as a ghost: as it was, and with the effects."""
    models = {"the simulator as it was": path.nominal}
    if closed:
        models["the simulator with the effects"] = path.identified
    base = _base(record, path)
    return {
        f"{path.trial} · {name}": trial_frames(
            record.robot,
            path.trial,
            path.time,
            path.measured,
            path.joints,
            base=base,
            ghost=(name, positions),
        ).to_json()
        for name, positions in models.items()
    }


def _base(record: Record, path: PathComparison) -> Any:
    if set(BASE_POSE) <= set(path.joints):
        return None
    trial = record.trial(path.trial)
    return trial.base if trial.base is not None and len(trial.base) == len(path.time) else None


def _recorded(record: Record, trial: Trial) -> dict[str, Any]:
    ghost = None if trial.q_cmd is None else (_COMMANDED, trial.q_cmd)
    track = trial_frames(
        record.robot,
        trial.name,
        trial.time,
        trial.q,
        tuple(record.log.header.joints),
        base=trial.base,
        ghost=ghost,
    ).to_json()
    return {f"{trial.name} · {trial.role}": track}
