"""URDF, MJCF and meshes that are broken or malicious: each is read or refused, and nothing else happens."""

from __future__ import annotations

import copy
import os
import random
import struct
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import excite.robot.shapes.mesh_files
from excite.atomic import write_text
from excite.errors import ExciteError, RobotError
from excite.export.models.mjcf import read_template
from excite.export.models.mjcf_compiled import compile_mjcf
from excite.robot.catalogue import example_robot_data
from excite.robot.init_robot.description import scaffold_description
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.mjcf.conversion import convert_mjcf, scan_mjcf
from excite.robot.shapes.mesh_files import binary_stl, read_meshes
from tests.corpus.arm import MJCF, replaced
from tests.robot.small import ARM

NASTY = [
    "", " ", "nan", "inf", "-inf", "1e300", "-1", "0", "1e999", "１", "1,5", "0x10", "1 2 3 4 5 6 7", "x" * 5000,
    "\u2028", "/dev/zero", "..", "9" * 400, "true", "0 0 0", "1 1e17 1", "upper", "lower", "elbow",
]  # fmt: skip


def one_mesh(path: Path) -> np.ndarray:
    """Corners of one file."""
    return read_meshes([path])[path]


def mutated(text: str, data: st.DataObject) -> bytes:
    """A model with an element or attribute dropped, moved, doubled or given another value."""
    root = ElementTree.fromstring(text)
    for _ in range(data.draw(st.integers(1, 3))):
        elements = list(root.iter())
        element = data.draw(st.sampled_from(elements))
        kind = data.draw(st.sampled_from(["drop", "twice", "value", "forget", "rename", "move"]))
        if kind in {"drop", "twice", "move"} and len(element):
            child = data.draw(st.sampled_from(list(element)))
            if kind == "drop":
                element.remove(child)
            elif kind == "twice":
                element.append(copy.deepcopy(child))
            else:
                data.draw(st.sampled_from(elements)).append(copy.deepcopy(child))
        elif kind == "rename":
            element.tag = data.draw(st.sampled_from([other.tag for other in elements]))
        elif element.attrib:
            name = data.draw(st.sampled_from(sorted(element.attrib)))
            if kind == "forget":
                del element.attrib[name]
            else:
                element.set(name, data.draw(st.sampled_from(NASTY)))
    return ElementTree.tostring(root, encoding="utf-8")


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_changed_urdf_is_described_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(mutated(ARM, data))
    try:
        scaffold_description(path)
    except ExciteError as error:
        assert "arm.urdf" in str(error) and "\n" not in str(error)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_changed_mjcf_is_looked_through_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "arm.xml"
    path.write_bytes(mutated(MJCF, data))
    try:
        scan_mjcf(path)
    except RobotError as error:
        assert "arm.xml" in str(error)


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_changed_mjcf_is_converted_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "arm.xml"
    path.write_bytes(mutated(MJCF, data))
    try:
        assert convert_mjcf(path).urdf
    except RobotError as error:
        assert "arm.xml" in str(error)


def test_a_mujoco_model_that_cannot_be_described_leaves_nothing(tmp_path: Path) -> None:
    source = tmp_path / "arm.xml"
    source.write_text(replaced(MJCF, 'range="-2 2"', 'range="-120 120"'), encoding="utf-8")
    with pytest.raises(RobotError, match=r"arm\.xml: .*looks like degrees"):
        write_scaffold(source, tmp_path / "out" / "deep")
    assert list(tmp_path.iterdir()) == [source]


