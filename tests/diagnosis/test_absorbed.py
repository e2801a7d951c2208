"""What the baseline took from a record: the friction that is there, within its interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.diagnosis.answer.answer import Diagnosis, estimated_gains
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.servo.gains import Rows, fit_gains, spread_of_gains
from excite.logs.files import load_log, save_log
from excite.robot.loading import load_robot
from tests.diagnosis.two_joints import COULOMB, VISCOUS, moved, two_joint_log

JOINTS = ("first", "second")


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """Of three trials that are fitted and one that judges."""
    rng = np.random.default_rng(5)
    roles = dict.fromkeys("abc", "identification") | {"d": "validation"}
    trials = tuple(moved(name, role, 12.0, rng, np.eye(2)) for name, role in roles.items())
    return diagnose(load_log(save_log(two_joint_log(trials), tmp_path_factory.mktemp("log"))))


def test_friction_is_stated_with_an_interval_that_holds_the_truth(found: Diagnosis) -> None:
    sizes = {(item.joint, item.parameter): item for item in found.absorbed}
    assert list(sizes) == [(j, p) for j in JOINTS for p in ("viscous_friction", "coulomb_friction")]
    for name, unit, true in (
        ("viscous_friction", "N·m·s/rad", VISCOUS),
        ("coulomb_friction", "N·m", COULOMB),
    ):
        for joint, value in zip(JOINTS, true, strict=True):
            item = sizes[joint, name]
            assert item.interval90 is not None and item.size.std is not None and item.size.unit == unit
            low, high = item.interval90
            # Student's interval of three trials.
            assert high - low == pytest.approx(2 * 2.92 * item.size.std, rel=1e-3)
            assert item.size.value == pytest.approx(value, rel=0.03)
            assert low - item.size.std < value < high + item.size.std


def test_it_stands_in_the_document(found: Diagnosis) -> None:
    document = found.to_json()
    assert [item["joint"] for item in document["baseline"]] == ["first", "first", "second", "second"]
    assert document["baseline"][0]["unit"] == "N·m·s/rad"


def test_shares_of_the_map_are_those_of_the_budget(found: Diagnosis) -> None:
    assert found.budget is not None
    assert {line.channel: line.share for line in found.where} == found.budget.channel_weights


def test_only_gains_that_nobody_stated_are_listed() -> None:
    robot = load_robot("ur10")
    found = list(
        estimated_gains(robot, robot.joint_names[:2], "kp", "N·m/rad", np.array([200.0, 80.0]), [False, True])
    )
    assert [(item.joint, item.size.value, item.size.unit) for item in found] == [
        (robot.joint_names[1], 80.0, "N·m/rad")
    ]


def test_estimated_gains_are_printed_with_intervals(found: Diagnosis) -> None:
    robot = load_robot("ur10")
    (gain,) = estimated_gains(
        robot, robot.joint_names[:1], "kp", "N·m/rad", [200.0], [True], np.array([10.0])
    )
    low, high = gain.interval90 or (0.0, 0.0)
    assert high - low == pytest.approx(2 * 1.645 * 10.0, rel=1e-3) and low + high == pytest.approx(400.0)
    text = replace(found, absorbed=(gain, *found.absorbed)).summary()
    assert f"kp [N·m/rad]: {robot.joint_names[0]} 200 (184…216)" in text
    friction = next(line for line in text.splitlines() if line.startswith("viscous friction [N·m·s/rad]"))
    assert all(joint in friction for joint in JOINTS) and friction.count("…") == 2


def test_gains_differ_between_stretches_by_what_the_record_tells() -> None:
    """Position errors of a servo with known noise: the truth lies within three deviations, of less noise in fewer."""
    spread = []
    for noise in (1e-4, 1e-3):
        rng = np.random.default_rng(4)
        rows = gain_signals(noise, rng)
        free = np.full(1, np.nan)
        servo = fit_gains(rows, free, free, "none", follows=True).servo
        (std, _) = spread_of_gains(rows, free, free, servo)
        assert abs(servo.kp[0] - 200.0) < 3.0 * std[0] + 1.0
        spread.append(std[0])
    assert 0.0 < spread[0] < spread[1]


def gain_signals(noise: float, rng: np.random.Generator) -> Rows:
    """Rows of one joint under ``200 e + 5 ė``, whose one body is known."""
    t = np.linspace(0.0, 20.0, 1000)
    q, v, a = (
        sum(s * w**k * np.sin(w * t + k * np.pi / 2 + w) for s, w in ((0.5, 2.0), (0.2, 5.1)))[:, None]
        for k in range(3)
    )
    need = 2.0 * a + 10.0 * np.sin(q)
    # The command leads so that kp e + kd ė is what the body needs.
    e = np.zeros_like(need)
    for k in range(1, len(t)):
        e[k] = e[k - 1] + (t[1] - t[0]) * (need[k] - 200.0 * e[k - 1]) / 5.0
    rate = np.gradient(e[:, 0], t)[:, None]
    signals = {"e": e + noise * rng.normal(size=e.shape), "vc": v + rate, "v": v, "a": a, "nominal": need}
    signals |= {"sign": np.sign(v), "gravity": need * 0.0, "inverse_dynamics": need * 0.0}
    return Rows(signals, 1e-3 * need[:, :, None], np.zeros((len(t), 1, 2)))


def test_roll_outs_of_what_the_model_has_err_by_what_noise_makes(found: Diagnosis) -> None:
    assert found.simulation is not None and found.simulation.driven_by == "logged torque"
    for joint, error in found.simulation.before.items():
        assert 0.2 * error < found.simulation.floor[joint] < 5.0 * error
