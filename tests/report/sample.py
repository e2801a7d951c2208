"""A results folder with made-up but plausible contents, for a robot with or without feet."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.motion.files import save_motion
from excite.motion.motion import Motion, MotionMetadata
from excite.report.comparisons import (
    ConditioningComparison,
    ForceComparison,
    MassComparison,
    PathComparison,
    ReportData,
    save_report_data,
)
from excite.robot.robot import Robot
from tests.report.diagnosed import budgeted, trial

_WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
_GENERATORS = ("random_joint", "walking", "fourier")


def sample_motion(robot: Robot, seed: int, n: int = 200) -> Motion:
    """Joints swing about the rest posture; a free base sinks so that the lowest sole stays on the ground."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 6.0, n)
    rest = robot.rest[robot.n_base_q :]
    room = np.minimum(robot.limits.position_upper - rest, rest - robot.limits.position_lower)
    amplitude = 0.7 * room * rng.uniform(size=robot.n_joints) * (rng.uniform(size=robot.n_joints) < 0.5)
    amplitude[: 6 * len(robot.feet)] *= 0.2
    phase = 2.0 * np.pi * rng.uniform(0.2, 0.6, robot.n_joints) * time[:, None]
    q = rest + np.sin(np.pi * time / time[-1])[:, None] ** 2 * amplitude * np.sin(phase)
    v = np.gradient(q, time, axis=0)
    a = np.gradient(v, time, axis=0)
    if robot.floating:
        q = np.hstack([np.tile(robot.rest[:7], (n, 1)), q])
        v, a = (np.hstack([np.zeros((n, 6)), block]) for block in (v, a))
        data = robot.model.createData()
        for row in q:
            pin.forwardKinematics(robot.model, data, row)
            row[2] -= min(data.oMi[foot.joint].act(corner)[2] for foot in robot.feet for corner in foot.sole)
    targets = tuple(robot.joint_names[i] for i in np.argsort(-amplitude)[:2])
    metadata = MotionMetadata(_GENERATORS[seed % 3], seed, targets, robot.hash)
    contacts = {foot.name: np.ones(n, dtype=bool) for foot in robot.feet}
    return Motion(f"motion_{seed:02d}", robot.name, robot.joint_names, time, q, v, a, contacts, metadata)


