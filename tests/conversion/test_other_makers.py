"""Recordings as a cell's controller, a robot maker's trace and a laboratory's script leave them."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from tests.conversion.test_habits import check
from tests.conversion.written import JOINTS, WHOLE

pytestmark = pytest.mark.usefixtures("unexamined", "readers_here")


def test_a_dump_of_a_controller_with_german_heads_and_decimal_commas(data, arm, tmp_path):
    axes = range(1, len(JOINTS) + 1)
    heads = ["Zeit [ms]", *(f"Achse{k} Istposition [Grad]" for k in axes)]
    heads += [f"Achse{k} Sollposition [Grad]" for k in axes] + [
        f"Achse{k} Istdrehzahl [Grad/s]" for k in axes
    ]
    heads += [f"Achse{k} Istmoment [Nm]" for k in axes] + ["Temperatur Schaltschrank [°C]"]
    n = len(data["time"])
    rows = np.column_stack(
        [
            1e3 * data["time"],
            *(np.degrees(data[key]) for key in ("q", "q_cmd", "v")),
            data["tau"],
            np.full(n, 31.5),
        ]
    )
    lines = ["Projekt: Zelle 4;;", "Erstellt am 12.03.2026 14:22;;", ";".join(heads)]
    lines += [";".join(f"{x:.9f}" for x in row).replace(".", ",") for row in rows]
    (tmp_path / "dump.csv").write_bytes("\r\n".join(lines).encode("cp1252"))
    done = excite.convert([tmp_path / "dump.csv"], arm, tmp_path / "log", WHOLE)
    check(done, data, "q", "q_cmd", "v", "tau")
    assert done.unused == ("Temperatur Schaltschrank [°C]",)


def test_a_trace_with_axes_by_letter_in_degrees(data, arm, tmp_path):
    axes = range(1, len(JOINTS) + 1)
    heads = ["TIME", *(f"A{k}" for k in axes), *(f"A{k}_CMD" for k in axes), *(f"TORQUE_A{k}" for k in axes)]
    rows = np.column_stack([data["time"], np.degrees(data["q"]), np.degrees(data["q_cmd"]), data["tau"]])
    lines = ["TRACE V8.3", "SAMPLERATE 10 ms", "# Robot: three axes", " ".join(heads)]
    lines += [" ".join(f"{x:14.8f}" for x in row) for row in rows]
    (tmp_path / "trace.dat").write_text("\n".join(lines))
    check(excite.convert([tmp_path / "trace.dat"], arm, tmp_path / "log", WHOLE), data, "q", "q_cmd", "tau")


def test_cells_of_structs_by_joint_within_cells_of_trials(data, arm, tmp_path):
    from scipy.io import savemat

    half = len(data["time"]) // 2
    trials = np.empty(2, dtype=object)
    for k, rows in enumerate((slice(0, half), slice(half, None))):
        joints = np.empty(len(JOINTS), dtype=object)
        for j, name in enumerate(JOINTS):
            joints[j] = {
                "name": name,
                "angle_deg": np.degrees(data["q"][rows, j]),
                "velocity_deg_s": np.degrees(data["v"][rows, j]),
                "torque_Nmm": 1e3 * data["tau"][rows, j],
            }
        trials[k] = {"t": data["time"][rows][:, None], "joints": joints, "operator": "x"}
    savemat(tmp_path / "exp.mat", {"experiment": {"robot": "arm", "fs": 100.0, "trials": trials}})
    done = excite.convert([tmp_path / "exp.mat"], arm, tmp_path / "log", WHOLE)
    assert len(done.log.trials) == 2
    for key in ("q", "v", "tau"):
        made = np.concatenate([getattr(trial, key) for trial in done.log.trials])
        np.testing.assert_allclose(made, data[key], atol=1e-6)
