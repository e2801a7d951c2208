"""URDF and MJCF with identified inertials: the rest of the text stays, and simulators take the numbers."""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.errors import InputError, NoSolutionError, RobotError
from excite.export.models import urdf as urdf_module
from excite.export.models.model_format import XmlText
from excite.export.models.parameters import InconsistentModelError, Member, split_segment
from excite.export.models.simulator_model import write_mjcf, write_models, write_urdf
from excite.identification.inertia import parameters_of_pseudo_inertia, pseudo_inertia_matrices
from excite.robot.loading import build_robot, load_robot, model_file
from excite.robot.robot import Robot
from excite.simulation.true_parameters import scattered_parameters
from tests.export.identified import identification_of

pytestmark = pytest.mark.usefixtures("readers_here")

ROBOTS = ("g1", "talos", "ur10", "panda", "iiwa14", "human")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def scattered(robot: Robot) -> np.ndarray:
    return scattered_parameters(robot, np.random.default_rng(0), scatter=0.1).phi


def test_a_urdf_changes_in_its_inertials_alone_and_holds_the_parameters(robot: Robot, tmp_path: Path) -> None:
    parameters = scattered(robot)
    written = write_urdf(robot, identification_of(robot, parameters), tmp_path / "identified.urdf")
    assert written.pinocchio_error <= 1e-9
    before = model_file(robot).read_text().splitlines()
    after = (tmp_path / "identified.urdf").read_text().splitlines()
    changed = [line for line in difflib.ndiff(before, after) if line[0] in "+-"]
    assert changed and all(re.search(r"<(origin|mass|inertia|inertial)\b", line) for line in changed)
    shapes = [[re.sub(r'"[^"]*"', '""', line) for line in lines] for lines in (before, after)]
    added = [line for line in difflib.ndiff(*shapes) if line[0] in "+-"]
    # An inertial without origin gets one, its CoM has moved.
    assert all(line[0] == "+" and line.strip("+ ") == '<origin xyz=""/>' for line in added)
    # Read by the loader of robots, as a user would.
    model = robot.description.model.model_copy(
        update={"package": None, "path": str(tmp_path / "identified.urdf")}
    )
    again = build_robot(robot.description.model_copy(update={"model": model}), robot.source)
    np.testing.assert_allclose(again.nominal_parameters, parameters, rtol=1e-9, atol=1e-12)


def test_links_whose_segment_did_not_change_are_not_touched(ur10: Robot, tmp_path: Path) -> None:
    parameters = ur10.nominal_parameters.copy()
    assert write_urdf(ur10, identification_of(ur10, parameters), tmp_path / "a.urdf").changed == ()
    assert (tmp_path / "a.urdf").read_bytes() == model_file(ur10).read_bytes()
    parameters[20] *= 1.1
    written = write_urdf(ur10, identification_of(ur10, parameters), tmp_path / "b.urdf")
    assert written.changed == ("forearm_link",)


def test_friction_goes_into_dynamics_where_it_is_asked_for(ur10: Robot, tmp_path: Path) -> None:
    drives = {"viscous.elbow_joint": 7.5, "coulomb.elbow_joint": 3.25, "viscous.wrist_1_joint": -0.1}
    found = identification_of(ur10, scattered(ur10), drives)
    written = write_urdf(ur10, found, tmp_path / "a.urdf", drives=True)
    root = ElementTree.parse(tmp_path / "a.urdf").getroot()
    dynamics = root.find("joint[@name='elbow_joint']/dynamics").attrib
    assert (float(dynamics["damping"]), float(dynamics["friction"])) == (7.5, 3.25)
    assert any("wrist_1_joint" in note and "below zero" in note for note in written.notes)
    write_mjcf(ur10, found, tmp_path / "a.xml", drives=True)
    joint = mujoco.MjModel.from_xml_path(str(tmp_path / "a.xml")).joint("elbow_joint")
    assert (joint.damping[0], joint.frictionloss[0]) == (7.5, 3.25)


