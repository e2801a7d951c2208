"""What the baseline took from a record: the friction that is there, within its interval."""

from __future__ import annotations

import numpy as np
import pytest

from excite.diagnosis.answer.absorbed import estimated_gains
from excite.diagnosis.answer.result import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.documents.diagnosis import Diagnosis as Document
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
    document = Document.model_validate(found.to_json())
    assert [item.joint for item in document.baseline] == ["first", "first", "second", "second"]
    assert document.baseline[0].unit == "N·m·s/rad"


def test_shares_of_the_map_are_those_of_the_budget(found: Diagnosis) -> None:
    assert found.budget is not None
    assert {line.channel: line.share for line in found.where} == found.budget.weights


def test_only_gains_that_nobody_stated_are_listed() -> None:
    robot = load_robot("ur10")
    found = list(
        estimated_gains(robot, robot.joint_names[:2], "kp", "N·m/rad", np.array([200.0, 80.0]), [False, True])
    )
    assert [(item.joint, item.size.value, item.size.unit) for item in found] == [
        (robot.joint_names[1], 80.0, "N·m/rad")
    ]
