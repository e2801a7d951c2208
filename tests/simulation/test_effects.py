"""Injected effects: one battery over the registry, and each effect's own law."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, UnknownNameError
from excite.logs.vocabulary import EFFECTS
from excite.robot.robot import Robot
from excite.simulation.effects.registry import INJECTED_EFFECTS, inject_effects
from excite.simulation.execution import execute_motion
from excite.simulation.virtual_robot import Recording, VirtualRobot, nominal_robot
from tests.simulation.motions import simulate, waving

NAMES = sorted(INJECTED_EFFECTS)


@pytest.fixture(scope="module")
def plain(panda: Robot) -> VirtualRobot:
    return replace(nominal_robot(panda), noise=0.0)


@pytest.fixture(scope="module")
def plain_run(plain: VirtualRobot) -> Recording:
    return execute_motion(plain, _motion(plain))


def _motion(virtual: VirtualRobot):
    return waving(virtual.robot, dict.fromkeys(virtual.robot.joint_names, 0.3), duration=1.5)


def _torque(virtual: VirtualRobot) -> np.ndarray:
    return simulate(virtual, [_motion(virtual)], seed=0).trials[0].tau


def _channels(virtual: VirtualRobot) -> np.ndarray:
    trial = simulate(virtual, [_motion(virtual)], seed=0).trials[0]
    return np.hstack([trial.q, trial.tau])


@pytest.mark.parametrize("name", NAMES)
class TestEveryEffect:
    def test_it_is_a_word_of_the_contract(self, name: str) -> None:
        assert name in EFFECTS
        assert INJECTED_EFFECTS[name].name == name

    def test_its_default_changes_the_log_and_not_the_robot(self, name: str, plain: VirtualRobot) -> None:
        if not INJECTED_EFFECTS[name].locations(plain):
            pytest.skip("sits on standing robots only")
        before = _channels(plain)
        changed = _channels(inject_effects(plain, [name]))
        assert np.abs(changed - before).max() > 1e-3
        np.testing.assert_array_equal(_channels(plain), before)

    def test_every_location_is_accepted(self, name: str, plain: VirtualRobot, g1: Robot) -> None:
        for virtual in (plain, nominal_robot(g1)):
            for location in INJECTED_EFFECTS[name].locations(virtual):
                assert inject_effects(virtual, [f"{name}:{location}"]) is not virtual

    def test_an_unknown_location_is_refused(self, name: str, plain: VirtualRobot, g1: Robot) -> None:
        virtual = plain if INJECTED_EFFECTS[name].locations(plain) else nominal_robot(g1)
        with pytest.raises(UnknownNameError, match="nowhere"):
            inject_effects(virtual, [f"{name}:nowhere"])

    def test_values_out_of_bounds_are_refused(self, name: str, plain: VirtualRobot) -> None:
        effect = INJECTED_EFFECTS[name]
        if not effect.locations(plain):
            pytest.skip("sits on standing robots only")
        for value in (effect.lower - 1.0, effect.upper + 1.0, float("nan")):
            with pytest.raises(InputError, match=name):
                effect.inject(plain, None, value)

    def test_it_survives_pickling(self, name: str, plain: VirtualRobot, g1: Robot) -> None:
        virtual = plain if INJECTED_EFFECTS[name].locations(plain) else nominal_robot(g1)
        changed = inject_effects(virtual, [name])
        copy = pickle.loads(pickle.dumps(changed))  # noqa: S301
        np.testing.assert_array_equal(copy.truth.phi, changed.truth.phi)
        assert copy.readings == changed.readings


def test_every_effect_of_the_contract_can_be_injected() -> None:
    assert set(NAMES) == set(EFFECTS)


def test_errors_of_wrench_sensors(g1: Robot) -> None:
    """On a wrench of one newton along each axis in turn."""
    virtual = nominal_robot(g1)
    sensor = g1.sensors[0].name
    plain = np.eye(6)

    def read(text: str) -> np.ndarray:
        recording = Recording("r", np.arange(6.0), *[np.zeros((6, 1))] * 7, {}, {sensor: plain}, np.zeros(6))
        return inject_effects(virtual, [text]).readings[-1](recording).wrenches[sensor]

    np.testing.assert_allclose(np.diag(read(f"sensor_gain:{sensor}.fz:1.1")), [1, 1, 1.1, 1, 1, 1])
    leak = read(f"sensor_crosstalk:{sensor}.fz->fx:0.2") - plain
    assert leak[2, 0] == pytest.approx(0.2)
    assert np.abs(leak).sum() == pytest.approx(0.2)
    np.testing.assert_allclose(read(f"sensor_bias:{sensor}:2")[0], [3, 2, 2, 0.2, 0.2, 0.2])
    turned = read(f"sensor_frame_offset:{sensor}:0.1")
    np.testing.assert_allclose(turned[1, 1:3], [np.cos(0.1), -np.sin(0.1)])


def test_the_form_of_the_text_is_checked(plain: VirtualRobot) -> None:
    for text, message in (
        ("warp", "unknown effect"),
        ("payload:a:b:c", "too many"),
        ("payload::much", "no number"),
    ):
        with pytest.raises(InputError, match=message):
            inject_effects(plain, [text])


def test_an_effect_without_a_place_is_refused(g1: Robot) -> None:
    with pytest.raises(InputError, match="no place on g1"):
        inject_effects(nominal_robot(g1), ["torque_bias"])


def test_bias_and_gain_follow_their_law(plain: VirtualRobot, plain_run: Recording) -> None:
    biased = _torque(inject_effects(plain, ["torque_bias:panda_joint2:1.5", "torque_gain:panda_joint4:0.8"]))
    expected = plain_run.tau_link.copy()
    expected[:, 1] += 1.5
    expected[:, 3] *= 0.8
    np.testing.assert_allclose(biased, expected, atol=1e-12)


def test_crosstalk_adds_a_share_of_the_joint_before(plain: VirtualRobot, plain_run: Recording) -> None:
    read = _torque(inject_effects(plain, ["torque_crosstalk:panda_joint3:0.2"]))
    expected = plain_run.tau_link.copy()
    expected[:, 2] += 0.2 * expected[:, 1]
    np.testing.assert_allclose(read, expected, atol=1e-12)


def test_a_position_gain_scales_what_the_encoder_and_its_servo_read(plain: VirtualRobot) -> None:
    motion = _motion(plain)
    before, after = (
        simulate(virtual, [motion], seed=0).trials[0]
        for virtual in (plain, inject_effects(plain, ["position_gain:panda_joint2:1.1"]))
    )
    for was, now in ((before.q, after.q), (before.q_cmd, after.q_cmd)):
        np.testing.assert_allclose(now[:, 1], 1.1 * was[:, 1], atol=1e-12)
        np.testing.assert_array_equal(np.delete(now, 1, axis=1), np.delete(was, 1, axis=1))


def test_a_coupled_motor_rubs_at_both_joints(plain: VirtualRobot, plain_run: Recording) -> None:
    """Where both joints turn the same way its friction opposes each as much."""
    run = execute_motion(inject_effects(plain, ["coupled_drive:panda_joint2:2.0"]), _motion(plain))
    more = run.tau_motor - plain_run.tau_motor
    both = plain_run.v[:, 0] + plain_run.v[:, 1]
    fast = np.abs(both) > 0.3 * np.abs(both).max()
    for joint in (0, 1):
        # The servos swing a little where it begins to rub.
        against = more[fast, joint] * np.sign(both[fast])
        assert np.median(against) == pytest.approx(2.0, abs=0.05) and np.abs(against - 2.0).max() < 0.6


def test_a_delay_of_whole_samples_shifts(plain: VirtualRobot, plain_run: Recording) -> None:
    rate = plain.robot.description.sensors.rate_hz
    late = _torque(inject_effects(plain, [f"time_delay:torque:{10 / rate}"]))
    np.testing.assert_allclose(late[10:], plain_run.tau_link[:-10], atol=1e-6)
    np.testing.assert_allclose(late[:10], np.tile(plain_run.tau_link[0], (10, 1)), atol=1e-12)


@pytest.mark.parametrize(("name", "power"), [("viscous_friction", 1), ("coulomb_friction", 0)])
def test_friction_adds_its_torque(name: str, power: int, plain: VirtualRobot, plain_run: Recording) -> None:
    run = execute_motion(inject_effects(plain, [f"{name}:panda_joint1:2.0"]), _motion(plain))
    added = run.tau_link[:, 0] - plain_run.tau_link[:, 0]
    moving = np.abs(run.v[:, 0]) > 0.1
    law = 2.0 * np.sign(run.v[:, 0]) * np.abs(run.v[:, 0]) ** power
    # The arm follows its command a little differently, so that inertial torques differ too.
    assert np.abs(added - law)[moving].mean() < 0.1 * np.abs(law[moving]).mean()


def test_a_payload_weighs(g1: Robot) -> None:
    loaded = inject_effects(nominal_robot(g1), ["payload:torso_link:2.0"])
    assert loaded.truth.phi[::10].sum() == pytest.approx(g1.mass + 2.0)
    assert [part.link for part in loaded.truth.parts] == ["torso_link"]


def _run(virtual: VirtualRobot, *texts: str) -> Recording:
    return execute_motion(inject_effects(virtual, texts), _motion(virtual))


def test_a_spring_pulls_towards_its_zero(plain: VirtualRobot, plain_run: Recording) -> None:
    run = _run(plain, "joint_spring:panda_joint4:20")
    held = run.tau_motor[:, 3] - plain_run.tau_motor[:, 3]
    np.testing.assert_allclose(held, 20.0 * run.q[:, 3], rtol=0.02)


def test_friction_of_the_gear_is_in_the_motors_torque(plain: VirtualRobot, plain_run: Recording) -> None:
    for text, law in (
        ("stribeck:panda_joint1:2", lambda v, tau: 2.0 * np.sign(v) * np.exp(-((v / 0.1) ** 2))),
        ("coulomb_asymmetry:panda_joint1:0.2", lambda v, tau: 0.2 * np.ones_like(v)),
        ("load_dependent_friction:panda_joint2:0.1", lambda v, tau: 0.1 * np.abs(tau) * np.sign(v)),
    ):
        joint = int(text.split(":")[1][-1]) - 1
        run = _run(plain, text)
        v, tau = run.v[:, joint], plain_run.tau_link[:, joint]
        moving = np.abs(v) > 0.05
        added = run.tau_motor[:, joint] - plain_run.tau_motor[:, joint]
        expected = law(v, tau)
        assert np.abs(added - expected)[moving].mean() < 0.15 * np.abs(expected).mean()


def test_play_and_a_soft_gear_keep_the_encoder_on_the_motor(plain: VirtualRobot) -> None:
    """The motor follows its command; what it has to give is what a link behind a spring needs."""
    run = _run(plain, "joint_elasticity:panda_joint2")
    assert np.abs(run.q[:, 1] - run.q_cmd[:, 1]).max() < 0.05
    assert run.q.shape[1] == plain.robot.n_joints


def test_a_lag_delays_the_delivered_torque(plain: VirtualRobot) -> None:
    """Logged is the command: the torque that the motion needs, and its rate times the lag."""
    run = _run(plain, "actuator_lag:torque:0.01")
    data = plain.robot.model.createData()
    needed = np.array(
        [pin.rnea(plain.robot.model, data, *row) for row in zip(run.q, run.v, run.a, strict=True)]
    )
    rate = np.gradient(needed, run.time, axis=0)
    v, drives = run.v, plain.drives
    fast = np.abs(v[:, 1]) > 0.1
    late = run.tau_motor - needed - drives.total_viscous * v - drives.total_coulomb * np.sign(v)
    np.testing.assert_allclose(late[fast, 1], 0.01 * rate[fast, 1], atol=0.6)


def test_a_tilt_is_the_gravity_of_a_turned_base(plain: VirtualRobot, plain_run: Recording) -> None:
    run = _run(plain, "base_tilt:base:0.1")
    model = plain.robot.model.copy()
    model.gravity.linear = pin.exp3(np.array([0.1, 0.0, 0.0])) @ model.gravity.linear
    expected = pin.rnea(model, model.createData(), run.q[0], run.v[0], run.a[0])
    np.testing.assert_allclose(run.tau_link[0], expected, atol=0.3)
