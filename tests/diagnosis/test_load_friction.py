"""Friction that grows with the load: by a power of it, and by the motor's torque that it is a share of itself."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.effects.form import JointStep
from excite.diagnosis.effects.friction import (
    CurvedLoadFriction,
    LoadDependentFriction,
    LoadNote,
    MotorLoadFriction,
    motor_torque,
)
from tests.diagnosis.test_budget import FRICTION, budgeted, two_joints
from tests.diagnosis.two_joints import COULOMB, RATE_HZ, URDF, VISCOUS

LEVEL = 0.4


@pytest.mark.parametrize(("share", "exponent"), [(0.2, 1.0), (0.15, 0.7)])
def test_a_gear_that_rubs_by_its_motors_torque_has_no_torque_gain(
    tmp_path: Path, share: float, exponent: float
) -> None:
    """It takes more while it drives than while it holds back, as a torque scale would."""
    model = pin.buildModelFromXML(URDF)
    data = model.createData()

    def geared(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        a = np.gradient(v, 1.0 / RATE_HZ, axis=0)
        rigid = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
        plain = rigid + VISCOUS * v + COULOMB * np.sign(v)
        motor = plain.copy()
        for _ in range(60):
            motor = plain + share * np.abs(motor) ** exponent * np.sign(v)
        return np.column_stack([(motor - plain)[:, 0], np.zeros(len(q))])

    named = {
        n.effect: n for n in budgeted(two_joints(tmp_path, geared), FRICTION).named if n.location == "first"
    }
    assert named["load_dependent_friction"].share == pytest.approx(1.0, abs=0.02)
    assert named["load_dependent_friction"].values["exponent"][0] == pytest.approx(exponent, abs=0.15)
    # With friction in proportion to the load of the link these patch up what it leaves.
    assert not {"torque_gain", "torque_bias", "joint_elasticity"} & set(named)


def test_a_motor_gives_what_the_load_its_level_and_a_share_of_itself_ask_for() -> None:
    load, share = np.linspace(-3.0, 3.0, 61), 0.25
    for sign in (-1.0, 1.0):
        motor = motor_torque(load, sign, LEVEL, share)
        given = (load * sign + LEVEL > 0.0) * 2.0 - 1.0
        np.testing.assert_allclose(given * motor * sign, load + sign * (LEVEL + share * motor), atol=1e-12)


def at(load: np.ndarray, sign: np.ndarray) -> SimpleNamespace:
    """What a shape asks of its context, for one joint."""
    modelled, own = ("coulomb_friction",), (np.array([LEVEL]),)
    fit = SimpleNamespace(own_coefs=own)
    baseline = SimpleNamespace(rigid=load[:, None], modelled=modelled, fit=fit)
    return SimpleNamespace(baseline=baseline, row=lambda location: 0, friction_sign=lambda j: sign)


def test_its_size_is_the_slope_of_the_straight_line_that_comes_nearest() -> None:
    load, ones = np.random.default_rng(2).uniform(-4.0, 4.0, 500), np.ones(500)
    plain = LoadDependentFriction().unit_torques(at(load, ones), "joint", ())[:, 0]
    for exponent in (0.6, 1.0, 1.4):
        bent = CurvedLoadFriction().unit_torques(at(load, ones), "joint", (exponent,))[:, 0]
        assert np.polyfit(np.abs(load), bent, 1)[0] == pytest.approx(1.0)
    np.testing.assert_allclose(
        CurvedLoadFriction().unit_torques(at(load, ones), "joint", (1.0,))[:, 0], plain
    )


def test_what_does_not_grow_with_the_load_has_no_size() -> None:
    """A joint that hardly carries anything, its motor busy with dry friction."""
    level = np.full(300, 1e-9)
    for form in (CurvedLoadFriction(), MotorLoadFriction()):
        columns = form.unit_torques(at(level, np.ones(300)), "joint", (1.3, 0.2)[: len(form.searched)])
        assert not columns.any()


@pytest.mark.parametrize("form", [CurvedLoadFriction(), MotorLoadFriction()])
def test_a_roll_out_rubs_as_the_equations_say(form: CurvedLoadFriction) -> None:
    rng = np.random.default_rng(5)
    load, sign = rng.uniform(-4.0, 4.0, 200), np.where(rng.random(200) > 0.5, 1.0, -1.0)
    theta, size = (1.3, 0.2)[: len(form.searched)], 0.3
    context = at(load, sign)
    column = size * form.unit_torques(context, "joint", theta)[:, 0]
    fit = SimpleNamespace(extra=np.array([size]), extra_std=np.array([0.01]))
    note = LoadNote.from_values(form.to_sizes(context, "joint", theta, fit))
    step = JointStep(carried=lambda: load, v=sign)
    assert note.joint_friction(np.full(200, LEVEL), step)[0] == pytest.approx(LEVEL + sign * column)
