"""A diagnosis of two joints with made-up numbers, and the curves of a trial."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.diagnosis.answer.answer import Absorbed, Diagnosis, NextExperiment, Rollout
from excite.diagnosis.answer.candidate import Candidate, Estimate
from excite.diagnosis.answer.gap import (
    Budget,
    ChannelBudget,
    ChannelGap,
    EffectShare,
    Gap,
    TrivialErrors,
    UnnamedShare,
    Where,
)
from excite.finding import Finding
from excite.report.comparisons import ForceComparison


def candidate(effect: str, place: str, evidence: float, **sizes: float) -> Candidate:
    values = {name: Estimate(value, 0.01, "N·m") for name, value in sizes.items()}
    return Candidate(effect, place, values, evidence, 0.02, 0.97, (place,))


def two_joints_diagnosed() -> Diagnosis:
    spring, play = (
        candidate("joint_spring", "shoulder", 812.0, torque_at_zero=0.75),
        candidate("backlash", "elbow", 90.0),
    )
    rival = candidate("torque_bias", "shoulder", 31.0, bias=0.62)
    channels = {"shoulder": ChannelGap(3.0, 0.25, 0.2), "elbow": ChannelGap(0.2, 0.1, 0.1)}
    return Diagnosis(
        robot="arm <of mine>",
        verdict="effect",
        effect="joint_spring",
        location="shoulder",
        tied_locations=("shoulder",),
        candidates=(spring, rival),
        effects=(spring, play),
        gap=Gap(0.31, 0.04, 0.03, 0.993, channels, (0.93, 0.999)),
        where=(
            Where("shoulder", 0.95, "position", (0.1, 1.5), {"velocity": 0.02, "position": 0.87}),
            Where("elbow", 0.05, "nothing known", (0.5, 8.0), {"velocity": 0.01, "position": 0.0}),
        ),
        simulation=Rollout(
            before={"shoulder": 0.05, "elbow": 0.02},
            after={"shoulder": 0.005, "elbow": 0.004},
            horizon_s=0.5,
            model="augmented.xml",
            warnings=("the simulator ignores something",),
        ),
        next_experiment=NextExperiment("move the elbow with its load", ("backlash",), "next.parquet"),
        faults=(
            Finding(
                "clipped",
                "elbow clips in 12 samples <of a>",
                {},
                ("tau.elbow",),
                severity="limits",
                remedy="a limit",
            ),
        ),
        warnings=("judged on one trial",),
    )


def budgeted() -> Diagnosis:
    """The same with a budget and what repeats differ by."""
    shoulder = ChannelBudget(
        0.05,
        0.41,
        (
            EffectShare("coulomb_friction", "shoulder", 0.63, (0.55, 0.70)),
            EffectShare("torque_bias", "shoulder", 0.1, (-0.1, 0.3)),
            EffectShare("backlash", "shoulder", -0.05, (-0.3, 0.1)),
        ),
        (UnnamedShare("position", 0.2, (0.0, 1.0), (0.0, 0.3)), UnnamedShare("does not repeat", 0.02)),
        0.1,
        0.985,
        "N·m",
    )
    elbow = ChannelBudget(0.1, 0.12, (), (), 1.0, 0.015, "N·m")
    return replace(
        two_joints_diagnosed(),
        budget=Budget({"elbow": elbow, "shoulder": shoulder}, ()),
        absorbed=(
            Absorbed("shoulder", "coulomb_friction", Estimate(1.52, 0.02, "N·m"), (1.46, 1.58)),
            Absorbed("elbow", "kp", Estimate(210.0, None, "N·m/rad")),
        ),
        trivial={name: TrivialErrors(repeat=0.02, model=0.3, unit="N·m") for name in ("shoulder", "elbow")},
    )


def ambiguous(diagnosis: Diagnosis) -> Diagnosis:
    return replace(diagnosis, verdict="ambiguous", n_tied=2, effects=diagnosis.effects[:1])


def unknown(diagnosis: Diagnosis) -> Diagnosis:
    gap = replace(diagnosis.gap, after=diagnosis.gap.before, share_closed=0.0, interval=None)
    return replace(diagnosis, verdict="unknown", effect=None, effects=(), gap=gap)


def trial() -> ForceComparison:
    time = np.linspace(0.0, 2.0, 101)
    true = np.column_stack([np.sin(3.0 * time), np.cos(2.0 * time)])
    return ForceComparison(
        "val", ("shoulder", "elbow"), ("N·m", "N·m"), time, true, true - [0.7, 0.1], true + 0.01
    )
