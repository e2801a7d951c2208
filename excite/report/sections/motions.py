"""Motions that were planned or checked, what they excite, what refuses others, and a trial in motion."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.display import count
from excite.errors import ExciteError
from excite.logs.log import Trial
from excite.motion.content import BASE_POSE
from excite.motion.motion import Motion
from excite.report.comparisons import ConditioningComparison, PathComparison, Record, ReportData
from excite.report.folder import Document, Findings
from excite.report.html import (
    Cell,
    Columns,
    Shown,
    columns_table,
    condition_value,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    live_replay,
)
from excite.report.plots.curves import Bars, draw_bars
from excite.report.plots.postures import choose_motions, draw_snapshots
from excite.report.replay.scene import frame_times, robot_scene, trial_track
from excite.report.replay.tracks import motion_tracks, pack_table
from excite.report.theme import to_svg
from excite.robot.robot import Robot
from excite.safety.verdict import MARGINS, conditions

_N_PICTURES = 4
# A page of 15 MB still opens on a phone, and all else on it comes to 3 MB at most. G1 takes 7 kB a second of motion.
_MOST_BYTES = 10_000_000
_CHOSEN: Columns = {
    "motion": "motion",
    "chosen for the segments": lambda entry: ", ".join(entry["segments"]),
    "duration [s]": lambda entry: float(entry["duration_s"]),
}
HOW_TO_WATCH = (
    "Drag the picture to look from elsewhere. One cursor runs over all plots: a click takes the robot there, a drag "
    "along a plot zooms, a double click shows all of it again."
)


def show_motions(findings: Findings) -> Shown:
    """Snapshots, the list of motions, the count of rejections by reason."""
    if findings.plan is None:
        figures = _motion_figures(findings) if findings.check is not None else []
        return ["The motions that were checked, those that are not safe first.", *figures] if figures else ""
    selected, rejected = findings.plan["selected"], findings.plan["candidates"]["rejected"]
    title = f"All {len(selected)} motions" if len(selected) > 1 else "The motion"
    reasons = sorted(rejected.items(), key=lambda item: (-item[1], item[0]))
    refused = html_table(("reason", "candidates"), [(reason.replace("_", " "), n) for reason, n in reasons])
    how_many = f"{count(sum(rejected.values()), 'rejected candidate')}, by reason"
    return [
        "These motions excite the segments best, and every one of them passed the checks.",
        *_motion_figures(findings),
        folded_content(title, columns_table(selected, _CHOSEN)),
        folded_content(how_many, refused) if rejected else "",
    ]


def _motion_figures(findings: Findings) -> list[str]:
    robot = findings.robot
    # A plan's motions in its order; of what was only checked first what is not safe: that is to be looked at.
    judged = findings.check["motions"] if findings.check is not None and findings.plan is None else ()
    unsafe = {item["motion"] for item in judged if not item["safe"]}
    motions = sorted(findings.motions, key=lambda motion: motion.name not in unsafe)
    if robot is None or not motions:
        return []
    caption = "Each row is one motion in its most different postures"
    if robot.feet:
        caption += (
            "; the orange point, the centre of mass above the green support polygon, says how far it leans"
        )
    drawn = to_svg(
        draw_snapshots(robot, choose_motions(motions, _N_PICTURES)), "snapshots", "Snapshots of the motions"
    )
    snapshots = html_paragraph(f"{caption}.", "lead") + inline_figure(drawn)
    moving, left = _titled_tracks(robot, motions)
    if not moving:
        return [snapshots]
    said = f"Not moving here, for a page shall stay small: {', '.join(left)}."
    return [
        html_paragraph(HOW_TO_WATCH, "lead moving"),
        live_replay("replay", robot_scene(robot), moving, snapshots),
        html_paragraph(said, "note") if left else "",
    ]


def _titled_tracks(robot: Robot, motions: Sequence[Motion]) -> tuple[dict[str, Any], list[str]]:
    """Tracks of the motions by title, as many as a page has room for, and the names of the others."""
    found: dict[str, Any] = {}
    size, left = 0, [motion.name for motion in motions]
    for motion in motions:
        if size > _MOST_BYTES:
            break
        with suppress(ExciteError):
            content = motion_tracks(robot, motion).to_json()
            size += len(json.dumps(content))
            if size <= _MOST_BYTES:
                found[motion_title(motion)] = content
                left.remove(motion.name)
    return found, left


def motion_title(motion: Motion) -> str:
    """A motion's name, generator and duration."""
    return f"{motion.name} · {motion.metadata.generator.replace('_', ' ')} · {motion.duration:.1f} s"