def test_a_failed_description_leaves_an_older_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, out = tmp_path / "arm.xml", tmp_path / "out"
    source.write_text(MJCF, encoding="utf-8")
    write_scaffold(source, out)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert {path.name for path in before} == {"robot.yaml", "arm.urdf"}
    source.write_text(MJCF.replace('mass="1"', 'mass="7"'), encoding="utf-8")

    def full(path: Path, text: str) -> Path:
        if path == out / "robot.yaml":
            raise OSError(28, "No space left on device", str(path))
        return write_text(path, text)

    monkeypatch.setattr("excite.robot.init_robot.files.write_text", full)
    with pytest.raises(OSError, match="No space"):
        write_scaffold(source, out, overwrite=True)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def damaged(content: bytes, rng: random.Random) -> bytes:
    """A file with bits flipped, its end cut off, or a piece of it doubled."""
    changed = bytearray(content)
    kind = rng.choice(["flip", "flips", "cut", "double"])
    if kind == "cut":
        del changed[rng.randrange(len(changed)) :]
    elif kind == "double":
        place = rng.randrange(len(changed))
        changed[place:place] = changed[place : place + 100]
    else:
        for _ in range(1 if kind == "flip" else 30):
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_a_damaged_stl_is_read_or_refused(kind: str, tmp_path: Path) -> None:
    corners = np.random.default_rng(0).uniform(-0.1, 0.1, (20, 3, 3))
    content = binary_stl(corners)
    if kind == "text":
        facets = "".join(
            "facet normal 0 0 1\nouter loop\n"
            + "".join(f"vertex {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in triangle)
            + "endloop\nendfacet\n"
            for triangle in corners
        )
        content = f"solid part\n{facets}endsolid part\n".encode()
    path, rng = tmp_path / "part.stl", random.Random(1)
    path.write_bytes(content)
    np.testing.assert_allclose(one_mesh(path), corners.reshape(-1, 3), atol=1e-6)
    for _ in range(200):
        path.write_bytes(damaged(content, rng))
        try:
            points = one_mesh(path)
        except RobotError as error:
            assert "part.stl" in str(error)
        else:
            assert np.isfinite(points).all()


@pytest.mark.parametrize("triangles", [0, 1, 3, 2**32 - 1])
def test_an_stl_whose_count_disagrees_with_its_size_is_refused(triangles: int, tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    content = binary_stl(np.random.default_rng(0).uniform(size=(2, 3, 3)))
    path.write_bytes(content[:80] + struct.pack("<I", triangles) + content[84:])
    with pytest.raises(
        RobotError, match=r"part\.stl: mesh is no whole STL file.*; it is damaged: export it again"
    ):
        one_mesh(path)


@pytest.mark.parametrize("suffix", [".obj", ".dae"])
def test_a_mesh_that_the_loader_refuses_is_one_error(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"part{suffix}"
    path.write_bytes(os.urandom(200))
    with pytest.raises(RobotError, match=rf"part\{suffix}: mesh cannot be read"):
        one_mesh(path)


def test_a_mesh_that_keeps_the_loader_busy_is_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = next(example_robot_data().rglob("*.dae"))
    monkeypatch.setattr(excite.robot.shapes.mesh_files, "BATCH_SECONDS", 0.01)
    monkeypatch.setattr(excite.robot.shapes.mesh_files, "SECONDS_A_MEGABYTE", 0.0)
    with pytest.raises(RobotError, match=r"takes its reader more than 0\.01 s; check"):
        one_mesh(mesh)


def test_meshes_of_one_robot_are_read_as_one_by_one() -> None:
    folder = example_robot_data()
    paths = sorted(folder.rglob("*.obj"))[:2] + sorted((folder / "ur_description").rglob("*.stl"))[:2]
    together = read_meshes(paths)
    for path in paths:
        np.testing.assert_array_equal(together[path], one_mesh(path))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('mass="1"', 'mass="nan"', r"inertial@mass: is 'nan'"),
        (
            "</worldbody>",
            '<replicate count="99999999"><body/></replicate></worldbody>',
            "stands for more than",
        ),
        ("<compiler", '<include file="arm.xml"/><compiler', "includes itself"),
    ],
)
def test_a_bad_template_is_refused_before_mujoco_reads_it(
    old: str, new: str, line: str, tmp_path: Path
) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(replaced(MJCF, old, new), encoding="utf-8")
    with pytest.raises(RobotError, match=line):
        read_template(load_robot("ur10"), path)


def test_a_template_is_compiled_as_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(MJCF, encoding="utf-8")
    model = compile_mjcf(path.read_bytes(), path)
    np.testing.assert_allclose(model.body_mass, [0.0, 2.0, 1.0])
    np.testing.assert_allclose(model.body_ipos[2], [0.0, 0.0, 0.15])
