"""Unitree's LowState as JSON or a table: twenty motors, of which a Go2 has twelve, in the vendor's order of legs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.explicit_mapping import Map

pytestmark = pytest.mark.usefixtures("unexamined")

LEGS = ("FR", "FL", "RR", "RL")
MOTORS = [f"{leg}_{joint}_joint" for leg in LEGS for joint in ("hip", "thigh", "calf")]
N, COUNT = 300, 20
FIELDS = {"q": "q", "dq": "v", "tau_est": "tau"}


def motion() -> dict[str, np.ndarray]:
    """Of all motors of the message, ``(N, COUNT)``; of those that the machine lacks zeros."""
    time, k = 0.01 * np.arange(N)[:, None], np.arange(COUNT)[None]
    here = (k < len(MOTORS)).astype(float)
    speed = 1.0 + 0.1 * k
    middle = np.where(k % 3 == 1, 0.8, np.where(k % 3 == 2, -1.6, 0.0))
    q = here * (middle + 0.2 * np.sin(speed * time))
    v = here * 0.2 * speed * np.cos(speed * time)
    return {"q": q, "dq": v, "tau_est": here * (5.0 * q + 0.5 * v - 3.0 * middle)}


def as_json(file: Path, data: dict[str, np.ndarray]) -> Path:
    with file.open("w") as stream:
        for row in range(N):
            motors = [{name: float(data[name][row, k]) for name in FIELDS} for k in range(COUNT)]
            stream.write(json.dumps({"tick": 500 + 10 * row, "motor_state": motors, "power_v": 28.0}) + "\n")
    return file


def as_table(file: Path, data: dict[str, np.ndarray], name: str) -> Path:
    names = ["tick", *(name.format(k=k, field=field) for k in range(COUNT) for field in FIELDS)]
    rows = [500 + 10 * np.arange(N), *(data[field][:, k] for k in range(COUNT) for field in FIELDS)]
    np.savetxt(file, np.column_stack(rows), delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    return file


@pytest.mark.parametrize("habit", ["json", "motor_state[{k}].{field}", "low_state.motor_state_{k}_{field}"])
def test_motors_are_the_vendors_and_those_that_are_lacking_are_left_out(habit: str, tmp_path: Path) -> None:
    data = motion()
    file = (
        as_json(tmp_path / "a.jsonl", data) if habit == "json" else as_table(tmp_path / "a.csv", data, habit)
    )
    rules = {"trials": {"validation": ["none"], "split": "none"}, "log": {"base": "held"}}
    found = excite.convert([file], "go2", tmp_path / "log", Map.model_validate(rules)).log
    (trial,) = found.trials
    for field, values in {"q": trial.q, "dq": trial.v, "tau_est": trial.tau}.items():
        for k, joint in enumerate(MOTORS):
            column = values[:, found.header.joints.index(joint)]
            np.testing.assert_allclose(column, data[field][:, k], atol=1e-6, err_msg=f"{joint} {field}")
