"""A robot no two bodies of which need stay apart can be planned for; one without shapes cannot be judged."""

from __future__ import annotations

from pathlib import Path

import pytest

from excite.campaign.plan import plan
from excite.errors import RobotError
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.robot import Robot


def pendulum(folder: Path, *, edit: tuple[str, str] = ("", "")) -> Robot:
    """A bar on a slide, described by the scaffold, with a piece of its robot.yaml replaced."""

    def link(name: str, size: str) -> str:
        return (
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" '
            f'ixz="0" iyz="0"/></inertial><collision><geometry><box size="{size}"/></geometry></collision></link>'
        )

    limit = '<limit lower="-1" upper="1" effort="50" velocity="2"/>'
    path = folder / "pendulum.urdf"
    path.write_text(
        f'<robot name="pendulum">{link("rail", "2 .02 .02")}{link("cart", ".2 .1 .1")}{link("bar", ".02 .02 .5")}'
        '<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>'
        f'{limit}</joint><joint name="swing" type="revolute"><parent link="cart"/><child link="bar"/>'
        f'<origin xyz="0 0.1 0.2"/><axis xyz="0 1 0"/>{limit}</joint></robot>'
    )
    file = write_scaffold(path, folder, overwrite=True).description
    text = file.read_text()
    assert edit[0] in text
    file.write_text(text.replace(*edit))
    return load_robot(file)


def test_a_pendulum_has_no_margin_of_collision_and_moves(tmp_path: Path) -> None:
    made = plan(pendulum(tmp_path), n_candidates=3, seed=1)
    assert len(made.accepted) >= 1
    verdict = made.accepted[0].metadata.verdict
    assert verdict is not None and verdict["safe"]


def test_bodies_without_shapes_are_not_taken_for_safe(tmp_path: Path) -> None:
    robot = pendulum(tmp_path, edit=("geometry: collision", "geometry: visual"))
    with pytest.raises(RobotError, match="geometry"):
        plan(robot, n_candidates=1, seed=1)
