"""The baseline with an effect in it that was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution.hypotheses import Hypothesis
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Solver


def extended(item: Hypothesis) -> Baseline:
    """The baseline with an effect in it: its columns shared ones with hardly any prior, its offset taken off."""
    baseline, fit = item.baseline, item.fit
    e = baseline.solver.equations
    y, shared, basis = e.y, e.shared, baseline.basis
    if item.columns.offset is not None:
        y = y - item.columns.offset
    if (fitted := item.fitted) is not None:
        scale = 10.0 * np.maximum(np.abs(fit.extra), 10.0 * np.maximum(fit.extra_std, 1e-12))
        if item.direction is not None:
            scale = np.array([np.linalg.norm(scale) / np.linalg.norm(item.direction)])
        shared = np.concatenate([shared, fitted * scale], axis=2)
        basis = np.hstack([basis, np.zeros((len(basis), len(scale)))])
    solver = Solver(replace(e, y=y, shared=shared))
    torque = torque_of(item)
    added, drive = baseline.added, baseline.added_drive
    added, drive = (added + torque, drive) if item.effect.moves else (added, drive + torque)
    old = np.concatenate([baseline.fit.shared, np.zeros(basis.shape[1] - len(baseline.fit.shared))])
    fixed = replace(
        baseline,
        solver=solver,
        basis=basis,
        fit=replace(baseline.fit, shared=old, held=None),
        rigid=baseline.rigid + added - baseline.added,
        added=added,
        added_drive=drive,
    )
    return fixed.updated(solver.fit())


def torque_of(item: Hypothesis) -> Array:
    """What a fitted effect adds to the torques at full rate, ``(n_samples, n_joints)`` [N·m]."""
    shape = item.effect.shape(item.context, item.location, item.theta)
    torque = np.zeros_like(item.baseline.rigid)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ item.fit.extra
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque
