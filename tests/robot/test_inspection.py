"""A robot's description judged by itself: each fault is named with its link and cured by what is advised."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from scipy.optimize import minimize
from typer.testing import CliRunner

from excite.cli.main import app
from excite.robot.catalogue import bundled_robots
from excite.robot.inspection.chart import examine_description
from excite.robot.inspection.links import hull_of
from excite.robot.inspection.rules import nearest_inertia
from excite.robot.urdf.inertia import symmetric_matrix
from tests.corpus.arm import MJCF, replaced
from tests.robot.small import ARM

pytestmark = pytest.mark.usefixtures("readers_here")

SHARED = Path(__file__).parents[3] / "shared" / "cases"
Change = Callable[[ElementTree.Element], None]
# Of the six numbers in the Frobenius norm.
_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _inertial(root: ElementTree.Element, link: str) -> ElementTree.Element:
    found = root.find(f"link[@name='{link}']/inertial")
    assert found is not None
    return found


def _set(tag: str, *links: str, **values: str) -> Change:
    """Write attributes of an element in the inertial of links, of both where none is named."""

    def change(root: ElementTree.Element) -> None:
        for link in links or ("upper", "lower"):
            element = _inertial(root, link).find(tag)
            assert element is not None
            element.attrib.update(values)

    return change


def _moments(*values: float) -> Change:
    return _set("inertia", "lower", **{k: repr(v) for k, v in zip(_MOMENTS, values, strict=True)})


def _limit(**values: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        limit = root.find("joint[@name='elbow']/limit")
        assert limit is not None
        limit.attrib.update(values)

    return change


def _in_units(factor: float) -> Change:
    """All inertias in another unit."""

    def change(root: ElementTree.Element) -> None:
        for element in root.iter("inertia"):
            element.attrib.update({k: repr(factor * float(v)) for k, v in element.attrib.items()})

    return change


def _mesh(root: ElementTree.Element) -> None:
    geometry = root.find("link[@name='lower']/collision/geometry")
    assert geometry is not None
    geometry.remove(geometry[0])
    ElementTree.SubElement(geometry, "mesh", filename="package://nowhere/lower.stl")


def _written(folder: Path, *changes: Change) -> Path:
    root = ElementTree.fromstring(ARM)
    for change in changes:
        change(root)
    file = folder / "arm.urdf"
    file.write_text(ElementTree.tostring(root, encoding="unicode"))
    return file


def test_a_sound_arm_has_nothing(tmp_path: Path) -> None:
    assert examine_description(_written(tmp_path)).findings == ()


@pytest.mark.parametrize("name", bundled_robots())
def test_nothing_spoils_a_bundled_robot(name: str) -> None:
    assert examine_description(name).healthy


_FAULTS = {
    "heavy": (_set("mass", "lower", value="100"), "density", "lower", "decimal point"),
    "grams": (_set("mass", "lower", value="1000"), "density", "lower", "grams for kilograms"),
    "tonnes": (_set("mass", "lower", value="0.0011"), "density", "lower", "lighter than foam|×"),
    "sign of the centre": (_set("origin", "lower", xyz="0 0 -0.15"), "com_outside", "lower", 'z: xyz="0 0 0.15"'),
    "exchanged centre": (_set("origin", "lower", xyz="0.15 0 0"), "com_outside", "lower", 'xyz="0 0 0.15"'),
    "centre of ten times": (_set("origin", "lower", xyz="0 0 1.5"), "com_outside", "lower", 'xyz="0 0 0.15"'),
    "centre in millimetres": (_set("origin", "lower", xyz="0 0 90"), "com_outside", "lower", 'xyz="0 0 0.09"'),
    "centre in centimetres": (_set("origin", "lower", xyz="0 0 15"), "com_outside", "lower", 'xyz="0 0 0.15"'),
    "triangle": (_moments(0.01, 0.0, 0.0, 0.0075, 0.0, 0.002), "triangle", "lower", "nearest inertia"),
    "row by row": (_moments(0.01, 1e-4, 0.0, 1e-4, 0.01, 2e-4), "not_positive", "lower", "row by row.*lost"),
    "row by row of a diagonal": (_moments(0.01, 0.0, 0.0, 0.0, 0.01, 0.0), "not_positive", "lower", "row by row"),
    "order of MJCF": (_moments(0.01, 0.01, 0.002, 0.0, 1e-4, 0.0), "not_positive", "lower", "MJCF's order"),
    "lower triangle": (_moments(0.01, 1e-4, 0.01, 2e-4, 0.0, 0.002), "not_positive", "lower", "lower triangle"),
    "a sign": (_moments(0.01, 0.0, 0.0, -0.01, 0.0, 0.002), "not_positive", "lower", "sign lost of iyy"),
    "all signs": (_moments(-0.01, 0.0, 0.0, -0.01, 0.0, -0.002), "not_positive", "lower", 'all moments: ixx="0.01"'),
    "a decimal point": (_moments(0.1, 0.0, 0.0, 0.01, 0.0, 0.002), "triangle", "lower", "lost in ixx"),
    "negative mass": (_set("mass", "lower", value="-1"), "not_positive", "lower", 'value="1"'),
    "kg·mm²": (_in_units(1e6), "inertia_scale", "upper", "kg·mm² for kg·m²"),
    "g·mm²": (_in_units(1e9), "inertia_scale", "lower", "g·mm² for kg·m²"),
    "kg·cm²": (_in_units(1e4), "inertia_scale", "lower", "kg·cm² for kg·m²"),
    "no mass": (_set("mass", "lower", value="0"), "inertial", "lower", "mass"),
    "mass that is no number": (_set("mass", "lower", value="1,5"), "bad_number", "lower", "decimal point"),
    "limits turned": (_limit(lower="2", upper="-2"), "limits_turned", "elbow", 'lower="-2" upper="2"'),
    "limits in degrees": (_limit(lower="-120", upper="120"), "limits_degrees", "elbow", 'upper="2.094"'),
    "negative effort": (_limit(effort="-20"), "limits_negative", "elbow", 'effort="20"'),
}  # fmt: skip


@pytest.mark.parametrize("fault", _FAULTS)
def test_each_fault_is_named_with_its_place_and_cure(fault: str, tmp_path: Path) -> None:
    change, kind, place, cure = _FAULTS[fault]
    chart = examine_description(_written(tmp_path, change))
    (found,) = [one for one in chart.findings if one.kind == kind]
    assert place in found.places and found.severity == "spoils"
    assert re.search(cure, found.remedy), found.remedy
    assert not chart.healthy and chart.findings[0].severity == "spoils"


@pytest.mark.parametrize(
    "fault", [name for name, (_, kind, *_) in _FAULTS.items() if kind in {"triangle", "not_positive"}]
)
def test_the_advised_inertia_is_one_that_is_not_found_wrong(fault: str, tmp_path: Path) -> None:
    change = _FAULTS[fault][0]
    remedy = examine_description(_written(tmp_path, change)).findings[0].remedy
    advised = dict(re.findall(r'(\w+)="([^"]+)"', remedy))
    tag = "mass" if "value" in advised else "inertia"
    assert examine_description(_written(tmp_path, change, _set(tag, "lower", **advised))).findings == ()


def test_limits_alike_and_missing_meshes_only_limit_what_can_be_told(tmp_path: Path) -> None:
    chart = examine_description(_written(tmp_path, _limit(lower="0", upper="0"), _mesh))
    assert {one.kind: one.severity for one in chart.findings} == {
        "limits_equal": "limits",
        "missing_meshes": "limits",
    }
    assert chart.healthy


def test_links_without_a_shape_are_named_and_what_else_they_lack(tmp_path: Path) -> None:
    def drop(tag: str) -> Change:
        def change(root: ElementTree.Element) -> None:
            for link in root.iter("link"):
                for element in link.findall(tag):
                    link.remove(element)

        return change

    bare = examine_description(_written(tmp_path, drop("collision"), drop("visual")))
    assert {"upper", "lower"} <= {
        place for one in bare.findings if one.kind == "no_shape" for place in one.places
    }
    weightless = examine_description(_written(tmp_path, _mesh, drop("inertial")))
    assert {"missing_meshes", "inertial"} <= {one.kind for one in weightless.findings}


def test_all_faults_are_listed_not_only_the_first(tmp_path: Path) -> None:
    changes = (
        _set("mass", "upper", value="nan"),
        _set("origin", "lower", xyz="0 0 -0.15"),
        _limit(lower="2", upper="-2"),
    )
    kinds = {one.kind for one in examine_description(_written(tmp_path, *changes)).findings}
    assert kinds == {"bad_number", "com_outside", "limits_turned"}


def _humanoid(folder: Path, right: str) -> Path:
    """Two arms to the sides of a trunk, three links each; ``right`` is the inertial of the right second one."""
    links, joints = ['<link name="trunk"/>'], []
    for side, sign in (("left", 1), ("right", -1)):
        for number in range(3):
            inertial = f'<origin xyz="0.02 {sign * 0.03} -0.1"/><mass value="{2 + number}"/>'
            if side == "right" and number == 1:
                inertial = right
            links.append(
                f'<link name="{side}_{number}"><inertial>{inertial}<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02"'
                f' iyz="0" izz="0.00{4 + number}"/></inertial><collision><origin xyz="0 0 -0.1"/><geometry>'
                '<box size="0.1 0.1 0.3"/></geometry></collision></link>'
            )
            parent = "trunk" if number == 0 else f"{side}_{number - 1}"
            joints.append(
                f'<joint name="{side}_joint_{number}" type="revolute"><parent link="{parent}"/><child'
                f' link="{side}_{number}"/><origin xyz="0 {sign * 0.2 * (number == 0)} -0.3"/><axis xyz="0 1 0"/>'
                '<limit lower="-1" upper="1" effort="90" velocity="3"/></joint>'
            )
    file = folder / "humanoid.urdf"
    file.write_text(f'<robot name="humanoid">{"".join(links + joints)}</robot>')
    return file


@pytest.mark.parametrize(
    ("right", "severities"),
    [
        ('<origin xyz="0.02 -0.03 -0.1"/><mass value="3"/>', []),
        ('<origin xyz="0.02 -0.03 -0.1"/><mass value="3.2"/>', ["note"]),
        ('<origin xyz="0.02 0.03 -0.1"/><mass value="3"/>', ["note"]),
        ('<origin xyz="0.02 -0.03 -0.1"/><mass value="6"/>', ["spoils"]),
    ],
)
def test_left_and_right_are_mirror_images(right: str, severities: list[str], tmp_path: Path) -> None:
    found = examine_description(_humanoid(tmp_path, right)).findings
    assert [one.severity for one in found if one.kind == "asymmetry"] == severities
    for one in found:
        assert set(one.places) == {"left_1", "right_1"} and 'xyz="0.02 -0.03 -0.1"' in one.remedy


def test_copied_inertias_are_no_measurement(tmp_path: Path) -> None:
    file = _humanoid(tmp_path, '<origin xyz="0.02 -0.03 -0.1"/><mass value="3"/>')
    text = re.sub(
        r"<inertia [^/]*/>",
        '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/>',
        file.read_text(),
    )
    file.write_text(text)
    assert [(one.kind, one.severity, len(one.places)) for one in examine_description(file).findings] == [
        ("placeholder", "spoils", 6)
    ]


def test_two_links_of_different_shape_with_one_inertia_are_copies(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    inertial = (
        '<inertial><mass value="{}"/>'
        '<inertia ixx="0.011" ixy="1e-4" ixz="0" iyy="0.012" iyz="0" izz="0.003"/></inertial>'
    )
    links = "".join(
        f'<link name="{name}">{inertial.format(mass)}<collision><geometry><box size="0.06 0.06 {length}"/></geometry>'
        "</collision></link>"
        for name, mass, length in (("upper", 1.4, 0.3), ("fore", 1.4, 0.1))
    )
    joint = (
        '<joint name="{0}" type="revolute"><axis xyz="0 1 0"/><origin xyz="0 0 0.3"/><parent link="{1}"/>'
        '<child link="{2}"/><limit lower="-1" upper="1" effort="40" velocity="2"/></joint>'
    )
    joints = joint.format("shoulder", "base", "upper") + joint.format("elbow", "upper", "fore")
    file.write_text(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>')
    (found,) = (one for one in examine_description(file).findings if one.kind == "placeholder")
    assert found.places == ("upper", "fore")


def test_the_nearest_inertia_is_the_nearest(tmp_path: Path) -> None:
    """Against a general solver on the six numbers, whose constraints are those of principal moments."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix = axes @ np.diag([0.2, 0.5, rng.uniform(0.9, 2.0)]) @ axes.T
        six = matrix[np.triu_indices(3)]
        solved = minimize(
            lambda x, six=six: float(_WEIGHTS @ (x - six) ** 2),
            six,
            method="SLSQP",
            constraints={
                "type": "ineq",
                "fun": lambda x: (
                    np.ptp(np.linalg.eigvalsh(symmetric_matrix(x)) * [1, 1, 1]) * 0.0 + _margin(x)
                ),
            },
            options={"maxiter": 500, "ftol": 1e-14},
        )
        found = nearest_inertia(six)
        assert _margin(found) > 0.0
        assert _WEIGHTS @ (found - six) ** 2 == pytest.approx(solved.fun, rel=1e-3)


