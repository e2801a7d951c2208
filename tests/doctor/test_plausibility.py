"""Odd numbers in logs are named with their likely cause; sound logs are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.doubt import Doubt
from excite.doctor.examine import examine
from excite.logs.log import Cleaning
from tests.identification.practice_log import changed

NAMES = tuple(f"panda_joint{i}" for i in range(1, 8))


def kinds(log, robot) -> dict[str, tuple[str, ...]]:
    return {item.kind: item.places for item in examine(robot, log).findings}


def flipped(j: int) -> np.ndarray:
    signs = np.ones(7)
    signs[j] = -1.0
    return signs


def swapped(i: int, j: int) -> list[int]:
    order = list(range(7))
    order[i], order[j] = order[j], order[i]
    return order


def constant(values: np.ndarray, j: int) -> np.ndarray:
    values = values.copy()
    values[:, j] = 0.25
    return values


def with_velocity(trial, factor):
    return replace(trial, v=np.gradient(trial.q, trial.time, axis=0) * factor)


FAULTS = {
    "degrees": (lambda t: replace(t, q=np.degrees(t.q), q_cmd=None), "degrees", NAMES),
    "one in degrees": (
        lambda t: replace(t, q=t.q * np.where(np.arange(7) == 2, 180 / np.pi, 1.0), q_cmd=None),
        "degrees",
        NAMES[2:3],
    ),
    "commands in degrees": (lambda t: replace(t, q_cmd=np.degrees(t.q_cmd)), "command_degrees", NAMES),
    "positions exchanged": (lambda t: replace(t, q=t.q[:, swapped(0, 2)]), "order", (NAMES[0], NAMES[2])),
    "a command turned": (lambda t: replace(t, q_cmd=t.q_cmd * flipped(4)), "command_sign", NAMES[4:5]),
    "a dead torque": (lambda t: replace(t, tau=constant(t.tau, 5)), "constant", (f"tau.{NAMES[5]}",)),
    "time in milliseconds": (lambda t: replace(t, time=1e3 * t.time), "time_unit", ("time",)),
    "time that went back": (
        lambda t: replace(t, cleaning=Cleaning(reordered_rows=2)), "reordered_rows", (),
    ),
    "a velocity turned": (lambda t: with_velocity(t, flipped(3)), "velocity", NAMES[3:4]),
    "torques in N·mm": (lambda t: replace(t, tau=1e3 * t.tau), "torque_size", NAMES),
    "too short": (
        lambda t: replace(t, time=t.time[:60], q=t.q[:60], tau=t.tau[:60], q_cmd=None), "too_few_rows", (),
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_place(panda, log, fault):
    change, kind, places = FAULTS[fault]
    found = kinds(changed(log, change), panda)
    assert kind in found
    assert found[kind] == places


def test_a_sound_log_is_left_alone(panda, log):
    assert examine(panda, log).findings == ()
    assert examine(panda, changed(log, lambda t: with_velocity(t, 1.0))).findings == ()


def test_milliseconds_are_named(panda, log):
    text = next(f.text for f in examine(panda, changed(log, FAULTS["time in milliseconds"][0])).findings)
    assert "milliseconds" in text


def test_torques_before_the_gears_that_are_friction_for_the_most_are_in_a_unit_that_is_asked_for(panda, log):
    """As a KUKA KR 300 logs them. Nothing else of the channels is told by bodies that do not show."""
    rng = np.random.default_rng(0)
    gears = np.array([257.0, 267.0, 252.0, 221.0, 240.0, 154.0, 154.0])
    rubs = 2.0 * np.mean([trial.tau.std(axis=0) for trial in log.trials], axis=0) / gears

    def before_gears(trial):
        v = np.gradient(trial.q, trial.time, axis=0)
        friction = rubs * (np.tanh(v / 0.05) + 0.4 * np.sign(v) * np.abs(v) ** 0.5)
        noise = 0.02 * rubs * rng.normal(size=v.shape)
        return replace(trial, tau=trial.tau / gears + friction + noise)

    ill = changed(log, before_gears)
    chart = examine(panda, ill)
    assert {item.kind for item in chart.findings if item.severity == "spoils"} == {"torque_scale"}
    assert Doubt.SIZE in chart.doubts
    np.testing.assert_array_equal(chart.log.trials[0].tau, ill.trials[0].tau)
    np.testing.assert_array_equal(chart.log.trials[0].q, ill.trials[0].q)