# A trial in motion: as it was measured, and beside it as a simulator or its command has it.


def show_moving(findings: Findings) -> Shown:
    """The trial that judges; with a diagnosis its simulator before and after."""
    record, data, found = findings.record, findings.data, findings.diagnosis or {}
    if record is None:
        return ""
    try:
        tracks = trial_tracks(record, data, found)
    except ExciteError:
        return ""
    path = _fitting_path(record, data)
    models, shown = _model_paths(path, found), record.trial(_shown_trial(record, data))
    horizon_s = (found.get("simulation") or {}).get("horizon_s")
    again = f"; it starts anew from the record every {horizon_s:g} s" if horizon_s else ""
    lead = f"Trial {shown.name} as it was measured"
    if models:
        lead += (
            f", and transparent where the simulator takes it{again}, and where nothing was simulated the two "
            "coincide. Joints that part are those that the model gets wrong."
        )
    else:
        told = any("ghost" in track for track in tracks.values())
        lead += ", and transparent where it was told to be." if told else "."
        # A joint that spins, since its model lacks friction and a rotor, is nothing to look at.
        lead += (
            " Under the measured torques the simulator runs away by more than half a turn, and is not shown."
            if path is not None
            else ""
        )
    still = html_paragraph("Open this page in a browser that runs scripts to see it move.", "lead")
    return [lead, live_replay("moving-replay", robot_scene(record.robot), tracks, still)]


def trial_tracks(record: Record, data: ReportData, diagnosis: Document) -> dict[str, Any]:
    """The trial that judges by title: measured, with each model as a ghost and what it leaves of the torques.

    Where there is no model that can be looked at, as it was recorded.
    """
    path, gap, robot = _fitting_path(record, data), data.gap, record.robot
    models = _model_paths(path, diagnosis)
    if path is None or not models:
        return recorded_track(record, record.trial(_shown_trial(record, data)))
    base = None if set(BASE_POSE) <= set(path.joints) else record.trial(path.trial).base
    base = base if base is not None and len(base) == len(path.time) else None
    signals = []
    if gap is not None and gap.trial == path.trial and set(gap.channels) & set(robot.joint_names):
        # What the model leaves of each joint's torque in the same trial, before and after the effects.
        before, after = (
            _joint_columns(robot, path.time, gap.time, gap.channels, gap.measured - model)
            for model in (gap.nominal, gap.identified)
        )
        named = {"title": "torque, measured less modelled", "unit": "N·m", "label": "as it was"}
        signals = [{**named, "values": before, "other": after, "otherLabel": "with the effects"}]
    tracks = {}
    for name, positions in models.items():
        ghost = (name, positions)
        track = trial_track(robot, path.trial, path.time, path.measured, path.joints, base=base, ghost=ghost)
        track["signals"] += signals
        tracks[f"{path.trial} · {name}"] = track
    return tracks


def recorded_track(record: Record, trial: Trial) -> dict[str, Any]:
    """A trial by its title, its command as a ghost, with its torques and currents."""
    robot, joints = record.robot, tuple(record.log.header.joints)
    ghost = None if trial.q_cmd is None else ("commanded", trial.q_cmd)
    track = trial_track(robot, trial.name, trial.time, trial.q, joints, base=trial.base, ghost=ghost)
    for title, unit, values in (("torque", "N·m", trial.tau), ("current", "A", trial.current)):
        if values is not None:
            columns = _joint_columns(robot, trial.time, trial.time, joints, values)
            track["signals"].append({"title": title, "unit": unit, "label": "measured", "values": columns})
    return {f"{trial.name} · {trial.role}": track}


