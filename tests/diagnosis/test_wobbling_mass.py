"""Masses that wobble on a segment, integrated by a general solver, as a standing body's diagnosis sees them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from scipy.optimize import root

from excite.diagnosis.floating.bodies import WobblingMass
from excite.diagnosis.floating.diagnose import attribute_gap
from excite.diagnosis.floating.problem import build_problem
from excite.diagnosis.floating.record import FloatingRecord, prepare_record
from excite.diagnosis.floating.spectrum import in_band
from excite.diagnosis.floating.state import State
from excite.logs.files import load_log
from tests.diagnosis.few_trials import few_trials

# A human on plates, nominal inertials given and right; nothing hidden.
_CLEAN = "case_001"
_LINK, _PLACE = "middle_lumbar_X_link", np.array([0.02, 0.08, 0.03])
_MASS, _HERTZ, _RATIO = 5.0, 2.0, 0.15
_GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Wobble:
    """Where a mass is held by the model and where it is, ``(n, 3)`` each, and the forces on it less its weight."""

    held: np.ndarray
    there: np.ndarray
    force_held: np.ndarray
    force: np.ndarray


def wobble(record: FloatingRecord, directions: np.ndarray) -> Wobble:
    """Newton's law of the mass in the world, its spring and damper turning with the segment.

    Args:
        record: of the motion.
        directions: ``(3,)`` one where it may move along a world axis, zero where it is held.
    """
    state = State.from_log(record)
    joint = [s.link for s in record.robot.segments].index(_LINK) + 1
    places, turns = state.poses.point(joint, _PLACE), state.poses.rotation[:, joint]
    omega, damping = 2.0 * np.pi * _HERTZ, 4.0 * np.pi * _RATIO * _HERTZ
    down = np.einsum("nji,j->i", turns, _GRAVITY)
    sag = 9.81 * down / np.linalg.norm(down) / omega**2
    found = Wobble(*(np.zeros_like(places) for _ in range(4)))
    for span in record.spans:
        time = np.arange(span.stop - span.start) / record.rate_hz
        held = make_interp_spline(time, places[span], k=5)
        rotation = make_interp_spline(time, turns[span].reshape(-1, 9), k=5)

        def spring(t: float, x: np.ndarray, v: np.ndarray, held=held, rotation=rotation) -> np.ndarray:
            r, turning = rotation(t).reshape(3, 3), rotation(t, 1).reshape(3, 3)
            stretched = r.T @ (x - held(t)) + sag
            rate = r.T @ (v - held(t, 1)) + turning.T @ (x - held(t))
            return -(omega**2) * r @ stretched - damping * r @ rate

        def law(t: float, y: np.ndarray, held=held, spring=spring) -> np.ndarray:
            free = spring(t, y[:3], y[3:]) + _GRAVITY
            return np.concatenate([y[3:], np.where(directions > 0.0, free, held(t, 2))])

        # Where its spring holds it against weight and inertia.
        away = _GRAVITY - held(0.0, 2) - omega**2 * rotation(0.0).reshape(3, 3) @ sag
        start = np.concatenate([held(0.0) + directions * away / omega**2, held(0.0, 1)])
        y = solve_ivp(law, (0.0, time[-1]), start, t_eval=time, rtol=1e-8, atol=1e-9).y.T
        acceleration = np.array([law(t, each)[3:] for t, each in zip(time, y, strict=True)])
        found.held[span], found.there[span] = places[span], y[:, :3]
        found.force_held[span] = _MASS * (held(time, 2) - _GRAVITY)
        found.force[span] = _MASS * (acceleration - _GRAVITY)
    return found


def carrying(record: FloatingRecord, wobble: Wobble) -> FloatingRecord:
    """The record as the plates would have read it, as much more each as its share of the load."""
    loads = {s.name: np.linalg.norm(record.readings[s.name][:, :3], axis=1) for s in record.robot.sensors}
    readings, force = dict(record.readings), wobble.force - wobble.force_held
    for sensor in record.robot.sensors:
        plate, part = sensor.placement, loads[sensor.name] / sum(loads.values())
        moment = np.cross(wobble.there - plate.translation, wobble.force)
        moment -= np.cross(wobble.held - plate.translation, wobble.force_held)
        more = part[:, None] * np.hstack([force @ plate.rotation, moment @ plate.rotation])
        readings[sensor.name] = readings[sensor.name] + more
    return replace(record, readings=readings)


@pytest.fixture(scope="module")
def still(gap_dir: Path) -> FloatingRecord:
    return prepare_record(load_log(gap_dir / "floating" / _CLEAN))


@pytest.fixture(scope="module")
def short(gap_dir: Path) -> FloatingRecord:
    """Three of its trials, which are enough for a name."""
    return prepare_record(few_trials(load_log(gap_dir / "floating" / _CLEAN)))


@pytest.fixture(scope="module")
def wobbling(short: FloatingRecord) -> FloatingRecord:
    return carrying(short, wobble(short, np.ones(3)))


def test_the_wrench_is_that_of_the_mass(still: FloatingRecord) -> None:
    wobbling = carrying(still, wobble(still, np.ones(3)))
    logged, effect = State.from_log(wobbling), WobblingMass()
    # Parameters are read back through the report, whatever they are inside.
    theta = np.concatenate([[_MASS], _PLACE, np.zeros(2)])

    def said(theta: np.ndarray) -> np.ndarray:
        report = effect.report_parameters(logged, _LINK, theta, np.zeros(6))
        return np.array([report["frequency"].value / _HERTZ, report["damping_ratio"].value / _RATIO]) - 1.0

    theta[4:] = root(lambda x: said(np.concatenate([theta[:4], x])), np.zeros(2)).x
    clean = State.from_log(still).residual
    added = in_band(still, logged.residual - clean)
    left = in_band(still, effect.apply_to(logged, _LINK, theta).residual - clean)
    # Accelerations of the record are filtered, and the moment about the base is mostly the mass' weight.
    most = np.repeat([0.16, 0.06], 3) * np.linalg.norm(added, axis=0)
    assert (np.linalg.norm(left, axis=0) < most).all()


def test_no_step_of_a_fit_leaves_what_can_be(wobbling: FloatingRecord) -> None:
    logged, effect = State.from_log(wobbling), WobblingMass()
    for wild in (-1e3, 1e3):
        theta = np.array([wild, *_PLACE, wild, wild])
        assert np.isfinite(effect.apply_to(logged, _LINK, theta).residual).all()
        said = effect.report_parameters(logged, _LINK, theta, np.zeros(6))
        assert 0.0 <= said["mass"].value <= logged.phi[::10].max()
        assert 1.0 < said["frequency"].value < 500.0


def test_a_mass_that_wobbles_is_soft_tissue(wobbling: FloatingRecord) -> None:
    found = attribute_gap(build_problem(wobbling))
    assert found.verdict == "effect"
    (placed,), (theta,), (std,) = found.accepted_fit.placed, found.accepted_fit.theta, found.accepted_fit.std
    assert placed.effect.name == "soft_tissue"
    assert _LINK in found.tied[0]
    said = placed.effect.report_parameters(State.from_log(wobbling), placed.location, theta, std)
    assert said["mass"].value == pytest.approx(_MASS, rel=0.15)
    assert said["frequency"].value == pytest.approx(_HERTZ, rel=0.06)
    assert said["damping_ratio"].value == pytest.approx(_RATIO, rel=0.3)
    assert found.explained > 0.97


def test_a_mass_that_swings_in_the_horizontal_alone_is_no_tissue(short: FloatingRecord) -> None:
    found = attribute_gap(build_problem(carrying(short, wobble(short, np.array([1.0, 1.0, 0.0])))))
    assert found.verdict == "unknown"
