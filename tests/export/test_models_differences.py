"""The table nominal → identified, and the uncertainty in it."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from excite.export.models.parameters import find_differences, save_differences
from excite.identification.parameter_statistics import parameter_uncertainty
from excite.identification.regression import condense_problem, iterate_weights, prior_std
from excite.identification.statistics import base_statistics
from excite.robot.loading import load_robot
from tests.export.identified import identification_of
from tests.identification.synthetic import arm_rows, assemble


def test_every_parameter_is_in_the_table_with_its_own_numbers(tmp_path: Path) -> None:
    robot = load_robot("ur10")
    parameters = robot.nominal_parameters.copy()
    parameters[51:54] += 0.5
    found = identification_of(robot, parameters)
    table = save_differences(
        find_differences(found.to_json()["standard_parameters"]), tmp_path / "differences.csv"
    )
    rows = list(csv.DictReader(io.StringIO(table.read_text())))
    assert [row["link"] for row in rows[::10]] == [segment.link for segment in robot.segments]
    assert len(rows) == 60
    names = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    for k, segment in enumerate(robot.segments):
        for i, name in enumerate(names):
            (row,) = (r for r in rows if (r["link"], r["parameter"]) == (segment.link, name))
            column = 10 * k + i
            assert float(row["nominal"]) == robot.nominal_parameters[column]
            assert float(row["identified"]) == parameters[column]
            assert float(row["determined"]) == found.uncertainty.determined[column]
    assert [(r["link"], r["parameter"]) for r in rows if r["clear"] == "1"] == [
        ("wrist_3_link", axis) for axis in ("mx", "my", "mz")
    ]


def test_a_document_without_nominal_values_gives_no_table() -> None:
    assert find_differences({"a": {"mass": 1.0, "first_moment": [0, 0, 0], "inertia": [1] * 6}}) == ()


def test_uncertainty_is_that_of_data_and_prior_together() -> None:
    """Against the normal equations of all rows with the prior as further rows."""
    robot = load_robot("ur10")
    rng, time = np.random.default_rng(3), np.arange(0.0, 10.0, 0.05)
    rows = arm_rows(robot, rng, time).reshape(-1, 60)
    measured = 1.05 * rows @ robot.nominal_parameters + rng.normal(size=len(rows))
    names = [f"p{k}" for k in range(60)]
    problem = assemble(robot, [rows], [measured], robot.joint_names, np.ones(6), time, names)
    statistics = base_statistics(iterate_weights(condense_problem(problem)))
    spread = np.full(6, 0.5)
    found = parameter_uncertainty(problem, statistics, spread)
    prior = prior_std(problem, spread)
    matrix = statistics.base.matrix
    information = matrix.T @ np.linalg.solve(statistics.covariance, matrix)
    scaled = prior[:, None] * information * prior
    posterior = np.linalg.inv(scaled + np.eye(len(prior)))
    np.testing.assert_allclose(found.std, prior * np.sqrt(np.diag(posterior)), rtol=1e-4)
    assert ((found.determined >= 0.0) & (found.determined <= 1.0)).all()
    # The base's vertical axis: the first link's mass shows nowhere, its moment about that axis does.
    assert found.determined[0] == pytest.approx(0.0, abs=1e-9) and found.std[0] == pytest.approx(prior[0])
    assert found.determined[[51, 53]].min() > 0.9
