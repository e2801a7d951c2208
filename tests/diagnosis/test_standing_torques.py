"""Robots that stand without wrench sensors: drives and readings named from joint torques, contact forces taken out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.floating.problem import build_problem
from excite.diagnosis.floating.record import TORQUE, prepare_record
from excite.diagnosis.floating.registry import FLOATING_EFFECTS
from excite.logs.log import Log
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.effects.registry import inject_effects
from excite.simulation.simulate import run_experiment
from excite.simulation.virtual_robot import VirtualRobot, changed_robot, nominal_robot

_JUDGES = "sway_006"


@pytest.fixture(scope="module")
def go2() -> Robot:
    return excite.load_robot("go2")


@pytest.fixture(scope="module")
def diagnosed(go2: Robot) -> Callable[..., Diagnosis]:
    """The diagnosis of a Go2 with scattered bodies and drives, and effects."""

    def diagnose(*effects: str) -> Diagnosis:
        virtual = inject_effects(changed_robot(go2, np.random.default_rng(5)), effects)
        return excite.diagnose(recorded(go2, virtual), go2)

    return diagnose


def recorded(go2: Robot, virtual: VirtualRobot) -> Log:
    known = library_motions(go2)
    motions = [known[name] for name in ("foot_swing_000", "foot_swing_001", _JUDGES)]
    return run_experiment(virtual, motions, seed=11, roles={_JUDGES: "validation"}).log


def test_a_weak_drive_is_named_and_judged_on_a_motion_of_another_kind(
    diagnosed: Callable[..., Diagnosis],
) -> None:
    """It gives a fifth less than its log says; masses, friction and rotors are nobody's but its own."""
    found = diagnosed("torque_gain:FL_calf_joint:1.25")
    assert (found.verdict, found.effect, found.location) == ("effect", "torque_gain", "FL_calf_joint")
    assert len(found.effects) == 1
    gain = found.effects[0].parameters["gain"]
    assert gain.value == pytest.approx(1.25, abs=0.02)
    assert gain.std < 0.02
    assert found.gap.share_closed > 0.85
    assert found.curves is not None and found.curves.trial == _JUDGES


def test_where_nothing_is_nothing_is_named(diagnosed: Callable[..., Diagnosis]) -> None:
    assert diagnosed().verdict == "none"


def test_rows_hold_no_contact_force(go2: Robot) -> None:
    """Torques of a motion under forces at the feet that nobody knows leave nothing; pinocchio gives the Jacobians."""
    log = recorded(go2, replace(changed_robot(go2, np.random.default_rng(5)), noise=0.0))
    record = prepare_record(replace(log, trials=log.trials[:1]), go2)
    model, data, few = go2.model, go2.model.createData(), range(0, record.n_samples, 20)
    rng, torques = np.random.default_rng(2), []
    for k in few:
        needed = pin.rnea(model, data, record.q[k], record.v[k], record.a[k])
        pin.computeJointJacobians(model, data, record.q[k])
        rows = []
        for foot in go2.feet:
            point = data.oMi[foot.joint].act(foot.centre) - [0.0, 0.0, foot.radius]
            jacobian = pin.getJointJacobian(model, data, foot.joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            lever = point - data.oMi[foot.joint].translation
            rows.append(jacobian[:3] - pin.skew(lever) @ jacobian[3:])
        jacobian = np.vstack(rows)
        # Forces that carry the base, and any that press feet against each other.
        carry = np.linalg.lstsq(jacobian[:, :6].T, needed[:6], rcond=None)[0]
        press = np.linalg.svd(jacobian[:, :6].T)[2][6:]
        torques.append((needed - jacobian.T @ (carry + press.T @ rng.normal(0.0, 50.0, len(press))))[6:])
    state = build_problem(record).nominal.replace(
        q=record.q[few], v=record.v[few], a=record.a[few], readings={TORQUE: np.array(torques)}
    )
    assert np.abs(state.predicted_forces).max() > 20.0
    assert np.abs(state.residual).max() < 1e-8


def test_columns_are_finite_differences_and_nothing_else_is_tried(go2: Robot) -> None:
    log = recorded(go2, changed_robot(go2, np.random.default_rng(5)))
    state = build_problem(prepare_record(replace(log, trials=log.trials[:2]), go2)).nominal
    seen = {word: e for word, e in FLOATING_EFFECTS.items() if e.is_seen(state.record)}
    assert {"torque_gain", "torque_bias", "encoder_offset", "time_delay", "link_inertia"} <= set(seen)
    assert not {"sensor_gain", "sensor_bias", "soft_tissue"} & set(seen)
    for effect in seen.values():
        for location in effect.locations(state)[:1]:
            theta = 0.01 * effect.parameter_scales(state, location)
            zero = np.zeros_like(theta)
            moved = effect.apply_to(state, location, theta).residual - state.residual
            linear = -effect.residual_columns(state, location, zero) @ theta
            assert np.abs(moved - linear).max() < 0.05 * np.abs(moved).max() + 1e-9


def test_a_drive_of_a_robot_that_hangs_is_named() -> None:
    """Its harness pulls at the base as it likes: each joint stands for itself."""
    robot = excite.load_robot("g1_suspended")
    virtual = inject_effects(nominal_robot(robot), ["torque_gain:left_knee_joint:1.25"])
    log = run_experiment(virtual, [*library_motions(robot).values()][:3], seed=4).log
    # Of bodies that are free a knee's gain is the mass of what it carries.
    given = tuple({"rigid_body": "rigid_body_fixed"}.get(word, word) for word in log.header.modelled)
    header = log.header.model_copy(update={"modelled": given})
    found = excite.diagnose(replace(log, header=header), robot)
    assert [(e.effect, e.location) for e in found.effects] == [("torque_gain", "left_knee_joint")]
    assert found.effects[0].parameters["gain"].value == pytest.approx(1.25, abs=0.03)


def library_motions(robot: Robot) -> dict[str, Motion]:
    return {motion.name: motion for motion in excite.load_motions(robot.name)}
