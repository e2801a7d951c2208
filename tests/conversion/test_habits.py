"""Tables as people write them: what stands in a log must be what was measured, whatever the habit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.convert import Conversion
from excite.conversion.mapping import Map
from tests.conversion import written
from tests.conversion.written import JOINTS

WHOLE = Map.model_validate({"trials": {"validation": ["none"], "split": "none"}})


@pytest.fixture
def arm(tmp_path) -> Path:
    return written.arm_urdf(tmp_path / "arm.urdf")


@pytest.fixture
def data() -> dict[str, np.ndarray]:
    return written.motion()


def table(file: Path, columns: dict[str, object], separator: str = ",") -> Path:
    """A text table; a column's cells are numbers or texts, None for an empty cell."""
    cells = [
        ["" if x is None or x != x else (x if isinstance(x, str) else f"{x:.9g}") for x in column]
        for column in columns.values()
    ]
    lines = [separator.join(columns)] + [separator.join(row) for row in zip(*cells, strict=True)]
    file.write_text("\n".join(lines) + "\n")
    return file


def columns_of(data: dict[str, np.ndarray], **patterns: str) -> dict[str, np.ndarray]:
    """Columns by patterns such as ``q="pos_{n0}"``, after ``time``."""
    found = {"time": data["time"]}
    for channel, pattern in patterns.items():
        for k, joint in enumerate(JOINTS):
            found[pattern.format(n=k + 1, n0=k, joint=joint)] = data[channel][:, k]
    return found


def check(
    conversion: Conversion, data: dict[str, np.ndarray], *channels: str, rows: slice = slice(None)
) -> None:
    """Every channel of the one trial is that of the motion, joint by joint."""
    (trial,) = conversion.log.trials
    for channel in channels:
        for k, joint in enumerate(JOINTS):
            found = trial.columns[f"{channel}.{joint}"]
            np.testing.assert_allclose(found, data[channel][rows, k], atol=1e-6, err_msg=f"{channel}.{joint}")


def test_a_last_column_that_is_empty_to_begin_with_loses_no_names(data, arm, tmp_path):
    columns = columns_of(data, q="/joint_states/{joint}/position", tau="/joint_states/{joint}/effort")
    columns["/tf/x"] = np.full(600, np.nan)
    columns["/tf/x"][300::7] = 0.5
    file = table(tmp_path / "juggler.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_a_last_column_without_a_name_loses_no_names(data, arm, tmp_path):
    columns = {
        "": np.arange(600.0),
        **columns_of(data, q="joint_{n0}_pos", tau="joint_{n0}_eff"),
        " ": data["time"] * 0,
    }
    file = table(tmp_path / "pandas.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


@pytest.mark.parametrize("missing", ["", "nan"])
def test_rows_before_a_stream_starts_are_left_out(missing, data, arm, tmp_path):
    columns: dict[str, object] = columns_of(data, q="q{n}", tau="tau{n}")
    for name, values in columns.items():
        if name.startswith("tau"):
            columns[name] = [missing] * 100 + [f"{x:.9g}" for x in values[100:]]
    file = table(tmp_path / "late.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau", rows=slice(100, None))


def test_the_desired_and_the_motors_side_of_a_state_are_not_its_joints(data, arm, tmp_path):
    wrong = {**data, "cmd": data["q"] + 0.1, "theta": data["q"] + 0.2, "rate": data["tau"] * 9.0}
    columns = columns_of(
        wrong, q="state.q[{n0}]", cmd="state.q_d[{n0}]", theta="state.theta[{n0}]", tau="state.tau_J[{n0}]"
    )
    columns |= columns_of(wrong, rate="state.dtau_J[{n0}]")
    conversion = excite.convert([table(tmp_path / "state.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(conversion, data, "q", "tau")
    assert conversion.columns["q_cmd.elbow"][0] == "state.q_d[1]"


def test_plural_names_of_arrays(data, arm, tmp_path):
    file = tmp_path / "arrays.npz"
    np.savez(file, ts=data["time"], qs=data["q"], dqs=data["v"], taus=data["tau"])
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "v", "tau")
