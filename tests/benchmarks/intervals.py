"""Coverage of nominal 95 % intervals over 200 draws of noise, beside what other tools' formulae promise.

``python -m tests.benchmarks --only intervals``; ``EXCITE_DRAWS`` changes the number of draws, and
``EXCITE_JOBS`` the number of processes, of which the result does not depend.
"""

from __future__ import annotations

import os

import numpy as np
from joblib import Parallel, delayed

from tests.benchmarks.table import Row
from tests.identification.coverage import CASES, Case, Experiment

DRAWS = int(os.environ.get("EXCITE_DRAWS", "200"))
JOBS = int(os.environ.get("EXCITE_JOBS", "2"))
LOW, HIGH = 0.93, 0.97


def rows() -> list[Row]:
    """One row for each robot and treatment of the log; errors in the regressor last."""
    jobs = [("panda", case, 12.0, 0.0) for case in CASES]
    jobs += [("g1", case, 24.0, 0.0) for case in CASES]
    jobs += [("panda", Case(5.0, every=10), 12.0, encoder) for encoder in (1e-4, 1e-3)]
    return Parallel(n_jobs=JOBS)(delayed(row)(*job) for job in jobs)


def row(robot: str, case: Case, duration: float, encoder: float) -> Row:
    """Coverage over all parameters and draws, and its range over single parameters, which chance alone spreads."""
    experiment = Experiment(robot, case, duration, encoder=encoder)
    covered = experiment.coverage(range(DRAWS), {"white": white_formula, "sysid": sysid_formula})
    ours = covered["ours"]
    white, sysid = (100 * covered[name].mean() for name in ("white", "sysid"))
    noisy = f", encoder noise {encoder:g} rad in the regressor" if encoder else ""
    return Row.holds(
        f"95 % intervals, {robot}, {case}{noisy}: truth inside (FIGAROH's formula {white:.0f}, "
        f"mujoco.sysid's {sysid:.0f} %)",
        "93–97 %",
        f"{100 * ours.mean():.1f} % (single parameters {100 * ours.min():.0f}–{100 * ours.max():.0f})",
        LOW <= ours.mean() <= HIGH,
    )


def white_formula(experiment: Experiment, seed: int, columns: np.ndarray) -> np.ndarray:
    """Ordinary least squares, ``σ² (XᵀX)⁻¹`` with ``σ² = ‖r‖²/(n − b)``, all rows alike and independent.

    What FIGAROH 1.0.2 prints as relative standard deviation (eq. 7 of Xu et al. 2020).
    """
    return _inside(experiment, seed, columns, weighted=False)


def sysid_formula(experiment: Experiment, seed: int, columns: np.ndarray) -> np.ndarray:
    """The same on residuals divided by each channel's own level, as mujoco.sysid weights them.

    Its ``calculate_intervals``: ``s² (JᵀJ)⁻¹`` with ``s² = ‖r‖²/(n − b)`` and Student's quantile, which for
    so many rows is the normal one.
    """
    return _inside(experiment, seed, columns, weighted=True)


def _inside(experiment: Experiment, seed: int, columns: np.ndarray, *, weighted: bool) -> np.ndarray:
    problem = experiment.problem(seed)
    weight = problem.weights if weighted else np.ones(problem.n_rows)
    if experiment.encoder > 0.0:
        q, r = np.linalg.qr(problem.Y[:, columns] * weight[:, None])
    else:
        q, r = experiment.orthonormal(columns, weighted=weighted)
    y = problem.y * weight
    projected = q.T @ y
    estimate = np.linalg.solve(r, projected)
    # Of an orthonormal basis the residual's square needs no second product with the tall matrix.
    variance = (y @ y - projected @ projected) / (len(y) - len(columns))
    inverse = np.linalg.solve(r, np.eye(len(r)))
    std = np.sqrt(variance * (inverse**2).sum(axis=1))
    truth = experiment.true_base(columns)
    return np.abs(estimate - truth) < 1.96 * std
