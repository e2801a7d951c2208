"""Virtual truths stay physical and say what they changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError
from excite.robot import load as bringing
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.true_parameters import (
    AddedPart,
    TrueParameters,
    hrp2_like_changes,
    nominal_drives,
    nominal_truth,
    principal_inertia,
    scattered_drives,
    scattered_parameters,
    with_part,
)
from tests.simulation.motions import generator


def test_five_kilograms_are_added_where_hrp2_got_them(g1: Robot) -> None:
    truth = hrp2_like_changes(g1, generator(0))
    links = {part.link for part in truth.parts}
    assert links == {"torso_link", "left_wrist_yaw_link", "right_wrist_yaw_link"}
    assert truth.added_mass == pytest.approx(5.0)
    difference = (truth.phi - g1.nominal_parameters).reshape(-1, 10)
    assert difference[:, 0].sum() == pytest.approx(5.0)
    changed = {g1.segments[row].link for row in np.flatnonzero(np.abs(difference).max(axis=1) > 0.0)}
    assert changed == links


def test_a_robot_with_a_head_gets_cameras_in_it() -> None:
    truth = hrp2_like_changes(load_robot("talos"), generator(0))
    assert [part.what for part in truth.parts].count("cameras") == 1
    assert any("head" in part.link for part in truth.parts)


def test_same_generator_same_truth(g1: Robot) -> None:
    first, second = (hrp2_like_changes(g1, generator(4), scatter=0.03) for _ in range(2))
    np.testing.assert_array_equal(first.phi, second.phi)
    assert first.parts == second.parts
    assert not np.array_equal(first.phi, hrp2_like_changes(g1, generator(5), scatter=0.03).phi)


@pytest.mark.parametrize("scatter", [0.02, 0.3])
def test_scatter_keeps_bodies_physical_and_feet_nominal(g1: Robot, scatter: float) -> None:
    truth = scattered_parameters(g1, generator(6), scatter=scatter)
    feet = {foot.joint - 1 for foot in g1.feet}
    for index, segment in enumerate(g1.segments):
        block, nominal = (phi[g1.parameter_columns(index)] for phi in (truth.phi, g1.nominal_parameters))
        principal_inertia(block, segment.name)
        assert np.array_equal(block, nominal) == (index in feet)
    ratio = np.log(truth.phi[::10] / g1.nominal_parameters[::10])
    assert 0.5 * scatter < ratio[ratio != 0.0].std() < 1.5 * scatter


def test_an_arm_has_other_friction_than_declared(panda: Robot) -> None:
    nominal, true = nominal_drives(panda), scattered_drives(panda, generator(7))
    assert (true.viscous > 0.0).all() and (true.coulomb > 0.0).all()
    assert not np.isclose(true.viscous, nominal.viscous).any()
    np.testing.assert_array_equal(true.kp, nominal.kp)


def test_a_robot_without_hands_is_refused(panda: Robot) -> None:
    with pytest.raises(InputError, match="scattered_parameters"):
        hrp2_like_changes(panda, generator(0))


def test_a_part_without_mass_is_refused(g1: Robot) -> None:
    with pytest.raises(InputError, match="mass 0"):
        with_part(nominal_truth(g1), AddedPart("air", 0, "pelvis", 0.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1)))


def test_a_part_on_a_body_that_cannot_be_is_carried_by_the_nearest_that_can() -> None:
    """The trunk of TOCABI has 1.27 kg·m² about one axis, 0.42 about the two others together."""
    trunk = pin.Inertia(18.0, np.array([-0.07, 0.0, 0.17]), np.diag([1.27, 0.24, 0.18])).toDynamicParameters()
    part = AddedPart("load", 0, "trunk", 14.0, (-0.1, 0.0, 0.1), (0.1, 0.1, 0.1))
    carrying = with_part(TrueParameters(trunk.copy()), part).phi
    assert principal_inertia(carrying, "trunk").mass == pytest.approx(32.0)
    np.testing.assert_allclose(carrying[1:4] - trunk[1:4], 14.0 * np.array(part.position))


def test_moments_that_no_body_has_are_raised_to_ones_that_simulators_take() -> None:
    """MuJoCo refuses two that add up to less than the third by rounding: those of a wrist of TOCABI did."""
    rng = generator(3)
    for _ in range(200):
        small, large = rng.uniform(1e-4, 1e-3, size=2), rng.uniform(5e-3, 2e-2)
        phi = pin.Inertia(0.1, rng.normal(size=3), np.diag([*small, large])).toDynamicParameters()
        least, middle, most = principal_inertia(phi, "wrist", accepted=True).moments
        assert least + middle > most


def test_a_robot_of_point_masses_is_scattered_as_the_bodies_that_a_simulator_has_for_them(
    tmp_path: Path,
) -> None:
    links, joints = [], []
    for k in range(3):
        links.append(
            f'<link name="l{k}"><inertial><origin xyz="0.2 0 0"/><mass value="{3 - k}"/>'
            '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        joints.append(
            f'<joint name="j{k}" type="revolute"><parent link="{f"l{k - 1}" if k else "base"}"/>'
            f'<child link="l{k}"/><origin xyz="0.3 0 0"/><axis xyz="0 {k % 2} {1 - k % 2}"/>'
            '<limit lower="-2" upper="2" effort="50" velocity="3"/></joint>'
        )
    file = tmp_path / "points.urdf"
    file.write_text(f'<robot name="points"><link name="base"/>{"".join(links + joints)}</robot>')
    robot = bringing.load_robot(file)
    truth = scattered_parameters(robot, generator(1))
    for segment, phi in zip(robot.segments, truth.phi.reshape(-1, 10), strict=True):
        assert principal_inertia(phi, segment.name).mass == pytest.approx(phi[0])
    np.testing.assert_allclose(truth.phi[::10], robot.nominal_parameters[::10], rtol=0.3)