def _margin(six: np.ndarray) -> float:
    low, middle, high = np.linalg.eigvalsh(symmetric_matrix(six))
    return float(low + middle - high)


def test_an_even_body_of_a_hull_has_the_moments_of_a_box() -> None:
    sides, centre = np.array([0.1, 0.4, 0.2]), np.array([0.3, -0.2, 0.5])
    corners = (
        np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * sides + centre
    )
    solid = hull_of([corners, corners.mean(axis=0)[None]])
    assert solid is not None
    assert solid.volume == pytest.approx(sides.prod())
    assert solid.spread == pytest.approx(np.diag(sides**2 / 12.0), abs=1e-12)
    assert solid.nearest_point(centre + 10.0 * sides * [1, 1, 0]) == pytest.approx(
        centre + 0.5 * sides * [1, 1, 0]
    )


def test_inertias_of_a_mujoco_model_that_mujoco_refuses(tmp_path: Path) -> None:
    """MuJoCo stops at the first; what is written in the order of a URDF is told from what is a slip of the pen."""
    file = tmp_path / "arm.xml"
    text = replaced(MJCF, 'diaginertia="0.03 0.03 0.004"', 'diaginertia="0.03 0.02 0.004"')
    file.write_text(replaced(text, 'diaginertia="0.01 0.01 0.002"', 'fullinertia="0.01 0 0 0.01 0 0.002"'))
    chart = examine_description(file)
    assert {one.kind: one.places for one in chart.findings} == {
        "triangle": ("upper",),
        "not_positive": ("lower",),
        "refused": (),
    }
    (order,) = [one for one in chart.findings if one.kind == "not_positive"]
    assert "in URDF's order" in order.remedy and 'iyy="0.01"' in order.remedy


