"""Logs of several days: what differs between them, and ranges that the next day stays in."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from excite.errors import LogError
from excite.identification.problem import NEVER_NEGATIVE
from excite.identification.sessions import identify_sessions, split_sessions, write_ranges
from excite.logs.log import Log
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log

DAYS = ("monday", "tuesday", "wednesday")
SETTINGS = ProblemSettings(cutoff_hz=5.0)


@pytest.fixture(scope="module")
def varied(ur10):
    """Bodies change by 10 % from day to day."""
    log = arm_log(ur10, 1, trials=6, sessions=DAYS, change=0.1)
    return identify_sessions(ur10, split_sessions([log]), problem_settings=SETTINGS)


def test_what_changes_between_days_is_seen(ur10, varied):
    steady_log = arm_log(ur10, 1, trials=6, sessions=DAYS, change=0.0)
    steady = identify_sessions(ur10, split_sessions([steady_log]), problem_settings=SETTINGS)
    assert varied.names == steady.names == DAYS
    # Those that a change of 10 % moves by far more than a session's noise.
    inertial = varied.base.independent < len(ur10.nominal_parameters)
    clear = inertial & (0.1 * np.abs(varied.pooled.mean) > 5.0 * varied.std.max(axis=0))
    assert clear.sum() > 5
    assert np.mean(varied.pooled.inconsistency[clear] > 0.5) > 0.8
    assert np.mean(steady.pooled.inconsistency > 0.5) < 0.3
    width = [np.diff(item.pooled.next_interval, axis=0)[0] for item in (varied, steady)]
    assert np.median(width[0][clear] / width[1][clear]) > 3.0


def test_ranges_hold_a_day_that_was_not_seen(ur10, varied):
    """Another seed of the same spread: its true base parameters lie inside as often as promised or more."""
    rng = np.random.default_rng(11)
    nominal = ur10.nominal_parameters
    # The mean of the days is that of the log's own seed.
    truth = nominal * np.repeat(np.random.default_rng(1).uniform(0.9, 1.1, len(nominal) // 10), 10)
    low, high = varied.pooled.next_interval
    inertial = varied.base.independent < len(nominal)
    inside = []
    for _ in range(40):
        day = truth * np.repeat(1.0 + 0.1 * rng.standard_normal(len(nominal) // 10), 10)
        values = varied.base.matrix[:, : len(nominal)] @ day
        inside.append(((low < values) & (values < high))[inertial])
    assert np.mean(inside) > 0.9


def test_ranges_are_written_for_simulators(ur10, varied, tmp_path):
    for name in ("ranges.yaml", "ranges.json"):
        text = write_ranges(varied, tmp_path / name).read_text()
        document = yaml.safe_load(text) if name.endswith("yaml") else json.loads(text)
        assert document["schema"] == "excite.ranges/1"
        assert set(document["links"]) == {segment.link for segment in ur10.segments}
        for quantities in document["links"].values():
            check_body(quantities)
            assert len(quantities) == 10
            for item in quantities.values():
                assert item["low"] <= item["value"] <= item["high"]
        friction = document["joints"][ur10.joint_names[0]]["viscous"]
        assert friction["low"] < friction["value"] < friction["high"]
        assert len(document["base_parameters"]) == varied.base.rank


def check_body(quantities: dict) -> None:
    """A link's ranges hold no value that no body has."""
    assert quantities["mass"]["low"] > 0.0
    for pair, across in (("xy", "zz"), ("xz", "yy"), ("yz", "xx")):
        product, moment = quantities[f"inertia_{pair}"], quantities[f"inertia_{across}"]
        others = [quantities[f"inertia_{axis}"]["high"] for axis in ("xx", "yy", "zz") if axis != across]
        assert moment["low"] > 0.0 and moment["high"] <= sum(others) + 1e-12
        assert max(-product["low"], product["high"]) <= 0.5 * moment["high"] + 1e-12


def test_ranges_hold_nothing_that_no_robot_has(ur10, tmp_path):
    """Friction that the logs put on either side of zero is not negative in any simulator."""
    log = arm_log(ur10, 1, trials=6, sessions=DAYS, change=0.05)
    names = {t.session: k for k, t in enumerate(log.trials)}
    width = 4.0 * np.array([1.0, -1.0, -0.5])

    def pushed(trial):
        speed = np.gradient(trial.q, trial.time, axis=0)
        return replace(trial, tau=trial.tau - width[sorted(names).index(trial.session)] * 20.0 * speed)

    odd = replace(log, trials=tuple(pushed(t) for t in log.trials))
    found = identify_sessions(ur10, split_sessions([odd]), problem_settings=SETTINGS)
    document = json.loads(write_ranges(found, tmp_path / "ranges.json").read_text())
    for quantities in document["links"].values():
        check_body(quantities)
    terms = [
        term
        for joint in document["joints"].values()
        for name, term in joint.items()
        if name in NEVER_NEGATIVE
    ]
    assert terms and all(0.0 <= term["low"] <= term["value"] <= term["high"] for term in terms)
    assert any(term.get("clipped") for term in terms)
    alone = {name: item for name, item in document["base_parameters"].items() if item["expression"] == name}
    friction = [item for name, item in alone.items() if name.partition("(")[0] in NEVER_NEGATIVE]
    assert len(friction) >= 12 and any(item.get("clipped") for item in friction)
    moments = [item for name, item in alone.items() if name[:3] in ("Ixx", "Iyy", "Izz")]
    assert moments and all(item["low"] >= 0.0 for item in (*friction, *moments))


