"""A trial in motion: as it was measured, and beside it as a simulator or its command has it."""

from __future__ import annotations

from typing import Any

import numpy as np

from excite.arrays import Array
from excite.errors import ExciteError
from excite.logs.columns import BASE_POSE
from excite.logs.log import Trial
from excite.report.comparisons import PathComparison, Record
from excite.report.folder import Findings
from excite.report.html import html_paragraph, live_replay
from excite.report.replay.scene import robot_scene, trial_frames
from excite.report.sections.section import Content, section, section_content
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot

_COMMANDED = "commanded"
_LOST = " Under the measured torques the simulator runs away by more than half a turn, and is not shown."


@section("moving", "The trial in motion")
def show_moving(findings: Findings) -> Content | str:
    """The trial that judges; with an identification both models, with a diagnosis its simulator before and after."""
    record = findings.record
    if record is None:
        return ""
    path = findings.data.path
    found = findings.diagnosis or {}
    if path is not None and not set(path.joints) - set(BASE_POSE) <= set(record.robot.joint_names):
        path = None
    trial = record.trial(path.trial if path else "")
    try:
        models = {} if path is None else _model_paths(path, found)
        lost = "" if path is None or models else _LOST
        path = path if models else None
        tracks = _simulated_tracks(record, path, models) if path else _recorded_tracks(record, trial)
    except ExciteError:
        return ""
    still = html_paragraph("Open this page in a browser that runs scripts to see it move.", "lead")
    if path is not None and path.horizon_s is not None:
        lead = _of_identification(record.robot, path, path.horizon_s)
    else:
        horizon_s = (found.get("simulation") or {}).get("horizon_s")
        lead = _lead_sentence(trial.name, path is not None, horizon_s, tracks) + lost
    shown = live_replay("moving-replay", robot_scene(record.robot), tracks, still)
    return section_content(lead, shown)


def _lead_sentence(trial: str, simulated: bool, horizon_s: float | None, tracks: dict[str, Any]) -> str:
    if simulated:
        again = f"; it starts anew from the record every {horizon_s:g} s" if horizon_s else ""
        return (
            f"Trial {trial} as it was measured, and transparent where the simulator takes it{again}, and "
            "where nothing was simulated the two coincide. Joints that part are those that the model gets wrong."
        )
    if any("ghost" in track for track in tracks.values()):
        return f"Trial {trial} as it was measured, and transparent where it was told to be."
    return f"Trial {trial} as it was measured."


def _of_identification(robot: Robot, path: PathComparison, horizon_s: float) -> str:
    strays = [_describe_strays(robot, path, positions) for positions in (path.nominal, path.identified)]
    return (
        f"Trial {path.trial} as it was measured, and transparent where a model goes under the measured "
        f"forces, when it starts anew from the record every {horizon_s:g} s. By then the model as supplied strays by "
        f"{strays[0]}, the identified one by {strays[1]}. Where nothing was computed the two coincide."
    )


def _describe_strays(robot: Robot, path: PathComparison, positions: Array) -> str:
    """How far a model strays at most, and where: of a free base the base, else the joint."""
    apart = np.abs(positions - path.measured)
    if set(BASE_POSE) <= set(path.joints):
        place = [path.joints.index(name) for name in BASE_POSE[:3]]
        return f"up to {1e3 * np.linalg.norm(apart[:, place], axis=1).max():.2g} mm (base)"
    most = int(np.argmax(apart.max(axis=0)))
    joint, much = path.joints[most], float(apart[:, most].max())
    if is_prismatic(robot.model, robot.n_base_v + robot.joint_index(joint)):
        return f"up to {1e3 * much:.2g} mm ({joint})"
    return f"up to {much:.2g} rad ({joint})" if much < np.pi else f"more than half a turn ({joint})"


def _model_paths(path: PathComparison, diagnosis: dict[str, Any]) -> dict[str, Array]:
    """Where models take the robot, by what they are: those of an identification, or simulators of a diagnosis."""
    if path.horizon_s is not None:
        models = {"the identified model": path.identified, "the model as supplied": path.nominal}
    else:
        models = {"the simulator as it was": path.nominal}
        if diagnosis.get("effects"):
            models["the simulator with the effects"] = path.identified
    # A joint that spins, since its model lacks friction and a rotor, is nothing to look at.
    return {name: at for name, at in models.items() if np.abs(at - path.measured).max() < np.pi}


def _simulated_tracks(record: Record, path: PathComparison, models: dict[str, Array]) -> dict[str, Any]:
    """Measured, with each model as a ghost."""
    base = _base_of(record, path)
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


def _base_of(record: Record, path: PathComparison) -> Any:
    if set(BASE_POSE) <= set(path.joints):
        return None
    trial = record.trial(path.trial)
    return trial.base if trial.base is not None and len(trial.base) == len(path.time) else None


def _recorded_tracks(record: Record, trial: Trial) -> dict[str, Any]:
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
