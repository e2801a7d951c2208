"""Which joints slide: one answer for limits, units, frictions and distances."""

from __future__ import annotations

import re

import pinocchio as pin
import pytest

from excite.robot.prismatic import is_prismatic
from tests.architecture.source_tree import PACKAGE, ROOT

AXES = {
    "slides along x": (pin.JointModelPX(), True),
    "slides along a line": (pin.JointModelPrismaticUnaligned(0.6, 0.8, 0.0), True),
    "turns about z": (pin.JointModelRZ(), False),
    "turns about a line": (pin.JointModelRevoluteUnaligned(0.6, 0.8, 0.0), False),
}


@pytest.mark.parametrize("axis", AXES)
def test_a_joint_slides_where_it_moves_without_turning(axis):
    joint, expected = AXES[axis]
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.addJoint(first, joint, pin.SE3.Identity(), "joint")
    assert is_prismatic(model, 6) is expected


def test_no_module_tells_it_by_names_of_pinocchios_classes():
    # "JointModelP" begins what a planar joint is called, too; the regressor's table lists whole names.
    found = [
        path.name
        for path in (ROOT / PACKAGE).rglob("*.py")
        if re.search(r'startswith\("JointModelP"\)', path.read_text(encoding="utf-8"))
    ]
    assert found == []
