"""A load at the tool beside a gain of one torque: likely bodies explain both, and the doctor says so."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from excite.motion.motion import Motion
from excite.robot.loading import load_robot


def motion(robot) -> Motion:
    """Five harmonics of 20 s about the middle of the ranges."""
    rng, t, limits = np.random.default_rng(0), np.arange(0.0, 20.0, 0.01), robot.limits
    span = limits.position_upper - limits.position_lower
    q = np.tile(0.5 * (limits.position_upper + limits.position_lower), (len(t), 1))
    v, a = np.zeros_like(q), np.zeros_like(q)
    for k in range(1, 6):
        w, size = 0.1 * np.pi * k, rng.normal(size=robot.n_joints) * np.minimum(0.3 * span, 0.9) / 3.0
        angle = w * t[:, None] + rng.uniform(0.0, 6.0, robot.n_joints)
        q += size * np.sin(angle)
        v += size * w * np.cos(angle)
        a -= size * w * w * np.sin(angle)
    return Motion("motion", robot.name, robot.joint_names, t, q, v, a)


CASES = {
    "load and gain": ("ur10", 0.7, "wrist_3_link", 1.1, "elbow_joint"),
    "load and a gain below one": ("panda", 1.0, "panda_link7", 0.88, "panda_joint4"),
    "load": ("ur10", 0.7, "wrist_3_link", 1.0, "elbow_joint"),
    "gain": ("ur10", 0.0, "wrist_3_link", 1.1, "elbow_joint"),
}


@pytest.mark.parametrize("case", CASES)
def test_load_and_scale_are_said_to_be_alike_where_both_are_there(case):
    name, mass, link, gain, joint = CASES[case]
    effects = [f"payload:{link}:{mass}"] * (mass > 0.0) + [f"torque_gain:{joint}:{gain}"] * (gain != 1.0)
    robot = load_robot(name)
    log = excite.simulate(name, [motion(robot)], inject=effects, nominal=True).log
    found = [item for item in excite.doctor(log, robot).findings if item.kind == "load_or_scale"]
    assert bool(found) == (mass > 0.0 and gain != 1.0)
    for item in found:
        assert item.places[0] == joint and not item.repaired
        assert item.figures["gain"] == pytest.approx(gain, rel=0.02)
        assert item.figures["mass_kg"] == pytest.approx(mass, rel=0.1)
        assert "known mass" in item.remedy
