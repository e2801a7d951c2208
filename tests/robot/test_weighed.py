"""Models without masses: what their geometry would weigh, said, and against robots whose masses are known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import RobotError
from excite.robot.description import UncertaintyBlock
from excite.robot.init_robot.files import write_scaffold
from excite.robot.load import load_robot
from tests.reproduction.recordings import example_robot_data
from tests.robot.small import ARM
from tests.robot.test_scaffold import hand_on_an_arm

DENSITY = 1000.0


def without_masses(text: str) -> str:
    return re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL)


def test_boxes_weigh_what_boxes_weigh(tmp_path: Path) -> None:
    box = '<collision><origin xyz="0.1 0 0" rpy="0 0 0.5"/><geometry><box size="0.2 0.05 0.04"/></geometry></collision>'
    (tmp_path / "arm.urdf").write_text(
        f"""<robot name="arm"><link name="base">{box}</link><link name="rod">{box}{box}</link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" velocity="2" effort="20"/></joint></robot>"""
    )
    robot = load_robot(tmp_path / "arm.urdf")
    mass, sides = 2.0 * DENSITY * 0.2 * 0.05 * 0.04, np.array([0.2, 0.05, 0.04])
    inertia = robot.model.inertias[1]
    assert inertia.mass == pytest.approx(mass, rel=1e-5)
    np.testing.assert_allclose(inertia.lever, [0.1, 0.0, 0.0], atol=1e-6)
    moments = mass / 12.0 * (np.sum(sides**2) - sides**2)
    np.testing.assert_allclose(np.linalg.eigvalsh(inertia.inertia), np.sort(moments), rtol=1e-5)
    (said,) = (one for one in robot.description.assumed if one.what == "masses")
    assert "1.2 kg in all" in said.value and "90% of published arms weigh within" in said.consequence


@pytest.mark.usefixtures("reader_here")
@pytest.mark.parametrize(
    ("model", "kilograms"),
    [("panda_description/urdf/panda.urdf", 17.45), ("ur_description/urdf/ur5_robot.urdf", 20.99)],
)
def test_known_arms_weigh_half_to_twice_what_they_do(model: str, kilograms: float, tmp_path: Path) -> None:
    source = example_robot_data() / model
    text = without_masses(source.read_text())
    # The package is found among those of the wheel, wherever the model is.
    (tmp_path / "arm.urdf").write_text(text)
    made = write_scaffold(tmp_path / "arm.urdf", tmp_path / "out")
    (said,) = (one for one in made.assumed if one.what == "masses")
    assert 0.5 < float(said.value.split()[0]) / kilograms < 2.0
    assert load_robot(made.description).n_joints >= 6


@pytest.mark.usefixtures("reader_here")
@pytest.mark.parametrize("masses", ["stated", "assumed"])
def test_drives_that_nobody_stated_hold_all_bodies_that_are_judged_for(masses: str, tmp_path: Path) -> None:
    """The weights of bodies at the far ends of the stated widths, moved to random sides, in random postures."""
    text = (example_robot_data() / "ur_description/urdf/ur5_robot.urdf").read_text()
    text = text if masses == "stated" else without_masses(text)
    (tmp_path / "arm.urdf").write_text(re.sub(r' effort="[^"]*"', "", text))
    robot = load_robot(write_scaffold(tmp_path / "arm.urdf", tmp_path / "out").description)
    widths, rng = robot.description.uncertainty or UncertaintyBlock(), np.random.default_rng(0)
    needed = np.zeros(robot.n_joints)
    for _ in range(50):
        model = pin.Model(robot.model)
        for body in list(model.inertias)[1:]:
            side = rng.normal(size=3)
            body.lever = body.lever + widths.com * side / np.linalg.norm(side)
            body.mass *= 1.0 + widths.mass
        q = rng.uniform(robot.limits.position_lower, robot.limits.position_upper)
        needed = np.maximum(needed, np.abs(pin.computeGeneralizedGravity(model, model.createData(), q)))
    assert (robot.limits.torque > 2.0 * needed).all()


def test_a_model_that_states_masses_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    made = write_scaffold(tmp_path / "arm.urdf", tmp_path / "out")
    assert made.urdf == tmp_path / "arm.urdf" and "masses" not in {one.what for one in made.assumed}


def test_without_masses_and_geometry_nothing_can_be_told(tmp_path: Path) -> None:
    text = re.sub(r"<(collision|visual)>.*?</\1>", "", without_masses(hand_on_an_arm()), flags=re.DOTALL)
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(RobotError, match=r"states no masses.*add <inertial>.*--package-path"):
        load_robot(tmp_path / "arm.urdf")


def test_points_have_no_density_and_are_no_grams(tmp_path: Path) -> None:
    """Links that are point masses, on drives that are too weak for them: their masses are kilograms all the same."""
    text = re.sub(r'(i[xyz]{2})="[^"]*"', r'\1="0"', ARM)
    (tmp_path / "arm.urdf").write_text(re.sub(r'effort="[^"]*"', 'effort="0.05"', text))
    robot = load_robot(tmp_path / "arm.urdf")
    stated = [float(mass) for mass in re.findall(r'<mass value="([^"]*)"', text)]
    moving = [inertia.mass for inertia in robot.model.inertias if inertia.mass > 0.0]
    assert moving and all(min(abs(mass - m) for m in stated) < 1e-9 for mass in moving)
    assert not any("grams" in str(one) for one in robot.description.assumed)