def _joint_columns(
    robot: Robot, shown: Array, time: Array, names: tuple[str, ...], values: Array
) -> dict[str, Any]:
    """Signals ``(n, n_names)`` at a trial's frames, a column a joint of the robot; NaN of joints that have none."""
    frames = frame_times(shown)
    found = np.full((len(frames), robot.n_joints), np.nan)
    for name, column in zip(names, values.T, strict=True):
        if name in robot.joint_names:
            found[:, robot.joint_index(name)] = np.interp(frames - frames[0], time - time[0], column)
    return pack_table(found)


def _shown_trial(record: Record, data: ReportData) -> str:
    """Name of the trial that the curves are of; empty where there are none."""
    known = (_fitting_path(record, data), data.gap, data.forces)
    return next((one.trial for one in known if one is not None), "")


def _fitting_path(record: Record, data: ReportData) -> PathComparison | None:
    path = data.path
    return path if path and set(path.joints) - set(BASE_POSE) <= set(record.robot.joint_names) else None


def _model_paths(path: PathComparison | None, diagnosis: Document) -> dict[str, Array]:
    """Where simulators of a diagnosis take the robot, by what they are."""
    if path is None:
        return {}
    models = {"the simulator as it was": path.nominal}
    models |= {"the simulator with the effects": path.identified} if diagnosis.get("effects") else {}
    return {name: at for name, at in models.items() if np.abs(at - path.measured).max() < np.pi}


# How well the chosen motions excite each segment.


def show_excitation(findings: Findings) -> Shown:
    """Condition numbers of the segments, before and after where both are known."""
    plan, change = (findings.plan or {}).get("conditioning"), findings.data.conditioning
    if plan is None and change is None:
        return ""
    content = [
        "The shorter a bar, the more evenly the motions excite that segment's ten inertial parameters."
    ]
    if change is not None:
        svg = to_svg(draw_conditioning(change), "conditioning", "Condition number of each segment")
        content.append(inline_figure(svg))
    if plan is not None:
        full, log_det = format_number(condition_value(plan["full"])), format_number(plan["log_det"])
        numbers = f"the condition number is {full}, the log-determinant of the information {log_det}."
        content.append(html_paragraph(f"Over all {plan['n_base_parameters']} base parameters {numbers}"))
        columns: Columns = {
            "segment": "segment",
            "condition number": lambda row: condition_value(row["condition"]),
        }
        listing = columns_table(plan["segments"], columns)
        content.append(folded_content("Condition number of each segment", listing))
    return content


def draw_conditioning(data: ConditioningComparison) -> Any:
    """Log bars, one row a segment: pale before, strong after; what nothing excites reaches the edge."""
    pairs = zip(data.before, data.after, strict=True)
    return draw_bars(
        Bars(
            data.segments,
            data.before,
            data.after,
            (data.before_label, data.after_label),
            "condition number of the segment's ten columns (no unit, log scale, less is better)",
            log=True,
            texts=[" → ".join(f"{value:.3g}".replace("inf", "∞") for value in pair) for pair in pairs],
        )
    )


# What refuses candidates: how many, and the worst of each.

# Lines of the table that are not folded away.
_LISTED = 8

_REFUSED: Columns = {
    "reason": lambda item: item["reason"].replace("_", " "),
    "where": "where",
    "candidates": "candidates",
    "worst": lambda item: _value_text(item, "worst"),
    "limit": lambda item: _value_text(item, "limit"),
    "at [s]": "time_s",
}
_BARE: Document = {"where": "–", "worst": None, "limit": None, "unit": "", "time_s": None}


