"""What is said of a tilt."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.effects.bodies import BaseTilt, level_axes
from excite.logs.files import save_log
from excite.logs.log import Log, Trial
from tests.made_log import FRICTION, made_log

RATE_HZ = 200
TILT = 0.06
CRANE = """<robot name="crane">
  <link name="base"/>
  <link name="post"><inertial><mass value="3"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="boom"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
    <inertia ixx="0.005" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="post"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
  <joint name="lift" type="revolute"><parent link="post"/><child link="boom"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>
"""


def tilted(name: str, role: str, seed: int) -> Trial:
    """A crane that leans, and at its post a torque many times what the tilt asks for there."""
    model = pin.buildModelFromXML(CRANE)
    model.gravity.linear = 9.81 * np.array([np.sin(TILT), 0.0, -np.cos(TILT)])
    data, rng = model.createData(), np.random.default_rng(seed)
    t = np.arange(12 * RATE_HZ) / RATE_HZ
    q, v, a = (np.zeros((len(t), 2)) for _ in range(3))
    for j in range(2):
        for k, hertz in enumerate((0.2, 0.5, 0.9)):
            w, size = 2.0 * np.pi * hertz * (1.0 + 0.15 * j), (0.8, 0.3)[j] / (k + 1)
            phase = w * t + rng.uniform(0.0, 2.0 * np.pi)
            q[:, j] += size * np.sin(phase)
            v[:, j] += size * w * np.cos(phase)
            a[:, j] -= size * w**2 * np.sin(phase)
    tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    tau += 0.3 * v + 0.5 * np.sign(v) + 0.02 * rng.normal(size=q.shape)
    tau[:, 0] += 4.0 * np.cos(9.0 * q[:, 0]) * np.abs(v[:, 1])
    return Trial(name=name, role=role, time=t, q=q, tau=tau)


def crane_log(trials: tuple[Trial, ...], *, bodies: str = "rigid_body", rate_hz: int = RATE_HZ) -> Log:
    """A log of the crane, whose model has its bodies, as known or to be fitted, and plain friction."""
    return made_log(trials, ["turn", "lift"], rate_hz, CRANE, modelled=[bodies, *FRICTION])


def test_a_tilt_is_found_beside_more_than_it_asks_for_at_the_first_joint(tmp_path: Path) -> None:
    """What else is there bends the first link's moments, which a tilt alone could not have."""
    trials = (
        tilted("a", "identification", 1),
        tilted("b", "identification", 2),
        tilted("c", "validation", 3),
    )
    log = crane_log(trials)
    found = {item.effect: item for item in diagnose(save_log(log, tmp_path / "crane")).effects}
    assert found["base_tilt"].parameters["angle"].value == pytest.approx(TILT, rel=0.05)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (3.0, -2.0, -9.0), (9.81, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_axes_are_level_and_right_handed_about_up(gravity: tuple[float, float, float]) -> None:
    axes = level_axes(np.array(gravity))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), -axes[2], atol=1e-12)
    np.testing.assert_allclose(axes[2] * np.linalg.norm(gravity), gravity, atol=1e-12)


def test_on_a_level_base_they_are_its_own() -> None:
    np.testing.assert_allclose(level_axes(np.array([0.0, 0.0, -9.81]))[:2], np.eye(3)[:2], atol=1e-12)


def test_a_direction_that_nothing_shows_is_not_told() -> None:
    """A level slide feels one direction of a tilt alone."""
    fit = SimpleNamespace(
        extra=np.array([0.05, 0.0, 0.0, 0.0]), extra_std=np.array([1e-3, np.inf, np.inf, np.inf])
    )
    told = BaseTilt().to_estimates(None, "base", (), fit)
    assert set(told) == {"angle", "gravity_x"}
    assert told["angle"].value == pytest.approx(0.05 / 9.81, rel=1e-3)
    assert told["angle"].std == pytest.approx(1e-3 / 9.81)


def test_of_a_tilt_that_nothing_shows_no_deviation_is_told() -> None:
    """A shaft that stands upright feels none."""
    told = BaseTilt().to_estimates(
        None, "base", (), SimpleNamespace(extra=np.zeros(4), extra_std=np.full(4, np.inf))
    )
    assert set(told) == {"angle"} and told["angle"].std is None


TWO_ARMS = "".join(
    f"""<link name="{side}"><inertial><origin xyz="0 0 -{far}"/><mass value="2"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="{side}" type="revolute"><parent link="base"/><child link="{side}"/><axis xyz="0 1 0"/>
      <origin xyz="0 {y} 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>"""
    for side, far, y in (("left", 0.3, 0.2), ("right", 0.2, -0.2))
)


def test_the_offset_of_one_arm_is_no_rival_of_a_tilt_that_both_feel(tmp_path: Path):
    """Of either arm alone a tilt about its joint's axis is an offset of its encoder."""
    urdf = f'<robot name="two_arms"><link name="base"/>{TWO_ARMS}</robot>'
    model = pin.buildModelFromXML(urdf)
    model.gravity.linear = 9.81 * np.array([np.sin(TILT), 0.0, -np.cos(TILT)])
    data, rng = model.createData(), np.random.default_rng(2)
    trials = []
    for name, role in (("a", "identification"), ("b", "identification"), ("c", "validation")):
        t = np.arange(12 * RATE_HZ) / RATE_HZ
        turns = 2.0 * np.pi * np.array([[0.2, 0.5], [0.25, 0.6]])
        phase = rng.uniform(0.0, 6.28, (2, 2))
        angle = turns * t[:, None, None] + phase
        size = np.array([0.6, 0.3])
        q, v = (size * np.sin(angle)).sum(axis=2), (size * turns * np.cos(angle)).sum(axis=2)
        a = -(size * turns**2 * np.sin(angle)).sum(axis=2)
        tau = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
        tau += 0.3 * v + 0.4 * np.tanh(v / 0.02) + 0.02 * rng.normal(size=q.shape)
        trials.append(Trial(name, role, t, q, tau=tau))
    result = diagnose(
        save_log(
            made_log(trials, ["left", "right"], RATE_HZ, urdf, modelled=["rigid_body_fixed", *FRICTION]),
            tmp_path / "log",
        )
    )
    assert (result.verdict, result.effect) == ("effect", "base_tilt")
    assert result.effects[0].parameters["angle"].value == pytest.approx(TILT, rel=0.02)