def test_limits_that_lack_an_effort_are_completed(ur10: Robot, tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(re.sub(r' effort="[^"]*"', "", model_file(ur10).read_text()))
    robot = excite.load_robot(file)
    written = write_urdf(robot, identification_of(robot, scattered(robot)), tmp_path / "a.urdf")
    assert "lacked an effort" in written.notes[0] and "elbow_joint" in written.notes[0]
    np.testing.assert_allclose(
        pin.buildModelFromUrdf(str(tmp_path / "a.urdf")).effortLimit, robot.limits.torque, rtol=1e-6
    )


def test_parameters_of_no_body_are_refused_by_name_unless_forced(ur10: Robot, tmp_path: Path) -> None:
    parameters = scattered(ur10)
    parameters[34] = 5.0  # Ixx of wrist_1_link far above the sum of the others
    found = identification_of(ur10, parameters)
    with pytest.raises(InconsistentModelError, match=r"wrist_1_link.*lmi, cls3.*force") as caught:
        write_urdf(ur10, found, tmp_path / "a.urdf")
    assert caught.value.links == ("wrist_1_link",)
    with pytest.raises(InconsistentModelError):
        write_mjcf(ur10, found, tmp_path / "a.xml")
    assert list(tmp_path.iterdir()) == []
    forced = write_urdf(ur10, found, tmp_path / "a.urdf", force=True)
    assert forced.pinocchio_error <= 1e-9 and forced.mujoco_error is None
    files = write_models(ur10, found, tmp_path)
    assert files.urdf is None and files.mjcf is None and len(files.refused) == 2
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["a.urdf", "differences.csv"]
    assert "wrist_1_link" in files.summary()


def test_a_wrong_number_in_the_file_would_be_noticed(
    ur10: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = urdf_module.number_text
    monkeypatch.setattr(urdf_module, "number_text", lambda *values: original(*(v * 1.00001 for v in values)))
    with pytest.raises(NoSolutionError, match="not what was found"):
        write_urdf(ur10, identification_of(ur10, scattered(ur10)), tmp_path / "a.urdf")
    assert list(tmp_path.iterdir()) == []


def template_of(robot: Robot, path: Path) -> Path:
    """MuJoCo's own conversion of a URDF, with links kept that are fixed to others."""
    root = ElementTree.parse(model_file(robot)).getroot()
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(extension, "compiler", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.compile()
    path.write_text("<!-- by hand -->\n" + spec.to_xml())
    return path


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_a_given_mjcf_changes_in_its_inertials_alone(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    template, parameters = template_of(robot, tmp_path / "template.xml"), scattered(robot)
    written = write_mjcf(robot, identification_of(robot, parameters), tmp_path / "a.xml", template=template)
    assert written.mujoco_error <= 1e-9
    changed = [
        line
        for line in difflib.ndiff(
            template.read_text().splitlines(), (tmp_path / "a.xml").read_text().splitlines()
        )
        if line[0] in "+-"
    ]
    assert len(changed) == 2 * len(robot.segments) and all("<inertial " in line for line in changed)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "a.xml"))
    assert model.body_mass.sum() - parameters[::10].sum() == pytest.approx(
        model.body_mass[0] + _still_mass(robot, model), abs=1e-9
    )


def test_a_template_that_has_the_parameters_already_stays_as_it_is(ur10: Robot, tmp_path: Path) -> None:
    template = template_of(ur10, tmp_path / "template.xml")
    found = identification_of(ur10, ur10.nominal_parameters.copy())
    assert write_mjcf(ur10, found, tmp_path / "a.xml", template=template).changed == ()
    assert (tmp_path / "a.xml").read_bytes() == template.read_bytes()


def _still_mass(robot: Robot, model: mujoco.MjModel) -> float:
    """Mass of the bodies that no joint moves."""
    return sum(float(model.body_mass[b]) for b in range(1, model.nbody) if model.body_weldid[b] == 0)


def test_a_template_of_another_robot_is_refused(ur10: Robot, tmp_path: Path) -> None:
    template = template_of(ur10, tmp_path / "template.xml")
    found = identification_of(ur10, scattered(ur10))
    text = template.read_text()
    template.write_text(text.replace('pos="0 -0.1719 0.612"', 'pos="0 -0.1719 0.5"'))
    with pytest.raises(InputError, match="does not move with joint"):
        write_mjcf(ur10, found, tmp_path / "a.xml", template=template)
    template.write_text(text.replace("elbow_joint", "ellbow"))
    with pytest.raises(InputError, match="no joint 'elbow_joint'"):
        write_mjcf(ur10, found, tmp_path / "a.xml", template=template)


def test_another_robots_identification_and_an_edited_urdf_are_refused(
    ur10: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panda = load_robot("panda")
    with pytest.raises(InputError, match="is of another robot than ur10"):
        write_urdf(ur10, identification_of(panda, scattered(panda)), tmp_path / "a.urdf")
    edited = tmp_path / "edited.urdf"
    edited.write_text(model_file(ur10).read_text().replace('value="12.93"', 'value="13.0"'))
    monkeypatch.setattr(urdf_module, "model_file", lambda _: edited)
    with pytest.raises(InputError, match="load the robot again"):
        write_urdf(ur10, identification_of(ur10, scattered(ur10)), tmp_path / "a.urdf")


def test_a_lump_is_split_into_bodies_that_exist() -> None:
    """The sum is the segment's whatever the share; fixed links give way where the rest would be no body."""
    rng = np.random.default_rng(1)

    def body(mass: float) -> np.ndarray:
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        moments = axes @ np.diag([2.0, 2.5, 3.0]) @ axes.T * 0.01 * mass
        return np.asarray(pin.Inertia(mass, 0.1 * rng.normal(size=3), moments).toDynamicParameters())

    placement = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.05, 0.0, 0.1]))
    hand = Member("hand", placement, body(0.4))
    for mass, shared in ((3.0, False), (0.3, True)):
        total = body(mass)
        split = split_segment(total, [Member("arm", pin.SE3.Identity(), body(1.0)), hand])
        assert ("hand" in split.shares) == shared and split.note
        parts = {"hand": hand.parameters} | split.shares
        inside = placement.homogeneous @ pseudo_inertia_matrices(parts["hand"])[0] @ placement.homogeneous.T
        summed = parameters_of_pseudo_inertia(inside + pseudo_inertia_matrices(parts["arm"])[0])
        np.testing.assert_allclose(summed, total, rtol=1e-9, atol=1e-12)
        if shared:
            assert all(np.linalg.eigvalsh(pseudo_inertia_matrices(p)[0])[0] > 0.0 for p in parts.values())
    frame = split_segment(body(1.0), [Member("frame", pin.SE3.Identity(), None), hand])
    assert list(frame.shares) == ["hand"]


