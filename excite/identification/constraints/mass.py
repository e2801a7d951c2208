"""Masses are not negative and add up to the total (eq. 8 and 9 of Jovic et al., T-RO 2016)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.identification.constraints.linear import LinearConstraints
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, least_squares, minimum_norm

_IN_ROW_SPACE = 1e-6


def non_negative_masses(problem: IdentificationProblem) -> LinearConstraints:
    """``m_i ≥ 0`` for every segment, and every drive's friction and armature ≥ 0."""
    names = problem.parameter_names
    columns = [*range(0, problem.n_inertial, 10)]
    # An offset may have either sign; a drive cannot feed energy or have negative inertia.
    kinds = ("viscous.", "coulomb.", "armature.")
    columns += [j for j in range(problem.n_inertial, problem.n_params) if names[j].startswith(kinds)]
    matrix = np.zeros((len(columns), problem.n_params))
    matrix[np.arange(len(columns)), columns] = 1.0
    labels = tuple(f"non_negative:{names[j]}" for j in columns)
    return LinearConstraints(matrix, np.zeros(len(columns)), labels)


@dataclass(frozen=True)
class TotalMass:
    """Mass of all segments as the measured forces say it.

    Attributes:
        value: [kg], unmeasured segments counted with their nominal mass.
        std: standard deviation [kg]; infinite where the rows do not determine the total mass.
        identifiable: whether the rows determine it.
    """

    value: float
    std: float
    identifiable: bool


def measured_total_mass(rows: Regression) -> TotalMass:
    """Total mass from the forces, where the rows determine it (a robot that stands; not an arm on a table).

    The sum of the masses is a combination of base parameters on a floating base, so the least-squares
    solution determines it whatever the individual masses are.
    """
    problem = rows.problem
    total = np.zeros(problem.n_params)
    total[: problem.n_inertial : 10] = 1.0
    unmeasured = np.zeros(problem.n_params, dtype=bool)
    for segment in problem.unmeasured:
        unmeasured[10 * segment : 10 * segment + 10] = True
    seen = np.where(unmeasured, 0.0, total)
    a = rows.factor[:, :-1]
    norms = np.linalg.norm(a, axis=0)
    used = norms > 1e-12 * max(float(norms.max()), 1e-300)
    scaled, wanted = a[:, used] / norms[used], seen[used] / norms[used]
    influence = minimum_norm(scaled.T, wanted)
    missing = np.linalg.norm(scaled.T @ influence - wanted) / max(float(np.linalg.norm(wanted)), 1e-300)
    if missing > _IN_ROW_SPACE or bool(np.any(seen[~used] != 0.0)):
        return TotalMass(float(total @ problem.prior), float("inf"), False)
    scales = np.where(used, 1.0 / np.where(used, norms, 1.0), 0.0)
    fit = least_squares(rows.factor, center=problem.prior, scales=scales)
    inflation = 1.0 if rows.noise is None else float(rows.noise.inflation.max())
    return TotalMass(float(total @ fit), float(np.linalg.norm(influence) * np.sqrt(inflation)), True)


def total_mass(problem: IdentificationProblem, mass: float) -> LinearConstraints:
    """``Σ m_i = mass`` over all segments, those that the sensors do not see included."""
    row = np.zeros((1, problem.n_params))
    row[0, : problem.n_inertial : 10] = 1.0
    return LinearConstraints(row, np.array([mass]), ("total_mass:robot",), 1)