def test_ends_are_those_of_all_bodies(ur10, varied):
    """Parameters of clouds of points, and of drives, lie between the ends, and come as near to them as one likes."""
    rng = np.random.default_rng(3)
    matrix, (low, high) = varied.base.matrix, varied.possible
    least, most = np.full(len(matrix), np.inf), np.full(len(matrix), -np.inf)
    n = len(ur10.nominal_parameters)
    for _ in range(300):
        bodies = []
        for _ in range(n // 10):
            # Few points far away, or all in one place: bodies at the edges of what is possible.
            points = rng.normal(size=(rng.integers(1, 4), 3)) * 10.0 ** rng.uniform(-3, 2)
            mass = rng.uniform(0.0, 1.0, len(points))
            square = np.einsum("ij,ij->i", points, points)[:, None, None] * np.eye(3)
            inertia = np.einsum("i,ijk->jk", mass, square - np.einsum("ij,ik->ijk", points, points))
            six = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
            bodies += [mass.sum(), *(mass @ points), *six]
        drives = rng.uniform(0.0, 1.0, matrix.shape[1] - n)
        # Only an offset of a torque has either sign.
        drives -= 0.5 * np.array([name.startswith("offset(") for name in varied.base.names[n:]])
        values = matrix @ np.concatenate([bodies, drives])
        least, most = np.minimum(least, values), np.maximum(most, values)
    assert (least >= low - 1e-9).all() and (most <= high + 1e-9).all()
    assert (least[np.isinf(low)] < 0.0).all() and np.isfinite(low).any()


def test_what_varies_beyond_its_intervals_is_named(ur10, varied, tmp_path):
    document = json.loads(write_ranges(varied, tmp_path / "ranges.json").read_text())
    named = document["varies_between_sessions"]
    assert len(named) > 5
    for label, sessions in named.items():
        assert document["base_parameters"][label]["varies"] and set(sessions) == set(DAYS)
        values, stds = (np.array([sessions[day][key] for day in DAYS]) for key in ("value", "std"))
        assert np.ptp(values) > 2.0 * np.median(stds)
    log = arm_log(ur10, 1, trials=6, sessions=DAYS, change=0.0)
    steady = identify_sessions(ur10, split_sessions([log]), problem_settings=SETTINGS)
    assert steady.varies.sum() <= 1


def test_document_for_scripts(varied):
    document = json.loads(json.dumps(varied.to_json()))
    assert document["names"] == list(DAYS)
    first = document["parameters"][0]
    assert first["low"] <= first["mean_low"] <= first["mean_high"] <= first["high"]
    assert set(first["by_session"]) == set(DAYS)
    assert "sessions differ by" in varied.summary()


def test_each_log_is_a_session_unless_it_names_some(ur10):
    logs = [arm_log(ur10, seed, trials=2) for seed in (0, 1)]
    assert list(split_sessions(logs)) == ["log_1", "log_2"]
    named = arm_log(ur10, 0, trials=4, sessions=("a", "b"))
    assert list(split_sessions([named])) == ["a", "b"]
    monday, tuesday = (replace(named, folder=Path(day)) for day in ("mon", "tue"))
    assert list(split_sessions([monday, tuesday])) == ["mon/a", "mon/b", "tue/a", "tue/b"]
    with pytest.raises(LogError, match="one session"):
        split_sessions(logs[:1])


def still(log: Log, *names: str) -> Log:
    """In these sessions only the first joint moves."""
    moving = np.eye(log.trials[0].q.shape[1])[0]
    trials = tuple(
        replace(t, q=t.q[:1] + (t.q - t.q[:1]) * moving) if t.session in names else t for t in log.trials
    )
    return replace(log, trials=trials)


def test_a_session_that_shows_too_little_is_named(ur10):
    log = still(arm_log(ur10, 1, trials=4, sessions=("rich", "poor")), "poor")
    with pytest.raises(LogError, match="poor"):
        identify_sessions(ur10, split_sessions([log]), problem_settings=SETTINGS)


def test_a_session_that_shows_too_little_is_left_out_where_others_remain(ur10):
    """The answer is that of the others alone, and the summary says who is missing."""
    log = still(arm_log(ur10, 1, trials=6, sessions=DAYS), "tuesday")
    sessions = split_sessions([log])
    found = identify_sessions(ur10, sessions, problem_settings=SETTINGS)
    assert found.names == ("monday", "wednesday")
    assert list(found.left_out) == ["tuesday"]
    assert 0 < found.left_out["tuesday"] < found.base.rank
    assert "left out: tuesday" in found.summary()
    rest = {name: item for name, item in sessions.items() if name != "tuesday"}
    alone = identify_sessions(ur10, rest, problem_settings=SETTINGS)
    np.testing.assert_allclose(
        found.base.matrix @ found.base.matrix.T, alone.base.matrix @ alone.base.matrix.T
    )
    np.testing.assert_allclose(found.pooled.mean, alone.pooled.mean, rtol=1e-6, atol=1e-9)
