"""EMPS: a prismatic axis; the published mass and friction, and intervals that hold them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from excite.cli.main import app
from tests.reproduction.emps import JOINT, PUBLISHED, SETTINGS, emps_log, identified, loop_hz


def test_published_values_are_met_and_lie_in_the_intervals(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: 94.84 kg, 197.2 N·s/m, 20.78 N, half widths 0.48, 10.9, 0.92."""
    log = emps_log(data_dir, tmp_path)
    found = identified(log)
    base = {item.name: item for item in found.base}
    assert sorted(base) == sorted(item.name for item in PUBLISHED)
    for item in PUBLISHED:
        ours = base[item.name]
        assert ours.half_width_95 is not None
        assert abs(ours.value - item.value) <= ours.half_width_95, item.what
        # An interval that holds everything says nothing.
        assert ours.half_width_95 <= 0.25 * abs(item.value), item.what
        if item.percent is not None:
            assert ours.value == pytest.approx(item.value, rel=item.percent / 100.0)
    fit = found.fit[JOINT]
    assert fit.unit == "N"
    assert fit.rmse < 0.05 * fit.std
    # What the settings are chosen by.
    band = loop_hz(log, base["m(carriage)"].value)
    assert SETTINGS.cutoff_hz == pytest.approx(2.0 * band, rel=0.1)
    assert SETTINGS.kinematics_cutoff_hz == pytest.approx(5.0 * band, rel=0.1)


def test_the_command_line_takes_a_sliding_joint(data_dir: Path, tmp_path: Path) -> None:
    emps_log(data_dir, tmp_path)
    arguments = [
        "identify",
        str(tmp_path / "emps" / "emps.urdf"),
        str(tmp_path / "emps"),
        "--method",
        "wls",
        "--cutoff",
        "40",
    ]
    run = CliRunner().invoke(app, [*arguments, "--json"])
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    mass = next(item for item in document["base_parameters"] if item["name"] == "m(carriage)")
    assert mass["value"] == pytest.approx(PUBLISHED[0].value, rel=0.005)
    assert document["fit"][JOINT]["unit"] == "N"
