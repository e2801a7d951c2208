"""Bad robots: robot.yaml, URDF, MJCF, meshes and files of bounds."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.corpus.arm import MJCF, YAML, check_robot, init_robot, replaced
from tests.corpus.case import Case
from tests.robot.small import ARM, ELBOW_AXIS, ELBOW_LIMIT, chain

Build = Callable[[Path], list[str]]


def _yaml(content: str | bytes) -> Build:
    return lambda folder: check_robot(folder, content)


def _spoilt_yaml(old: str, new: str) -> Build:
    return _yaml(replaced(YAML, old, new))


def _urdf(content: str | bytes) -> Build:
    return lambda folder: init_robot(folder, content)


def _spoilt_urdf(old: str, new: str) -> Build:
    return _urdf(replaced(ARM, old, new))


def _mjcf(content: str | bytes) -> Build:
    return lambda folder: init_robot(folder, content, "arm.xml")


def _spoilt_mjcf(old: str, new: str, **files: str) -> Build:
    def build(folder: Path) -> list[str]:
        for name, content in files.items():
            (folder / f"{name}.xml").write_text(content, encoding="utf-8")
        return init_robot(folder, replaced(MJCF, old, new), "arm.xml")

    return build


def _place(name: str, make: Callable[[Path], object], arguments: Callable[[Path], list[str]]) -> Build:
    def build(folder: Path) -> list[str]:
        make(folder / name)
        return arguments(folder / name)

    return build


def _check(path: Path) -> list[str]:
    return ["check", str(path), "motion.csv"]


def _init(path: Path) -> list[str]:
    return ["init-robot", str(path)]


def _sparse(size: int) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with path.open("wb") as stream:
            stream.truncate(size)

    return make


def _to_find(name: str) -> str:
    return r"excite init-robot FILE --out DIR writes it" if name == "robot.yaml" else r"check the path"


def _places(family: str, name: str, read: Callable[[Path], list[str]]) -> Iterator[Case]:
    kinds: dict[str, tuple[Callable[[Path], object], str]] = {
        "missing": (lambda path: None, rf"no such file; {_to_find(name)}"),
        "folder": (
            lambda path: path.mkdir(),
            r"is a folder(, not a file; give a file| without a robot.yaml or a model; name the URDF)",
        ),
        "pipe": (os.mkfifo, r"is a pipe, not a file; give a file"),
        "device": (lambda path: path.symlink_to("/dev/zero"), r"is a device, not a file"),
        "loop of links": (lambda path: path.symlink_to(path.name), r"cannot be read .*; check"),
        "huge": (_sparse(1 << 40), r"has 1099511627776 bytes, more than the \d+ that are read; check"),
    }
    for kind, (make, line) in kinds.items():
        yield Case(family, kind, _place(name, make, read), rf"{name}.*: {line}")
    long = "x" * 300 + Path(name).suffix
    yield Case(family, "long name", lambda folder: read(folder / long), r"name too long.*; shorten it")
    yield Case(
        family,
        "NUL in name",
        lambda folder: read(folder / f"a\0{name}"),
        r"name that no file can have|null (byte|character)",
    )


_BOMB = "a0: &a0 [x]\n" + "".join(
    f"a{i}: &a{i} [" + ", ".join([f"*a{i - 1}"] * 10) + "]\n" for i in range(1, 12)
)
_YAML_TEXTS: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", r"is not a mapping; write one with excite init-robot"),
    "list": ("- a\n- b\n", r"is not a mapping"),
    "no YAML": ("a: [1, 2", r"is not valid YAML .*; mend the syntax"),
    "no UTF-8": (YAML.encode() + b"\xff\xfe", r"is no UTF-8 text .*; save it as UTF-8"),
    "zero bytes": (b"\0" * 100, r"is not valid YAML"),
    "deep": ("a: " + "[" * 500 + "]" * 500, r"nested more than 40 deep; flatten it"),
    "aliases of aliases": (_BOMB, r"stands for more than \d+ values; remove"),
    "contains itself": (YAML + "x: &x [*x]\n", r"contains itself"),
    "key twice": (YAML + "name: other\n", r"name: stands twice.*; keep one of them"),
    "python object": (YAML + "x: !!python/object/apply:os.system [true]\n", r"is not valid YAML"),
    "long number": (replaced(YAML, "500", "9" * 5000), r"holds a value that cannot be read|finite|valid"),
    "bad date": (YAML + "x: 2024-13-45\n", r"holds a value that cannot be read"),
    "unknown block": (YAML + "wheels: 4\n", r"wheels: .*not permitted.*; see"),
    "JSON": ('{"schema": "excite.robot/1"}', r"Field required"),
}
_YAML_NUMBERS: dict[str, tuple[str, str, str]] = {
    "NaN gravity": ("-9.81", ".nan", r"gravity\.2: is \.nan; give a number"),
    "infinite gravity": ("-9.81", "-.inf", r"gravity\.2: is not finite.*; give a number in m/s²"),
    "strong gravity": ("-9.81", "-981", r"gravity\.2: is more than any robot has.*write m/s²"),
    "text gravity": ("-9.81", "down", r"gravity\.2: .*valid number"),
    "gravity in two": ("[0.0, 0.0, -9.81]", "[0, -9.81]", r"gravity.*: Field required"),
    "NaN posture": ("elbow: 0.3", "elbow: .nan", r"posture\.joints\.elbow: is \.nan"),
    "posture in degrees": ("elbow: 0.3", "elbow: 17", r"posture\.joints\.elbow: is 17, outside"),
    "posture 1e300": ("elbow: 0.3", "elbow: 1.0e+300", r"elbow: is more than any robot has.*write radians"),
    "posture true": ("elbow: 0.3", "elbow: true", r"elbow: is true or false.*; give a number"),
    "wide digits": ("elbow: 0.3", "elbow: '０.３'", r"elbow: is no number.*digits 0 to 9"),
    "base height": (
        "source: test}\nlimits",
        "base_height: .inf, source: test}\nlimits",
        r"base_height: is not fin",
    ),
    "base in degrees": (
        "source: test}\nlimits",
        "base_rpy: [0, 90, 0], source: test}\nlimits",
        r"base_rpy\.1: .*; looks like degrees",
    ),
    "table": ("margin: 0.01", "margin: 0.01, table_height: 1.0e+300", r"table_height: is more.*write metres"),
    "negative margin": ("margin: 0.01", "margin: -0.01", r"collision\.margin: is negative.*from 0"),
    "empty range": (
        "margin: 0.03",
        "margin: 3",
        r"limits\.position: empty position range of joint 'shoulder'",
    ),
    "infinite gain": (
        "default: 100.0, source: test}\n  kd",
        "default: .inf, source: test}\n  kd",
        r"kp\.default: is n",
    ),
    "zero gain": (
        "{default: 5.0, source: test}\nsegments",
        "{default: 0, source: test}\nsegments",
        r"kd\.default: is 0",
    ),
    "huge rate": ("rate_hz: 500", "rate_hz: 1.0e+300", r"rate_hz: is more than any robot has"),
    "negative noise": ("1.0e-4", "-1.0e-4", r"noise_position: is negative"),
    "NaN noise": ("1.0e-4", ".NaN", r"noise_position: is \.NaN"),
    "limits in degrees": (
        "position: {joints: {}",
        "position: {joints: {elbow: [-120, 120]}",
        r"elbow: .*like degrees",
    ),
    "limits reversed": (
        "position: {joints: {}",
        "position: {joints: {elbow: [1, -1]}",
        r"empty position range",
    ),
    "limits 1e300": (
        "position: {joints: {}",
        "position: {joints: {elbow: [-1.0e+300, 1]}",
        r"is more than any",
    ),
    "limit alone": (
        "position: {joints: {}",
        "position: {joints: {elbow: 2}",
        r"limits\.position\.joints\.elbow: ",
    ),
    "acceleration": (
        "default: 5.0, source: test}\n  jerk",
        "default: 1.0e+99, source: test}\n  jerk",
        r"is more than",
    ),
    "locked in degrees": ("locked_joints: {}", "locked_joints: {elbow: 90}", r"elbow.*looks like degrees"),
    "locked NaN": ("locked_joints: {}", "locked_joints: {elbow: .nan}", r"locked_joints\.elbow: is \.nan"),
    "CoM box reversed": ("com_box: {}", "com_box: {lower: [[0, 0, 1], [1, 1, 0]]}", r"com_box of lower"),
    "CoM box infinite": (
        "com_box: {}",
        "com_box: {lower: [[0, 0, 0], [1, 1, .inf]]}",
        r"com_box\.lower.*not finite",
    ),
    "hull corners": ("margin: 0.01", "margin: 0.01, hull_corners: 1000000000", r"hull_corners: .*less than"),
}
_YAML_NAMES: dict[str, tuple[str, str, str]] = {
    "empty name": ("name: arm", "name: ''", r"name: .*at least 1 character"),
    "line break": ("name: arm", 'name: "a\\nb"', r"name: .*pattern"),
    "long name": ("name: arm", "name: " + "x" * 5000, r"name: .*at most 200"),
    "unknown joint": ("elbow: 0.3", "wrist: 0.3", r"posture\.joints: no joint 'wrist'.*the model has"),
    "unknown locked": ("locked_joints: {}", "locked_joints: {wrist: 0}", r"no joint 'wrist'"),
    "unknown link": ("names: {}", "names: {wrist: w}", r"segments\.names: no moving link 'wrist'"),
    "no source": ("{path: arm.urdf, source: test}", "{path: arm.urdf}", r"model\.source: Field required"),
    "source not said": (
        "{path: arm.urdf, source: test}",
        "{path: arm.urdf, source: null}",
        r"model\.source: is not f",
    ),
    "no model": ("path: arm.urdf", "path: none.urdf", r"none\.urdf: no such file; check the path"),
    "empty path": ("path: arm.urdf", "path: ''", r"model\.path: .*at least 1"),
    "path is a folder": ("path: arm.urdf", "path: .", r"is a folder, not a file"),
    "path is a device": ("path: arm.urdf", "path: /dev/zero", r"/dev/zero: is a device"),
    "NUL in path": ("path: arm.urdf", 'path: "a\\0.urdf"', r"model\.path: .*pattern"),
    "other schema": ("excite.robot/1", "excite.robot/2", r"schema: .*excite\.robot/1"),
    "no foot": (
        "base: fixed",
        "base: floating",
        r"feet: a floating base needs a foot to stand on; else",
    ),
    "no torque": (
        "joint_torque: link_side, ",
        "",
        r"joint_torque: a fixed base needs link_side or motor_side; see",
    ),
    "gain for nobody": (
        "kp: {default: 100.0, ",
        "kp: {",
        r"controller\.kp\.default: says nothing about joint",
    ),
    "no geometry": ("geometry: collision", "geometry: spheres", r"collision\.geometry: "),
}
_URDF_TEXTS: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", r"is not valid XML .*; mend the syntax"),
    "cut": (ARM[:700], r"is not valid XML"),
    "text": ("hello", r"is not valid XML"),
    "binary": (bytes(range(256)), r"is not valid XML"),
    "SDF": ("<sdf/>", r"holds 0 models.*; give a file with the robot's model alone"),
    "xacro": ("<html/>", r"is no URDF: its outermost element is <html>"),
    "entities": ('<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>', r"declares XML entities.*; remove"),
    "outside entity": (
        '<!DOCTYPE r [<!ENTITY a SYSTEM "/etc/passwd">]><robot name="&a;"/>',
        r"declares XML ent",
    ),
    "deep": (
        "<robot name='r'>" + "<a>" * 5000 + "</a>" * 5000 + "</robot>",
        r"nested more than 32 deep; reduce",
    ),
    "many attributes": (
        "<robot name='r' " + " ".join(f"a{i}=''" for i in range(500)) + "/>",
        r"has 501 attributes",
    ),
    "many elements": ("<robot name='r'>" + "<a/>" * 300_000 + "</robot>", r"has more than 200000 elements"),
    "long chain": (chain(300).replace("revolute", "fixed"), r"joints from the root, more than 200; shorten"),
    "many joints": (
        "<robot name='r'><link name='l'/>"
        + "".join(
            f"<link name='l{i}'/><joint name='j{i}' type='revolute'><parent link='l'/><child link='l{i}'/></joint>"
            for i in range(500)
        )
        + "</robot>",
        r"has 500 joints that move, more than 200; reduce the model",
    ),
    "many solids": (
        replaced(ARM, '<link name="tool"/>', f'<link name="tool">{"<visual/>" * 999}</link>'),
        r"999 visual",
    ),
    "attribute twice": (
        replaced(ARM, 'mass value="2.0"', 'mass value="2.0" value="3.0"'),
        r"duplicate attribute",
    ),
    "unknown encoding": ("<?xml version='1.0' encoding='klingon'?><robot name='r'/>", r"is not valid XML"),
}
_LOWER_MASS = '<mass value="1.0"/>'
_URDF_NUMBERS: dict[str, tuple[str, str, str]] = {
    "NaN mass": (_LOWER_MASS, '<mass value="nan"/>', r"mass@value: is 'nan'; give one number"),
    "infinite mass": (_LOWER_MASS, '<mass value="inf"/>', r"mass@value: is 'inf'"),
    "mass 1e300": (
        _LOWER_MASS,
        '<mass value="1e300"/>',
        r"mass@value: is '1e300', more than any.*write kilograms",
    ),
    "mass 1e999": (_LOWER_MASS, '<mass value="1e999"/>', r"too large for a number; give one number"),
    "negative mass": (_LOWER_MASS, '<mass value="-1"/>', r"is -1\.0; give a positive mass in kilograms"),
    "decimal comma": (_LOWER_MASS, '<mass value="1,5"/>', r"is '1,5'; .*decimal point"),
    "wide digits": (_LOWER_MASS, '<mass value="１"/>', r"mass@value: is '１'; give one number"),
    "empty mass": (_LOWER_MASS, '<mass value=""/>', r"mass@value: is ''"),
    "no mass value": (_LOWER_MASS, "<mass/>", r"mass@value: is missing; give one number"),
    "NaN origin": (
        'xyz="0 0 0.15" rpy="0 0 0"/>\n      <mass',
        'xyz="0 nan 0.15"/>\n      <mass',
        r"origin@xyz: is '0 nan.*; give 3 numbers",
    ),
    "far origin": (
        'xyz="0 0 0.15" rpy="0 0 0"/>\n      <mass',
        'xyz="0 0 1e300"/>\n      <mass',
        r"write metres",
    ),
    "hard space": (
        'xyz="0 0 0.15" rpy="0 0 0"/>\n      <mass',
        'xyz="0 0\u00a00.15"/>\n      <mass',
        r"origin@xyz",
    ),
    "inertia 1e300": ('ixx="0.01"', 'ixx="1e300"', r"inertia@ixx: is '1e300'.*write kg·m²"),
    "zero axis": (
        ELBOW_AXIS,
        ELBOW_AXIS.replace("0 1 0", "0 0 0"),
        r"joint 'elbow'/axis: is '0 0 0', which is no direction; give a vector of length 1",
    ),
    "NaN axis": (
        ELBOW_AXIS,
        ELBOW_AXIS.replace("0 1 0", "0 nan 0"),
        r"axis@xyz: is '0 nan 0'; give 3 numbers",
    ),
    "effort 1e300": (ELBOW_LIMIT, ELBOW_LIMIT.replace('"20"', '"1e300"'), r"effort: is '1e300'"),
    "negative velocity": (
        ELBOW_LIMIT,
        ELBOW_LIMIT.replace('"3.0"', '"-3"'),
        r"velocity: is -3\.0; give a positive",
    ),
    "limits reversed": (
        ELBOW_LIMIT,
        ELBOW_LIMIT.replace('"-2.0"', '"3.0"'),
        r"joint 'elbow'/limit: lower 3\.0 is above upper 2\.0; exchange them",
    ),
    "limit 1e300": (
        ELBOW_LIMIT,
        ELBOW_LIMIT.replace('"2.0"', '"1e300"'),
        r"upper: is '1e300', more than any",
    ),
    "box of nothing": (
        'size="0.06 0.06 0.25"',
        'size="0 0.06 0.25"',
        r"size: is '0 0\.06 0\.25'; give lengths",
    ),
    "box of 1e300": ('size="0.06 0.06 0.25"', 'size="1e300 0.06 0.25"', r"size: .*write metres"),
}
_URDF_STRUCTURE: dict[str, tuple[str, str, str]] = {
    "two masses": (_LOWER_MASS, _LOWER_MASS + '<mass value="9"/>', r"inertial/mass: occurs twice; keep one"),
    "two axes": (ELBOW_AXIS, ELBOW_AXIS + '<axis xyz="1 0 0"/>', r"joint 'elbow'/axis: occurs twice"),
    "two limits": (ELBOW_LIMIT, ELBOW_LIMIT + '<limit effort="9"/>', r"joint 'elbow'/limit: occurs twice"),
    "two origins": (ELBOW_AXIS, '<origin xyz="1 0 0"/>' + ELBOW_AXIS, r"joint 'elbow'/origin: occurs twice"),
    "two parents": (
        '<parent link="upper"/>',
        '<parent link="upper"/><parent link="world"/>',
        r"parent: occurs twice",
    ),
    "two children": (
        '<child link="lower"/>',
        '<child link="lower"/><child link="tool"/>',
        r"child: occurs twice",
    ),
    "two inertias": ('<inertia ixx="0.01"', '<inertia/><inertia ixx="0.01"', r"inertia: occurs twice"),
    "two inertials": (
        '<link name="tool"/>',
        '<link name="tool"><inertial/><inertial><mass value="1"/></inertial></link>',
        r"inertial: occurs twice; keep one",
    ),
    "two solids": (
        '<box size="0.06 0.06 0.25"/>',
        '<box size="1 1 1"/><sphere radius="1"/>',
        r"holds 2 solids; give each",
    ),
    "link in a link": (
        '<link name="tool"/>',
        '<link name="tool"><link name="in"/></link>',
        r"holds the link 'in'; put",
    ),
    "no name": ('<robot name="small">', '<robot name="">', r"robot: has the name ''; give it a name"),
    "nameless link": ('<link name="tool"/>', '<link name=" "/>', r"has the name ' '; give it a name"),
    "long name": ('<link name="tool"/>', '<link name="' + "x" * 300 + '"/>', r"at most 200 printable"),
    "link twice": ('<link name="tool"/>', '<link name="lower"/>', r"link 'lower': occurs twice; rename"),
    "two roots": (
        '<link name="tool"/>',
        '<link name="tool"/><link name="loose"/>',
        r"has 2 root links: .*join",
    ),
    "loop": ('<parent link="world"/>', '<parent link="lower"/>', r"its own ancestor|root"),
    "lost link": ('<child link="lower"/>', '<child link="gone"/>', r"unknown link 'gone'; define"),
    "joint of no kind": (
        'name="elbow" type="revolute"',
        'name="elbow" type="ball"',
        r"has the type 'ball'; use one of",
    ),
    "floating joint": (
        'name="elbow" type="revolute"',
        'name="elbow" type="floating"',
        r"joint 'elbow': is floating; only joints.*base: floating",
    ),
    "mesh of no name": (
        '<box size="0.06 0.06 0.25"/>',
        '<mesh filename=""/>',
        r"mesh@filename: is missing; name",
    ),
}
_UNITS: dict[str, tuple[str, str, str]] = {
    "limits in degrees": (
        ELBOW_LIMIT,
        ELBOW_LIMIT.replace("2.0", "115", 2),
        r"looks like degrees: write radians",
    ),
    "origin in degrees": (
        ELBOW_AXIS,
        ELBOW_AXIS.replace('rpy="0 0 0"', 'rpy="0 90 0"'),
        r"looks like degrees",
    ),
    "slide in millimetres": (
        'name="elbow" type="revolute"',
        'name="elbow" type="prismatic"',
        r"looks like millimetres: write metres",
    ),
}
_MJCF_TEXTS: dict[str, tuple[str, str]] = {
    "no body": (
        "<mujoco/>",
        r"holds no <body>: it is a part of a MuJoCo model.*; give the file that includes it",
    ),
    "cut": (MJCF[:300], r"is not valid XML"),
    "entities": ('<!DOCTYPE r [<!ENTITY a "b">]><mujoco model="&a;"/>', r"declares XML entities"),
    "deep": (
        "<mujoco><worldbody>" + "<body>" * 150 + "</body>" * 150 + "</worldbody></mujoco>",
        r"nested more than",
    ),
    "unknown element": (MJCF.replace("<compiler", "<wheel/><compiler"), r"MuJoCo cannot compile it .*; mend"),
    "ball joint": (MJCF.replace('name="elbow"', 'name="elbow" type="ball"'), r"arm\.xml"),
    "link without mass": (
        MJCF.replace('mass="1" diaginertia="0.01 0.01 0.002"', 'mass="0" diaginertia="0 0 0"'),
        r"mass",
    ),
}
_MJCF_NUMBERS: dict[str, tuple[str, str, str]] = {
    "NaN mass": ('mass="1"', 'mass="nan"', r"inertial@mass: is 'nan'; give finite numbers"),
    "infinite mass": ('mass="1"', 'mass="inf"', r"inertial@mass: is 'inf'"),
    "mass 1e300": (
        'mass="1"',
        'mass="1e300"',
        r"'lower'/inertial/mass@value: is '1e\+300', more than any.*write kilograms",
    ),
    "negative mass": (
        'mass="1"',
        'mass="-1"',
        r"MuJoCo cannot compile it .*mass and inertia.*'lower'.*; mend it there",
    ),
    "wide digits": (
        'mass="1"',
        'mass="１"',
        r"MuJoCo cannot compile it .*attribute 'mass' Element 'inertial', line 10.*; mend it there",
    ),
    "NaN inertia": ("0.01 0.01 0.002", "0.01 nan 0.002", r"inertial@diaginertia: is '0\.01 nan 0\.002'"),
    "inertia 1e300": (
        "0.01 0.01 0.002",
        "0.01 1e300 0.002",
        r"cannot compile it .*inertia must satisfy.*'lower'",
    ),
    "NaN range": ('range="-2 2"', 'range="-2 nan"', r"joint 'elbow'@range: is '-2 nan'"),
    "far body": (
        'pos="0 0 0.4"',
        'pos="0 0 1e300"',
        r"joint 'elbow'/origin@xyz: is .*, more than any robot has",
    ),
    "mass of settotal": (
        "<compiler",
        '<compiler settotalmass="1e30"',
        r"mass@value: is .*, more than any robot has.*; write kilograms",
    ),
}
_BODY = '<body name="lower" pos="0 0 0.4">'
_END = "</worldbody>"
_MJCF_SIZE: dict[str, tuple[str, str, str]] = {
    "replicate": (
        _BODY,
        '<replicate count="100000000"><body/></replicate>' + _BODY,
        r"replicate@count: stands for more",
    ),
    "nested replicates": (
        _END,
        '<replicate count="1000">' * 3 + "<body/>" + "</replicate>" * 3 + _END,
        r"replicate@count: stands for more than 100000 elements; repeat less",
    ),
    "replicate of digits": (
        _END,
        f'<replicate count="{"9" * 400}"><body/></replicate>{_END}',
        r"replicate@count",
    ),
    "replicate of words": (_END, f'<replicate count="many"><body/></replicate>{_END}', r"give whole numbers"),
    "composite": (
        _END,
        f'<body><composite type="cable" count="9999999 1 1"/></body>{_END}',
        r"composite@count",
    ),
    "flexcomp": (
        _END,
        f'<body><flexcomp name="f" type="grid" count="900 900 900"/></body>{_END}',
        r"flexcomp 'f'@count: stands for more",
    ),
    "memory": (
        "<compiler",
        '<size memory="900G"/><compiler',
        r"cannot compile it .*allocate memory",
    ),
    "reserve": (
        "<compiler",
        '<size nuser_body="2000000000"/><compiler',
        r"MuJoCo cannot compile it .*; mend it there",
    ),
    "height field": (
        "<compiler",
        '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset><compiler',
        r"hfield 'h'@nrow: is more than 9999; reduce its size",
    ),
    "texture": (
        "<compiler",
        '<asset><texture name="t" type="2d" builtin="flat" width="90000" height="90000"/></asset><compiler',
        r"texture 't'@width: .*; reduce its size",
    ),
}


def _including(named: str, **files: str) -> Build:
    return _spoilt_mjcf("<compiler", f'<include file="{named}"/><compiler', **files)


def _include_place(make: Callable[[Path], object]) -> Build:
    def build(folder: Path) -> list[str]:
        make(folder / "part.xml")
        return _including("part.xml")(folder)

    return build


_INCLUDES: dict[str, tuple[Build, str]] = {
    "itself": (_including("arm.xml"), r"includes itself through 'arm\.xml'; remove it"),
    "in a circle": (
        _including(
            "a.xml",
            a='<mujocoinclude><include file="b.xml"/></mujocoinclude>',
            b='<mujocoinclude><include file="a.xml"/></mujocoinclude>',
        ),
        r"MuJoCo cannot compile it .*'a\.xml' already included.*; mend it there",
    ),
    "missing": (_including("none.xml"), r"none\.xml: no such file; check the path"),
    "nameless": (_including(""), r"include@file: is missing; name it"),
    "no XML": (_including("a.xml", a="<cut"), r"a\.xml: is not valid XML"),
    "pipe": (_include_place(os.mkfifo), r"part\.xml: is a pipe, not a file"),
    "folder": (_include_place(lambda path: path.mkdir()), r"part\.xml: is a folder"),
    "huge": (_include_place(_sparse(1 << 40)), r"part\.xml: has 1099511627776 bytes"),
    "device": (_including("/dev/zero"), r"/dev/zero: is a device"),
    "NaN inside": (
        _including("a.xml", a='<mujocoinclude><option gravity="0 0 nan"/></mujocoinclude>'),
        r"a\.xml: option@gravity: is '0 0 nan'",
    ),
    "attaches itself": (
        _spoilt_mjcf("<compiler", '<asset><model name="m" file="arm.xml"/></asset><compiler'),
        r"includes itself through 'arm\.xml'",
    ),
}


def _stl(n_triangles: int, corners: tuple[float, ...] = (0, 0, 0, 1, 0, 0, 0, 1, 0)) -> bytes:
    return b"\0" * 80 + struct.pack("<I", n_triangles) + struct.pack("<12fH", 0, 0, 1, *corners, 0) * 2


def _with_mesh(name: str, make: Callable[[Path], object]) -> Build:
    """The arm in MuJoCo with a mesh that its inertia does not depend on."""

    def build(folder: Path) -> list[str]:
        make(folder / name)
        asset = f'<asset><mesh name="m" file="{name}"/></asset><compiler'
        text = replaced(MJCF, "<compiler", asset)
        return init_robot(
            folder, replaced(text, "</worldbody>", '<geom type="mesh" mesh="m"/></worldbody>'), "arm.xml"
        )

    return build


def _bytes(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


_MESHES: dict[str, tuple[Build, str]] = {
    "pipe": (_with_mesh("m.stl", os.mkfifo), r"m\.stl: is a pipe"),
    "folder": (_with_mesh("m.stl", lambda path: path.mkdir()), r"m\.stl: is a folder"),
    "huge": (_with_mesh("m.stl", _sparse(1 << 40)), r"m\.stl: has 1099511627776 bytes"),
    "device": (_with_mesh("m.stl", lambda path: path.symlink_to("/dev/zero")), r"m\.stl: is a device"),
    "cut": (_with_mesh("m.stl", _bytes(_stl(9))), r"arm\.xml: .*; "),
    "empty": (_with_mesh("m.obj", _bytes(b"")), r"arm\.xml: .*; "),
    "NaN corner": (_with_mesh("m.stl", _bytes(_stl(2, (float("nan"),) * 9))), r"arm\.xml: .*; "),
}


def _bounds(content: str) -> Build:
    def build(folder: Path) -> list[str]:
        robot = check_robot(folder)[1]
        (folder / "bounds.yaml").write_text(content, encoding="utf-8")
        return ["identify", robot, "log", "--method", "physical", "--bounds", str(folder / "bounds.yaml")]

    return build


def _bounded_by(path: Path) -> list[str]:
    return ["identify", "ur10", "log", "--method", "physical", "--bounds", str(path)]


_SCHEMA = "schema: excite.physical_bounds/1\n"
_BOUNDS: dict[str, tuple[str, str]] = {
    "other schema": ("schema: x\n", r"schema: should be 'excite\.physical_bounds/1', got 'x'"),
    "nothing": (_SCHEMA, r"bounds nothing; give links"),
    "unknown field": (_SCHEMA + "link: {}\n", r"link: extra inputs are not permitted.*write links:"),
    "unknown link": (_SCHEMA + "links: {wrist: {m: [1, 2]}}\n", r"links\.wrist\.m: is of no link"),
    "NaN": (_SCHEMA + "links: {lower: {m: [.nan, 2]}}\n", r"links\.lower\.m\.0: is \.nan"),
    "infinite": (
        _SCHEMA + "links: {lower: {m: [0, .inf]}}\n",
        r"links\.lower\.m\.1: should be less than.*got inf.*numbers up to",
    ),
    "1e300": (
        _SCHEMA + "links: {lower: {m: [0, 1.0e+300]}}\n",
        r"links\.lower\.m\.1: should be less than.*got 1e\+300",
    ),
    "reversed": (
        _SCHEMA + "links: {lower: {m: [2, 1]}}\n",
        r"links\.lower\.m: has bounds \[2, 1\] with nothing between: put the lower one",
    ),
    "wide digits": (
        _SCHEMA + "links: {lower: {m: ['１', 2]}}\n",
        r"links\.lower\.m\.0: should be a valid number",
    ),
    "twice": (_SCHEMA + "total_mass: [1, 2]\ntotal_mass: [1, 3]\n", r"total_mass: stands twice"),
    "aliases": (_SCHEMA + _BOMB, r"stands for more than"),
}


_ARGUMENTS: dict[str, tuple[str, str]] = {
    "unknown robot": ("g7", r"unknown robot 'g7'; choose one of g1"),
    "no robot": ("", r"unknown robot ''; choose one of"),
    "long name": ("x" * 5000, r"unknown robot 'x+"),
    "NUL in name": ("a\0b", r"unknown robot"),
    "URDF": ("arm.urdf", r"arm\.urdf: no such file; check the path"),
}


_SILENT: dict[str, tuple[str, str, str]] = {
    # What the parser behind pinocchio prints line by line must not reach the screen beside ours.
    "damping is no number": (
        ELBOW_LIMIT,
        ELBOW_LIMIT + '<dynamics damping="nan"/>',
        r"joint 'elbow'/dynamics@damping: is 'nan'; give one number",
    ),
    "friction with a comma": (
        ELBOW_LIMIT,
        ELBOW_LIMIT + '<dynamics friction="1,5"/>',
        r"joint 'elbow'/dynamics@friction: is '1,5'",
    ),
    "dynamics twice": (
        ELBOW_LIMIT,
        ELBOW_LIMIT + '<dynamics damping="1"/><dynamics damping="2"/>',
        r"joint 'elbow'/dynamics: occurs twice; keep one",
    ),
    "axis twice": (
        ELBOW_AXIS,
        ELBOW_AXIS + '<axis xyz="1 0 0"/>',
        r"joint 'elbow'/axis: occurs twice; keep one",
    ),
}
_MIXED_UNITS: dict[str, tuple[str, str, str]] = {
    "moments in kg·mm²": (
        'ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002"',
        'ixx="10000" ixy="0" ixz="0" iyy="10000" iyz="0" izz="2000"',
        r"link 'lower'/inertial/inertia: spreads 1 kg over a radius of 100 m; write moments in kg·m²",
    ),
    "offset in millimetres": (
        'xyz="0 0 0.4"',
        'xyz="0 0 400"',
        r"joint 'elbow'/origin@xyz: is '0 0 400', more than any.*like millimetres: write metres",
    ),
}


def _cases() -> Iterator[Case]:
    for name, (robot, line) in _ARGUMENTS.items():
        yield Case("name of a robot", name, lambda folder, robot=robot: ["check", robot, "motion.csv"], line)  # type: ignore[misc]
    yield from _places("robot.yaml as a file", "robot.yaml", _check)
    yield from _places("URDF as a file", "arm.urdf", _init)
    yield from _places("MJCF as a file", "arm.xml", _init)
    yield from _places("bounds as a file", "bounds.yaml", _bounded_by)
    for family, texts, of_text in (
        ("robot.yaml text", _YAML_TEXTS, _yaml),
        ("URDF text", _URDF_TEXTS, _urdf),
        ("MJCF text", _MJCF_TEXTS, _mjcf),
        ("bounds", _BOUNDS, _bounds),
    ):
        for name, (content, line) in texts.items():
            yield Case(family, name, of_text(content), line)
    for family, passages, spoilt in (
        ("robot.yaml numbers", _YAML_NUMBERS, _spoilt_yaml),
        ("robot.yaml names", _YAML_NAMES, _spoilt_yaml),
        ("URDF numbers", _URDF_NUMBERS, _spoilt_urdf),
        ("URDF structure", _URDF_STRUCTURE, _spoilt_urdf),
        ("URDF that parsers comment", _SILENT, _spoilt_urdf),
        ("units", _MIXED_UNITS, _spoilt_urdf),
        ("MJCF numbers", _MJCF_NUMBERS, _spoilt_mjcf),
        ("MJCF size", _MJCF_SIZE, _spoilt_mjcf),
    ):
        for name, (old, new, line) in passages.items():
            yield Case(family, name, spoilt(old, new), line)
    slide = replaced(ARM, ELBOW_LIMIT, ELBOW_LIMIT.replace("2.0", "350"))
    for name, (old, new, line) in _UNITS.items():
        yield Case("units", name, _urdf(replaced(slide if "slide" in name else ARM, old, new)), line)
    grams = ARM.replace('value="2.0"', 'value="2000"').replace('value="1.0"', 'value="1000"')
    yield Case(
        "units", "masses in grams", _urdf(grams), r"mass@value: .*; looks like grams: write masses in kg"
    )
    for family, builds in (("MJCF includes", _INCLUDES), ("meshes", _MESHES)):
        for name, (build, line) in builds.items():
            yield Case(family, name, build, line)


CASES = tuple(_cases())
