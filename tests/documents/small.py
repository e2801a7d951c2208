"""One small document of each kind, with the promised fields alone."""

from __future__ import annotations

from typing import Any

CONDITIONING = {
    "full": 212.0,
    "log_det": None,
    "n_base_parameters": 2,
    "segments": [{"segment": "forearm", "condition": 12.5}, {"segment": "hand", "condition": None}],
}
PLAN = {
    "schema": "excite.plan/1",
    "robot": "arm_of_mine",
    "candidates": {"generated": 14, "accepted": 11, "rejected": {"self_collision": 3}},
    "selected": [
        {"motion": "motions/one.parquet", "segments": ["forearm"], "duration_s": 10.0},
        {"motion": "motions/two.parquet", "segments": [], "duration_s": 8.5},
    ],
    "conditioning": CONDITIONING,
    "stages": [{"stage": "generate", "seconds": 3.2}],
}
MARGINS = {
    "joint_position_rad": 0.031,
    "joint_velocity_rad_s": 0.42,
    "joint_acceleration_rad_s2": 3.1,
    "joint_torque_nm": 5.5,
    "self_collision_m": 0.0121,
    "zmp_m": None,
}
CHECK = {
    "schema": "excite.check/1",
    "safe": False,
    "motions": [
        {"motion": "one", "safe": True, "margins": MARGINS, "not_applicable": ["zmp_m"], "violations": []},
        {
            "motion": "two",
            "safe": False,
            "margins": {**MARGINS, "joint_torque_nm": -1.0},
            "violations": [
                {
                    "kind": "joint_torque",
                    "time_s": 2.35,
                    "where": "elbow_joint",
                    "value": 31.0,
                    "limit": 30.0,
                }
            ],
        },
    ],
}
_TEN = {"mass": 1.5, "first_moment": [0.1, 0.0, 0.2], "inertia": [0.1, 0.1, 0.05, 0.0, 0.0, 0.0]}
_FIT = {"elbow_joint": {"rmse": 0.4, "cc": 0.99, "reference_rmse": 1.2, "reference_cc": 0.9}}
_BASE = {"expression": "Izz(hand) + 0.25·m(hand)", "value": 0.3, "std": 0.01, "rsd_percent": 3.3}
IDENTIFICATION = {
    "schema": "excite.identification/1",
    "robot": "arm_of_mine",
    "method": "qp",
    "n_samples": 1200,
    "standard_parameters": {"hand": {**_TEN, "nominal": _TEN, "name": "hand"}},
    "base_parameters": [_BASE, {**_BASE, "value": 0.0, "rsd_percent": None}],
    "essential": [_BASE],
    "consistency": {
        "mass_positive": True,
        "inertia_positive_definite": True,
        "triangle_inequality": True,
        "pseudo_inertia_min_eigenvalue": 1e-4,
    },
    "fit": _FIT,
    "validation": _FIT,
    "warnings": ["1 of 2 base parameters has an RSD above 30 %"],
}
CAMPAIGN = {
    "schema": "excite.campaign/1",
    "iterations": [
        {"n_motions": 12, "rsd_percent": {"Izz(hand)": 30.0, "m(hand)": None}, "not_met": ["Izz(hand)"]},
        {"n_motions": 3, "rsd_percent": {"Izz(hand)": 9.0, "m(hand)": 4.0}, "not_met": []},
    ],
    "targets_met": True,
    "identification": IDENTIFICATION,
}
_CANDIDATE = {
    "effect": "backlash",
    "location": "elbow_joint",
    "parameters": {"width": {"value": 0.01, "std": None, "unit": "rad"}},
    "evidence": 90.0,
    "gap_after": 0.02,
    "share_closed": 0.97,
}
DIAGNOSIS = {
    "schema": "excite.diagnosis/1",
    "verdict": "effect",
    "effect": "backlash",
    "location": "elbow_joint",
    "tied_locations": ["elbow_joint"],
    "candidates": [_CANDIDATE, {**_CANDIDATE, "effect": "torque_bias"}],
    "effects": [_CANDIDATE],
    "gap": {
        "before": 0.3,
        "after": 0.04,
        "noise_floor": 0.03,
        "share_closed": 0.97,
        "per_channel": {"elbow_joint": {"before": 3.0, "after": 0.25, "noise_floor": 0.2}},
    },
    "simulation": {
        "before": {"elbow_joint": 0.05},
        "after": {"elbow_joint": 0.005},
        "horizon_s": 0.5,
        "model": "augmented.xml",
    },
    "where": [
        {"channel": "elbow_joint", "share": 1.0, "depends_on": "velocity", "band_hz": [0.1, 1.5]},
    ],
    "next_experiment": {"why": "move the elbow slowly", "separates": ["backlash"], "motion": None},
}
JOURNAL = {
    "schema": "excite.journal/1",
    "robot_hash": "0" * 64,
    "settings": {
        "n_candidates": 4,
        "target_rsd": 15.0,
        "max_iterations": 1,
        "method": "qp",
        "seed": 0,
        "on_robot": False,
    },
}
TRUTH = {"schema": "excite.truth/1", "robot": "arm_of_mine", "masses": {"hand": 1.5}}
SMALL: dict[str, dict[str, Any]] = {
    "plan": PLAN,
    "check": CHECK,
    "identification": IDENTIFICATION,
    "campaign": CAMPAIGN,
    "diagnosis": DIAGNOSIS,
    "journal": JOURNAL,
    "truth": TRUTH,
}
"""By the word in the schema."""
