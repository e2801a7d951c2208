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
# Base rows of the humanoid are tall; these cases span the table at bearable cost.
HUMANOID = (Case(20.0, every=10), Case(10.0, every=10), Case(5.0), Case(5.0, every=10), Case(5.0, 1000.0, 10))


def rows() -> list[Row]:
    """One row for each robot and treatment of the log; errors in the regressor last."""
    jobs = [("panda", case, 12.0, 0.0) for case in CASES]
    jobs += [("g1", case, 24.0, 0.0) for case in HUMANOID]
    jobs += [("panda", Case(5.0, every=10), 12.0, encoder) for encoder in (1e-4, 1e-3)]
    return Parallel(n_jobs=JOBS)(delayed(_row)(*job) for job in jobs)


def _row(robot: str, case: Case, duration: float, encoder: float) -> Row:
    experiment = Experiment(robot, case, duration, encoder=encoder)
    covered = experiment.coverage(range(DRAWS), {"white": white_formula, "sysid": sysid_formula})
    ours = covered["ours"]
    others = f"white formula {100 * covered['white']:.0f}, sysid's {100 * covered['sysid']:.0f}"
    noisy = f", encoder noise {encoder:g} rad in the regressor" if encoder else ""
    return Row.holds(
        f"95 % intervals, {robot}, {case}{noisy}: truth inside ({others} %)",
        "93–97 %",
        f"{100 * ours:.1f} %",
        LOW <= ours <= HIGH,
    )


def white_formula(experiment: Experiment, seed: int, columns: np.ndarray) -> np.ndarray:
    """Ordinary least squares, ``σ² (XᵀX)⁻¹`` with ``σ² = ‖r‖²/(n − b)``, all rows alike and independent.

    What FIGAROH 1.0.2 prints as relative standard deviation (eq. 7 of Xu et al. 2020).
    """
    problem = experiment.problem(seed)
    return _inside(experiment, problem.Y[:, columns], problem.y, columns)


def sysid_formula(experiment: Experiment, seed: int, columns: np.ndarray) -> np.ndarray:
    """The same on residuals divided by each channel's own level, as mujoco.sysid weights them.

    Its ``calculate_intervals``: ``s² (JᵀJ)⁻¹`` with ``s² = ‖r‖²/(n − b)`` and Student's quantile, which for
    so many rows is the normal one.
    """
    problem = experiment.problem(seed)
    weight = 1.0 / experiment.sigma[problem.channel]
    return _inside(experiment, problem.Y[:, columns] * weight[:, None], problem.y * weight, columns)


def _inside(experiment: Experiment, x: np.ndarray, y: np.ndarray, columns: np.ndarray) -> np.ndarray:
    q, r = np.linalg.qr(x)
    estimate = np.linalg.solve(r, q.T @ y)
    variance = (y - x @ estimate) @ (y - x @ estimate) / (len(y) - len(columns))
    inverse = np.linalg.solve(r, np.eye(len(r)))
    std = np.sqrt(variance * (inverse**2).sum(axis=1))
    truth = experiment.true_base(columns)
    return np.abs(estimate - truth) < 1.96 * std