def show_refused(findings: Findings) -> Shown:
    """The table of what refuses candidates."""
    if findings.plan is None:
        return ""
    candidates, refused = findings.plan["candidates"], findings.plan["refused"]
    # What is told by no distance, as a fall in the rehearsal, has a number of candidates alone.
    measured = {item["reason"] for item in refused}
    others = candidates["rejected"].items()
    refused = refused + [_BARE | {"reason": r, "candidates": n} for r, n in others if r not in measured]
    if not refused:
        return ""
    lead = (
        f"Of {candidates['generated']} candidates. One that breaks several limits counts with each. Limits are "
        "planning's, which keeps a reserve to what the check asks for; no time is stated of what is refused as a "
        "posture."
    )
    more = refused[_LISTED:]
    folded = folded_content(f"{len(more)} more", columns_table(more, _REFUSED)) if more else ""
    return [lead, columns_table(refused[:_LISTED], _REFUSED), folded]


def _value_text(item: Document, key: str) -> str:
    """``worst`` or ``limit`` of a refusal with its unit."""
    return "–" if item[key] is None else f"{format_number(item[key])} {item['unit']}".strip()


# The independent verdict on the chosen motions.

_VIOLATIONS: Columns = {
    **{"motion": "motion", "kind": "kind", "time [s]": "time_s", "where": "where"},
    **{"value": "value", "limit": "limit", "unit": "unit"},
}


def show_safety(findings: Findings) -> Shown:
    """Smallest margins over all motions, every motion's own, violations."""
    if findings.check is None:
        return ""
    motions = findings.check["motions"]
    lead = (
        "How far the motions stay from every limit at the worst instant, by a check independent of the "
        "repairs; a margin that could not be computed counts as unsafe."
    )
    held = {one: None for motion in motions for one in motion.get("as_far_as", ())}
    if held:
        lead += f" What is safe here is safe{conditions(held)}."
    smallest: list[tuple[Cell, ...]] = []
    every: dict[str, Any] = {"motion": "motion", "safe": "safe"}
    for name, (title, usual) in MARGINS.items():
        if all(name in motion["not_applicable"] for motion in motions):
            continue
        # A margin in each unit that it has: of joints that slide and of those that turn.
        units = [one["unit"] for motion in motions for one in motion["nearest"].get(name, ())]
        for unit in dict.fromkeys(sorted(units, reverse=True) or [usual]):
            column = f"{title} [{unit}]"
            known = [
                (value, where, motion["motion"])
                for motion in motions
                for value, where in [_motion_margin(name, unit, motion)]
                if value is not None
            ]
            least = min(known, key=lambda one: one[0], default=(None, "", "not computed"))
            smallest.append((column, *least))
            every[column] = lambda motion, name=name, unit=unit: _motion_margin(name, unit, motion)[0]
    violations = [{**one, "motion": m["motion"]} for m in motions for one in m["violations"]]
    return [
        lead,
        html_table(("margin", "smallest", "of", "in motion"), smallest),
        folded_content(f"Margins of all {count(len(motions), 'motion')}", columns_table(motions, every)),
        "<h3>Violations</h3>" + columns_table(violations, _VIOLATIONS) if violations else "",
    ]


def _motion_margin(name: str, unit: str, motion: Document) -> tuple[float | None, str]:
    """A motion's margin, None where it was not computed, and the joint whose it is, where that is known."""
    nearest = motion["nearest"].get(name, ())
    if not nearest:
        return motion["margins"].get(name), ""
    return next(((one["value"], one["where"]) for one in nearest if one["unit"] == unit), (None, ""))


# What no file said of the robot, and what follows from the values taken for it.


def show_assumed(findings: Findings) -> Shown:
    """Everything that the robot's description assumed."""
    assumed = (findings.plan or findings.check or {}).get("assumed", [])
    if not assumed:
        return ""
    return [
        "Neither the model nor its maker's files say these things of the robot. What the page finds safe is safe "
        "as far as they hold: state in robot.yaml what is known better, take it out of the list assumed there, and "
        "plan again.",
        columns_table(assumed, {"what": "what", "taken": "value", "what follows": "consequence"}),
    ]
