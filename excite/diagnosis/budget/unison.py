"""Whether a motion moves the joints one by one, or all on one line: which place a gap has is then not told."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.equations.baseline import Baseline
from excite.finding import Finding


def independent_joints(q: Array) -> float:
    """How many joints move independently in positions ``(n, n_joints)``: the exponential of an entropy.

    Of the shares that the principal directions of the joints' motion have, each joint's by its own deviation (Roy,
    Vetterli 2007, effective rank).
    """
    moved = q - q.mean(axis=0)
    size = moved.std(axis=0)
    moved = moved[:, size > 1e-6] / size[size > 1e-6]
    if not moved.shape[1]:
        return 0.0
    share = np.linalg.svd(moved.T @ moved, compute_uv=False)
    share = share[share > 0.0] / share.sum()
    return float(np.exp(-(share * np.log(share)).sum()))


def unison(baseline: Baseline) -> Finding | None:
    """The finding that joints move in unison, with what is determined all the same; None where they do not.

    Args:
        baseline: what is modelled, fitted.
    """
    samples = baseline.samples
    q = samples.stacked("q")[:, list(samples.index)]
    count = independent_joints(q)
    if len(samples.joints) < 3 or count >= THRESHOLDS.unison * len(samples.joints):
        return None
    scales = torque_scales(baseline)
    said = ", ".join(f"{name} {value:.3g}" for name, value in scales.items())
    return Finding(
        kind="unison",
        text=(
            f"the joints move in unison: {count:.1f} of {len(samples.joints)} directions are independent, so what "
            "acts at one joint looks like what acts at another, or like a body; what is determined is each joint's "
            f"torque over the model's along that one path ({said})"
        ),
        figures={"independent": count, **{f"torque_scale.{name}": value for name, value in scales.items()}},
        places=samples.joints,
        severity="limits",
        remedy="record motions that move the joints one after the other, or at different rates",
    )


def torque_scales(baseline: Baseline) -> dict[str, float]:
    """Measured torque per torque of the nominal rigid bodies, by joint, beside friction and a constant."""
    samples, scales = baseline.samples, {}
    use = samples.identification
    tau = samples.rows([t.tau for t in samples.trials])[use]
    nominal = tau - (baseline.solver.equations.y / baseline.root_weight).T[use]
    sign = samples.rows(np.column_stack([np.tanh(t) for t in _speeds(baseline)]))[use]
    speed = samples.rows(np.column_stack(_speeds(baseline)))[use]
    for j, name in enumerate(samples.joints):
        columns = np.column_stack([nominal[:, j], np.ones(len(tau)), sign[:, j], speed[:, j]])
        if nominal[:, j].std() > THRESHOLDS.load * tau[:, j].std():
            scales[name] = float(np.linalg.lstsq(columns, tau[:, j], rcond=1e-10)[0][0])
    return scales


def _speeds(baseline: Baseline) -> list[Array]:
    """Velocity of each joint over the width of its friction's change of sign."""
    v = baseline.samples.stacked("v")
    return [v[:, i] / sign.width for i, sign in zip(baseline.samples.index, baseline.signs, strict=True)]
