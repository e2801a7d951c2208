"""Effects planted in a recording of a real machine: seen by hand where they are, and scored against what is said."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.planted import machines
from benchmarks.planted.planting import TERM, Bench, Effect
from benchmarks.planted.score import is_met, modelled_beside, save_log, score
from tests.conftest import lacking

MACHINE = next(machine for machine in machines.MACHINES if machine.name == "emps")
FRICTION = Effect("viscous_friction", 0, 120.0)


@pytest.fixture(scope="module")
def bench() -> Bench:
    if not MACHINE.source.is_dir():
        lacking(f"recordings not found in {MACHINE.source}; set EXCITE_DATA to the folder that holds them")
    return Bench(MACHINE)


@pytest.fixture
def diagnosis_of(excite_here: Callable[..., Any], tmp_path: Path) -> Callable[[Path], dict[str, Any]]:
    """The document of ``excite diagnose`` for a log."""
    return lambda log: json.loads(excite_here("diagnose", log, "--json", cwd=tmp_path).stdout)


def test_friction_is_seen_by_hand_and_nothing_is_not(bench: Bench) -> None:
    clean = bench.without("viscous_friction")
    seen = bench.look(clean, bench.plant(clean, FRICTION), FRICTION)
    tiny = dataclasses.replace(FRICTION, size=0.01)
    assert seen.visible and seen.channel == "axis"
    assert not bench.look(clean, bench.plant(clean, tiny), tiny).visible


def test_planted_torque_is_friction_times_velocity(bench: Bench) -> None:
    """Against finite differences of raw positions, smoothed by a moving mean."""
    run = bench.runs[0]
    added = bench.plant([run], FRICTION)[0].tau - run.tau
    window = np.ones(51) / 51
    speed = np.convolve(np.gradient(run.q[:, 0]) * MACHINE.rate_hz, window, "same")
    assert np.corrcoef(added[:, 0], speed)[0, 1] > 0.99
    assert np.polyfit(speed, added[:, 0], 1)[0] == pytest.approx(FRICTION.size, rel=0.03)


def test_friction_planted_in_a_real_record_is_scored(
    bench: Bench, diagnosis_of: Callable[[Path], dict[str, Any]], tmp_path: Path
) -> None:
    clean, modelled = bench.without("viscous_friction"), modelled_beside("viscous_friction")
    planted = bench.plant(clean, FRICTION)
    without, document = (
        diagnosis_of(save_log(tmp_path / name, MACHINE, runs, modelled))
        for name, runs in (("without", clean), ("planted", planted))
    )
    row = score(bench, FRICTION, bench.look(clean, planted, FRICTION), without, document, 0.0)
    assert row.visible and row.named and row.placed and not row.firm_wrong
    assert row.said == pytest.approx(FRICTION.size, rel=0.1)
    # Without the plant, nothing of what was planted can be said to be found.
    assert not score(
        bench,
        dataclasses.replace(FRICTION, name="torque_gain"),
        bench.look(clean, planted, FRICTION),
        without,
        without,
        0.0,
    ).placed


@pytest.mark.parametrize(
    ("name", "effect", "place"),
    [
        # A little of a delay of 90 ms fits better than all of 12 ms, and is no delay.
        ("panda", Effect("time_delay", 0, 0.012), "torque"),
        # The tilt beside it fits in a form that no base has.
        ("ar5", Effect("joint_spring", 0, 2.988), "AR5-5_07R-W4C4A2_joint_1"),
        # Its torque is that of the joint before.
        ("panda", Effect("encoder_offset", 2, -0.03), "panda_joint3"),
        # With friction that drifts and a late motor beside it the likelihood is higher, and predicts no better.
        ("emps", Effect("coulomb_friction", 0, 13.11), "axis"),
        # A gear of another ratio, a sensor that feels its neighbour, a wrist's motor.
        ("panda", Effect("position_gain", 5, 0.0523), "panda_joint6"),
        pytest.param(
            "panda", Effect("torque_crosstalk", 2, -0.147), "panda_joint3", marks=pytest.mark.battery
        ),
        pytest.param(
            "xmate", Effect("coupled_drive", 3, 3.47, (-1.0, 0.0, 0.0)), "joint4", marks=pytest.mark.battery
        ),
        # Whitened rows tell a delay by when friction changes sign.
        pytest.param("xmate", Effect("time_delay", 0, 0.012), "torque", marks=pytest.mark.battery),
    ],
)
def test_what_is_planted_in_a_record_is_named(
    name: str, effect: Effect, place: str, diagnosis_of: Callable[[Path], dict[str, Any]], tmp_path: Path
) -> None:
    machine = next(machine for machine in machines.MACHINES if machine.name == name)
    if not machine.source.is_dir():
        lacking(f"recordings not found in {machine.source}; set EXCITE_DATA to the folder that holds them")
    whole = Bench(machine)
    planted = whole.plant(whole.without(TERM[effect.name]), effect)
    document = diagnosis_of(save_log(tmp_path / name, machine, planted, modelled_beside(effect.name)))
    assert (effect.name, place) in {(item["effect"], item["location"]) for item in document["effects"]}


def test_bars_read_as_they_are_written() -> None:
    assert is_met(0.9, "≥ .90") and not is_met(0.89, "≥ .90")
    assert is_met(0.0, "≤ .01") and not is_met(0.02, "≤ .01")
    assert is_met(0.9, ".85–.95") and not is_met(0.96, ".85–.95")