def sample_data(robot: Robot) -> ReportData:
    """Forces, masses and condition numbers; two segments are heavier than the model says."""
    rng = np.random.default_rng(0)
    names = tuple(segment.name.removesuffix("_link").replace("_", " ") for segment in robot.segments)
    n = len(names)
    before = 10.0 ** rng.uniform(1.0, 4.0, n)
    after = before**0.6
    before[-1] = np.inf
    nominal_mass = robot.nominal_parameters[::10]
    true_mass = nominal_mass.copy()
    true_mass[[n // 2, n - 1]] += [2.5, 0.8]
    channels = _WRENCH if robot.floating else robot.joint_names
    time = np.arange(1600) / 200.0
    size = (len(time), len(channels))
    clean = rng.uniform(5, 20, size[1]) * np.sin(time[:, None] * rng.uniform(2, 8, size[1]))
    nominal = 0.85 * clean + np.sin(3.0 * time)[:, None]
    if robot.floating:
        clean[:, 2] += (robot.mass + 5.0) * 9.81
        nominal[:, 2] += robot.mass * 9.81
    return ReportData(
        forces=ForceComparison(
            trial="trial_05",
            channels=channels,
            units=("N",) * 3 + ("N·m",) * 3 if robot.floating else ("N·m",) * size[1],
            time=time,
            measured=clean + rng.normal(0.0, 0.8, size),
            nominal=nominal,
            identified=clean + rng.normal(0.0, 0.1, size),
        ),
        masses=MassComparison(
            names,
            nominal_mass,
            true_mass + rng.normal(0.0, 0.03, n),
            true_mass,
            true_mass > nominal_mass + 0.1,
            half_width=0.05 + 0.1 * nominal_mass * rng.uniform(0.0, 1.0, n),
            determined=rng.uniform(0.0, 1.0, n),
        ),
        conditioning=ConditioningComparison(
            names, before, after, 18200.0, 212.0, "one motion", "6 chosen motions"
        ),
        gap=trial(),
        path=sample_path(robot),
    )


def sample_path(robot: Robot) -> PathComparison:
    """A trial, a simulator that strays in the last joint, and one with effects that strays a tenth as far."""
    motion = sample_motion(robot, 0)
    measured = motion.joint_positions()
    stray = np.zeros_like(measured)
    stray[:, -1] = 0.3 * np.sin(motion.time)
    return PathComparison(
        "trial_05", robot.joint_names, motion.time, measured, measured + stray, measured + 0.1 * stray
    )


def sample_folder(folder: Path, robot: Robot, n_motions: int = 6) -> Path:
    """Write all files that a campaign leaves behind."""
    motions = [sample_motion(robot, seed) for seed in range(n_motions)]
    for motion in motions:
        save_motion(motion, folder / "motions" / f"{motion.name}.parquet")
    data = sample_data(robot)
    save_report_data(data, folder / "report_data.npz")
    for name, document in {
        "plan": _plan(robot, motions, data),
        "check": _check(motions),
        "campaign": _campaign(robot, data),
        "diagnosis": budgeted().to_json(),
    }.items():
        (folder / f"{name}.json").write_text(json.dumps(document), encoding="utf-8")
    return folder


def _plan(robot: Robot, motions: list[Motion], data: ReportData) -> dict:
    change = data.conditioning
    return {
        "schema": "excite.plan/1",
        "robot": robot.name,
        "candidates": {
            "generated": 140,
            "accepted": 118,
            "rejected": {"self_collision": 17, "zmp": 4, "time_limit": 1},
        },
        "refused": [
            {
                "reason": "zmp",
                "where": "feet",
                "candidates": 4,
                "worst": -0.0314,
                "limit": 0.015,
                "unit": "m",
                "time_s": 1.5,
                "candidate": "squat_003",
            }
        ],
        "assumed": [
            {"what": "friction of soles", "value": "0.5", "consequence": "feet may slip on a smoother floor"}
        ],
        "selected": [
            {
                "motion": f"motions/{motion.name}.parquet",
                "segments": [robot.segments[i % len(robot.segments)].name],
                "duration_s": motion.duration,
            }
            for i, motion in enumerate(motions)
        ],
        "conditioning": {
            "full": 212.0,
            "log_det": 812.4,
            "n_base_parameters": 190,
            "segments": [
                {"segment": name, "condition": float(value)}
                for name, value in zip(change.segments, change.after, strict=True)
            ],
        },
        "stages": [{"stage": "generate", "seconds": 3.2}, {"stage": "filter", "seconds": 11.9}],
    }


def _check(motions: list[Motion]) -> dict:
    margins = {
        "joint_position_rad": 0.031,
        "joint_velocity_rad_s": 0.42,
        "joint_acceleration_rad_s2": 3.1,
        "joint_torque_nm": 5.5,
        "self_collision_m": 0.0121,
        "zmp_m": 0.0154,
    }
    rows = [
        {
            "motion": m.name,
            "safe": True,
            "margins": {k: v * (1 + 0.1 * i) for k, v in margins.items()},
            "violations": [],
        }
        for i, m in enumerate(motions)
    ]
    rows[-1] |= {
        "safe": False,
        "margins": margins | {"zmp_m": None, "self_collision_m": -0.004},
        "violations": [
            {
                "kind": "self_collision",
                "time_s": 2.35,
                "where": "left_hand – torso",
                "value": -0.004,
                "limit": 0.01,
            }
        ],
    }
    return {"schema": "excite.check/1", "safe": False, "motions": rows}


def _standard_parameters(robot: Robot, data: ReportData) -> dict:
    found = {}
    nominal = robot.nominal_parameters.reshape(-1, 10)
    for k, segment in enumerate(robot.segments):
        blocks = {}
        for name, row in {
            "": nominal[k] * data.masses.true[k] / max(nominal[k, 0], 1e-9),
            "nominal": nominal[k],
            "std": 0.01 * np.abs(nominal[k]),
            "determined": np.full(10, 0.9),
        }.items():
            order = [0, 2, 5, 1, 3, 4]
            blocks[name] = {
                "mass": float(row[0]),
                "first_moment": row[1:4].tolist(),
                "inertia": row[4:][order].tolist(),
            }
        found[segment.link] = {**blocks.pop(""), "name": segment.name, **blocks}
    return found


def _sessions() -> dict:
    days = {"monday": {"value": 0.4, "std": 0.02}, "tuesday": {"value": 0.7, "std": 0.02}}
    one = {
        "name": "viscous(knee)",
        "expression": "viscous(knee)",
        "value": 0.55,
        "between_std": 0.2,
        "varies": True,
        "low": 0.0,
        "high": 1.9,
        "by_session": days,
    }
    return {"names": list(days), "left_out": {}, "level": 0.95, "parameters": [one]}


def _campaign(robot: Robot, data: ReportData) -> dict:
    rng = np.random.default_rng(1)
    first = 10.0 ** rng.normal(0.7, 0.6, 190)
    names = [f"mx[{i}] + 0.1·m[{i + 1}]" for i in range(190)]
    iterations = []
    for factor, n_motions in ((1.0, 12), (0.6, 21), (0.4, 27)):
        rsd = {name: float(value * factor) for name, value in zip(names, first, strict=True)}
        missed = [name for name, value in rsd.items() if value > 15.0]
        iterations.append({"n_motions": n_motions, "rsd_percent": rsd, "not_met": missed})
    fit = {
        channel: {"rmse": 0.9, "cc": 0.99, "reference_rmse": 3.7, "reference_cc": 0.91}
        for channel in data.forces.channels
    }
    identification = {
        "schema": "excite.identification/1",
        "robot": robot.name,
        "method": "qp",
        "sessions": _sessions(),
        "n_samples": 48000,
        "standard_parameters": _standard_parameters(robot, data),
        "base_parameters": [
            {"expression": name, "value": 0.5, "std": 0.005 * value, "rsd_percent": float(value)}
            for name, value in zip(names, first, strict=True)
        ],
        "essential": names[:40],
        "consistency": {
            "mass_positive": True,
            "inertia_positive_definite": True,
            "triangle_inequality": False,
            "pseudo_inertia_min_eigenvalue": -1.2e-4,
        },
        "fit": fit,
        "validation": fit,
        "warnings": ["torque of waist_yaw is clipped in 12 samples <of trial_03>"],
    }
    return {
        "schema": "excite.campaign/1",
        "iterations": iterations,
        "targets_met": False,
        "target_rsd_percent": 15.0,
        "identification": identification,
    }
