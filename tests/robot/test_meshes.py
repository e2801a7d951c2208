"""Hulls: never smaller than the mesh, few corners, closed and turned outwards."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from excite.robot.catalogue import example_robot_data
from excite.robot.shapes.link_shapes import convex_hull
from excite.robot.shapes.mesh_files import read_meshes

MESHES = ["g1_description/meshes/head_link.STL", "talos_data/meshes/v2/hip_y_collision.stl"]


def one_mesh(path: Path) -> np.ndarray:
    """Corners of one file."""
    return read_meshes([path])[path]


def excess(hull_vertices: np.ndarray, points: np.ndarray) -> float:
    """How far the points stick out of the polyhedron [m]; negative when inside."""
    planes = ConvexHull(hull_vertices).equations
    return float((points @ planes[:, :3].T + planes[:, 3]).max())


@pytest.mark.parametrize("mesh", MESHES)
def test_hull_contains_the_mesh_and_is_little_larger(mesh: str) -> None:
    points = one_mesh(example_robot_data() / mesh)
    vertices, _ = convex_hull(points)
    assert len(vertices) <= 96
    assert excess(vertices, points) < 1e-9
    outwards = np.vstack([ConvexHull(corners).equations[:, :3] for corners in (vertices, points)]).T
    assert (np.ptp(vertices @ outwards, axis=0) < 1.05 * np.ptp(points @ outwards, axis=0)).all()
    assert ConvexHull(vertices).volume < 1.10 * ConvexHull(points).volume


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(5, 400), flatness=st.sampled_from([1.0, 0.1, 0.01]))
def test_hull_of_any_cloud(seed: int, n: int, flatness: float) -> None:
    points = np.random.default_rng(seed).normal(size=(n, 3)) * [1.0, 0.3, flatness] + [5.0, -3.0, 0.2]
    vertices, faces = convex_hull(points, max_vertices=32)
    assert len(vertices) <= 32
    assert excess(vertices, points) < 1e-8
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->", a - points[0], np.cross(b - points[0], c - points[0])) / 6.0
    assert volume == pytest.approx(ConvexHull(vertices).volume, rel=1e-6)  # closed, outward faces


def test_same_points_same_hull() -> None:
    points = np.random.default_rng(3).normal(size=(500, 3))
    np.testing.assert_array_equal(convex_hull(points)[0], convex_hull(points.copy())[0])


def test_ascii_and_binary_stl_agree(tmp_path: Path) -> None:
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 3]]], dtype=float)
    ascii_lines = ["solid s"]
    binary = b"\0" * 80 + struct.pack("<I", 2)
    for triangle in corners:
        vertices = "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        ascii_lines.append(f"facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet")
        binary += struct.pack("<12fH", 0, 0, 1, *triangle.ravel(), 0)
    (tmp_path / "a.stl").write_text("\n".join([*ascii_lines, "endsolid s"]))
    (tmp_path / "b.stl").write_bytes(binary)
    for name in ("a.stl", "b.stl"):
        np.testing.assert_allclose(one_mesh(tmp_path / name), corners.reshape(-1, 3))