def test_inertia_without_mass_of_a_fixed_link_goes_to_the_link_that_carries_it() -> None:
    total = np.asarray(pin.Inertia(2.0, np.array([0.0, 0.1, 0.0]), 0.1 * np.eye(3)).toDynamicParameters())
    empty = Member("flange", pin.SE3.Identity(), np.array([0.0, 0, 0, 0, 0.1, 0, 0.1, 0, 0, 0.1]))
    split = split_segment(total, [Member("arm", pin.SE3.Identity(), total), empty])
    np.testing.assert_allclose(split.shares["arm"], total, atol=1e-12)
    assert not split.shares["flange"].any()
    assert "flange" in split.note


TEXT = b"""<?xml version='1.0'?>
<!-- <link name="no"/> -->
<robot  name = "r">\r
\t<link name='a > b' note="mass value='1'"><inertial>
    <mass  value = '1.0' /><!-- kept --></inertial></link>
  <link name="\xc3\xa4"/>
</robot>
"""


def test_editing_keeps_every_other_byte() -> None:
    text = XmlText(TEXT, "t")
    first, second = text.root.findall("link")
    assert first.get("name") == "a > b" and second.get("name") == "ä"
    text.root.find("link/inertial/mass").attrib.update(value="2.0", more="3")
    ElementTree.SubElement(second, "x")
    expected = TEXT.replace(b"value = '1.0'", b"value = '2.0' more=\"3\"")
    expected = expected.replace(b'<link name="\xc3\xa4"/>', b'<link name="\xc3\xa4">\n    <x/>\n  </link>')
    assert text.edited() == expected
    assert XmlText(TEXT, "t").edited() == TEXT


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"<robot", "not valid XML"),
        ("<robot/>".encode("utf-16"), "UTF-16"),
        (b'<!DOCTYPE r [<!ENTITY a "b">]><robot/>', "entities"),
    ],
)
def test_texts_that_cannot_be_edited_are_refused(content: bytes, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        XmlText(content, "t")


def test_a_robot_is_fixed_to_a_world_that_its_file_does_not_declare(ur10: Robot, tmp_path: Path) -> None:
    """As files for Drake have it; what is written declares it, so that others read it too."""
    source = model_file(ur10).read_text()
    weld = f'<joint name="weld" type="fixed"><parent link="world"/><child link="{ur10.base_link}"/></joint>'
    text = re.sub(r'<link name="world"\s*/>', "", source)
    if 'parent link="world"' not in text:
        text = re.sub(r"(<robot\b[^>]*>)", rf"\1{weld}", text, count=1)
    (tmp_path / "drake.urdf").write_text(text)
    model = ur10.description.model.model_copy(update={"package": None, "path": str(tmp_path / "drake.urdf")})
    robot = build_robot(ur10.description.model_copy(update={"model": model}), ur10.source)
    parameters = scattered(robot)
    written = write_urdf(robot, identification_of(robot, parameters), tmp_path / "identified.urdf")
    assert written.pinocchio_error <= 1e-9
    assert pin.buildModelFromUrdf(str(tmp_path / "identified.urdf")).nq == robot.n_joints


@pytest.mark.parametrize(("name", "kind"), [("ur10", "planar"), ("g1", "floating")])
def test_a_root_that_slides_or_floats_stays_in_the_file_and_is_read_back(
    name: str, kind: str, tmp_path: Path
) -> None:
    source = load_robot(name)
    text = source.urdf
    base = re.search(rf'<link name="{source.base_link}"', text)
    assert base is not None
    above = f'<link name="floor"/><joint name="carry" type="{kind}"><parent link="floor"/><child link="{{}}"/></joint>'
    root = next(
        iter(set(re.findall(r'<link name="([^"]+)"', text)) - set(re.findall(r'<child link="([^"]+)"', text)))
    )
    (tmp_path / "carried.urdf").write_text(text.replace("</robot>", above.format(root) + "</robot>"))
    model = source.description.model.model_copy(
        update={"package": None, "path": str(tmp_path / "carried.urdf")}
    )
    robot = build_robot(source.description.model_copy(update={"model": model}), source.source)
    written = write_urdf(robot, identification_of(robot, scattered(robot)), tmp_path / "identified.urdf")
    assert written.pinocchio_error <= 1e-9
    assert f'name="carry" type="{kind}"' in (tmp_path / "identified.urdf").read_text()