def test_a_mujoco_model_is_judged_as_a_urdf_is(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(MJCF)
    assert examine_description(file).findings == ()
    file.write_text(replaced(MJCF, 'pos="0 0 0.15" mass="1"', 'pos="0 0 -0.15" mass="1"'))
    assert [(one.kind, one.places) for one in examine_description(file).findings] == [
        ("com_outside", ("lower",))
    ]


def test_what_a_person_accepted_is_a_note_and_what_a_first_description_took_is_not(tmp_path: Path) -> None:
    file = _written(tmp_path, _FAULTS["triangle"][0])
    run = CliRunner().invoke(app, ["init-robot", str(file), "--json"])
    assert [one["kind"] for one in json.loads(run.output)["findings"]] == ["triangle"]
    robot = tmp_path / "robot.yaml"
    assert not examine_description(robot).healthy
    content = yaml.safe_load(robot.read_text())
    content["model"]["acknowledged"] = {"lower": "measured on a pendulum"}
    robot.write_text(yaml.safe_dump(content))
    assert [one.severity for one in examine_description(robot).findings] == ["note"]


def test_doctor_prints_and_writes_what_it_found(tmp_path: Path) -> None:
    file = _written(tmp_path, _FAULTS["sign of the centre"][0])
    run = CliRunner().invoke(app, ["doctor", str(file), "--json", "--out", str(tmp_path / "out")])
    document = json.loads(run.output)
    assert run.exit_code == 0 and document["schema"] == "excite.doctor/1" and not document["healthy"]
    assert json.loads((tmp_path / "out" / "doctor.json").read_text())["findings"] == document["findings"]
    said = CliRunner().invoke(app, ["doctor", str(file)]).output
    assert "lower: its centre of mass (0 0 -0.15) m lies 0.18 m outside its shape" in said
    assert CliRunner().invoke(app, ["report", str(tmp_path / "out")]).exit_code == 0


def test_check_says_the_worst_of_the_model(tmp_path: Path) -> None:
    file = _written(tmp_path, _FAULTS["sign of the centre"][0], _FAULTS["triangle"][0])
    (tmp_path / "rest.csv").write_text(
        "\n".join(["time,q.shoulder,q.elbow", *(f"{0.01 * i},0,0" for i in range(50))])
    )
    arguments = ["check", str(file), str(tmp_path / "rest.csv")]
    said = CliRunner().invoke(app, arguments).output.splitlines()
    assert "lower: " in said[0] and said[0].endswith("(and 1 more)")
    findings = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).output)["findings"]
    assert {one["kind"] for one in findings} == {"com_outside", "triangle"}


@pytest.mark.parametrize(
    ("case", "kind"),
    [("c09_density", "density"), ("c10_com_outside", "com_outside"), ("c11_triangle", "triangle")],
)
def test_faults_of_published_models(case: str, kind: str) -> None:
    if not SHARED.is_dir():
        pytest.skip("needs ../shared")
    (file,) = (SHARED / case).glob("*.urdf")
    (found,) = examine_description(file).findings
    assert (found.kind, found.places, found.severity) == (kind, ("l3",), "spoils")
