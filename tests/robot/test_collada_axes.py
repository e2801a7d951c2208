"""Collada meshes with y up: which reading is meant is said by the links' centres of mass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.shapes.collision import collision_shapes

pytestmark = pytest.mark.usefixtures("readers_here")

# A bar of 0.3 m along its file's z, from the origin, 0.04 m by 0.02 m across.
_CORNERS = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.01, 0.01) for z in (0.0, 0.3)])
_FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6)]


def collada(up: str) -> str:
    """A Collada file of the bar."""
    numbers = " ".join(f"{x:g}" for x in _CORNERS.ravel())
    faces = " ".join(str(i) for face in _FACES for i in face)
    return f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified><unit name="meter" meter="1"/>
<up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="bar"><mesh>
<source id="p"><float_array id="pa" count="24">{numbers}</float_array><technique_common>
<accessor source="#pa" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(_FACES)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#bar"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def chain(folder: Path, up: str, centre: str, links: int = 4) -> Path:
    """A chain of bars whose centres of mass lie at ``centre``."""
    (folder / "bar.dae").write_text(collada(up))
    link = (
        f'<inertial><origin xyz="{centre}"/><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><geometry><mesh filename="bar.dae"/></geometry></collision>'
    )
    parts = [f'<link name="l{i}">{link}</link>' for i in range(links)]
    parts += [
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="{centre}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="50" velocity="2"/></joint>'
        for i in range(links - 1)
    ]
    path = folder / "chain.urdf"
    path.write_text(f'<robot name="chain">{"".join(parts)}</robot>')
    return path


@pytest.mark.parametrize(
    ("up", "centre", "extent"),
    [
        ("Z_UP", "0 0 0.15", (0.04, 0.02, 0.3)),
        ("Y_UP", "0 0 0.15", (0.04, 0.02, 0.3)),  # drawn for readers that leave meshes as they are
        ("Y_UP", "0 -0.15 0", (0.04, 0.3, 0.02)),  # drawn for readers that turn them upright
        ("Z_UP", "0 -0.15 0", (0.04, 0.02, 0.3)),
    ],
)
def test_the_reading_that_the_masses_speak_for_is_taken(
    tmp_path: Path, up: str, centre: str, extent: tuple[float, float, float]
) -> None:
    written = write_scaffold(chain(tmp_path, up, centre), tmp_path)
    shapes = [s for s in collision_shapes(load_robot(written.description)) if s.link == "l2"]
    (shape,) = shapes
    assert shape.vertices is not None
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), extent, rtol=0.05)


def test_two_links_are_not_enough_to_turn_meshes(tmp_path: Path) -> None:
    written = write_scaffold(chain(tmp_path, "Y_UP", "0 -0.15 0", links=2), tmp_path)
    shape = next(s for s in collision_shapes(load_robot(written.description)) if s.link == "l1")
    assert shape.vertices is not None
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), (0.04, 0.02, 0.3), rtol=0.05)
