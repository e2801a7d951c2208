"""The files of a first description: ``robot.yaml``, and the URDF of a model that is no plain URDF, with its meshes."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import numpy as np
import pinocchio as pin
import yaml

from excite.arrays import Array
from excite.atomic import all_or_nothing, write_text
from excite.errors import InputError, RobotError, in_one_line, raised_as
from excite.formats.child import in_child
from excite.formats.documents import read_xml
from excite.formats.file import first_bytes
from excite.results import Assumed
from excite.robot.catalogue import MODEL_SUFFIXES
from excite.robot.description import PositionTable
from excite.robot.init_robot.description import scaffold_description
from excite.robot.init_robot.first_guesses import Held, held_still
from excite.robot.init_robot.model_metadata import states_mass, weigh_links
from excite.robot.init_robot.packages import model_of_package, package_folder, read_srdf
from excite.robot.init_robot.source import Source
from excite.robot.init_robot.usd import USD_SUFFIXES, convert_usd
from excite.robot.mjcf.conversion import convert_mjcf, is_mjcf
from excite.robot.refusal import robot_error
from excite.robot.urdf.converted import ConvertedModel
from excite.robot.urdf.inertia import GEOMETRY, LENGTHS
from excite.robot.urdf.limits import (
    assumed_limits,
    joint_limits_beside,
    keep_stated_limits,
    read_limits_file,
    tighten_limits,
    with_tables,
)
from excite.robot.urdf.numbers import read_numbers
from excite.robot.urdf.reading import MAX_NESTING, find_mesh
from excite.robot.urdf.tree import MOVING, root_joint
from excite.robot.urdf.writing import MOMENTS, add_element, add_inertial, add_joint, add_solid
from excite.temporary_folder import TemporaryFolder


@dataclass(frozen=True)
class ScaffoldFiles:
    """What was written.

    Attributes:
        description: the ``robot.yaml``.
        urdf: the URDF that it names.
        assumed: what no file said.
        notes: what a MuJoCo model says and the URDF made from it does not; empty for a URDF.
    """

    description: Path
    urdf: Path
    assumed: tuple[Assumed, ...]
    notes: tuple[str, ...]


def write_scaffold(
    file: Path,
    folder: Path,
    *,
    seed: int = 0,
    overwrite: bool = False,
    source: Source | None = None,
    absolute: bool = False,
) -> ScaffoldFiles:
    """Write a complete ``robot.yaml`` for a URDF, a xacro file or a MuJoCo model.

    Args:
        file: the model, or a package of MoveIt or ROS that holds it.
        folder: where to write; of what is no plain URDF also the URDF, named as the model's file, and its meshes.
        seed: seed of the random postures behind inertia, rest and collision pairs.
        overwrite: whether files of these names may be replaced.
        source: how the file is to be read.
        absolute: whether a plain URDF is named by its whole path, so that the description is the same wherever it lies.

    Returns:
        The files that were written, and what was assumed.

    Raises:
        InputError: a file is there already.
        RobotError: the model is missing or absurd in a way that no description can mend.
    """
    source, target = source or Source(), folder / "robot.yaml"
    if os.path.isdir(file):
        file, source = model_of_package(file, source)
    _check_absent(target, overwrite)
    ignored = () if source.srdf is None else read_srdf(source.srdf)
    made = _apply_limits(_make_urdf(file, source), file, source)
    made = replace(made, ignored=(*made.ignored, *ignored))
    if made.urdf is None:
        here = None if absolute else folder
        text = scaffold_description(file, here, seed=seed, said=made, absolute=absolute)
        return ScaffoldFiles(write_text(target, text), file, _read_assumed(text), ())
    name = file.name
    while Path(name).suffix in MODEL_SUFFIXES:
        name = Path(name).stem
    urdf = folder / f"{name}.urdf"
    if urdf.resolve() == file.resolve():
        urdf = urdf.with_name(f"{urdf.stem}_expanded.urdf")
    _check_absent(urdf, overwrite)
    # Described from a copy that goes away again, so that nothing is written where that fails.
    place = TemporaryFolder()
    try:
        copy = made.write(place.path / urdf.name)
        text = scaffold_description(copy, place.path, seed=seed, said=made)
    except RobotError as error:
        # The person knows the model, not the copy of its URDF.
        raise robot_error(file, error.field, error.what, error.remedy) from error
    with all_or_nothing():
        made.write(urdf)
        write_text(target, text)
    return ScaffoldFiles(target, urdf, _read_assumed(text), made.notes)


@raised_as(RobotError)
def _make_urdf(file: Path, source: Source) -> ConvertedModel:
    """The URDF that is made of a MuJoCo model, an SDF or xacro file, or of a URDF that leaves masses out."""
    found = convert_model(file)
    if found is not None:
        return found
    plain, text = not is_xacro(file) and not source.package_path, None
    root = read_xml(file, max_depth=MAX_NESTING) if plain else None
    if root is None or (root.tag == "robot" and not states_mass(root)):
        text = expand_xacro(file, source.arguments, source.package_path)
        root = fromstring(text)
    planar = root_joint(root, "planar")
    weighed, widths = (None, {}) if text is None else weigh_links(root, file)
    # A base that slides and turns on a plane is held still.
    held = {str(planar.joint.get("name")): Held(0.0, "what its wheels or legs do")} if planar else {}
    assumed = (*([weighed] if weighed else []), *held_still(held))
    if weighed is not None:
        text = tostring(root, encoding="unicode")
    elif plain:
        text = None
    floating = True if root_joint(root, "floating") else None
    return ConvertedModel(urdf=text, floating=floating, assumed=assumed, uncertainty=widths)


def convert_model(file: Path) -> ConvertedModel | None:
    """A model of MuJoCo, SDF or USD as a URDF; None of any other file.

    Raises:
        RobotError: it holds what no URDF can say, or cannot be read.
        InputError: its reader is not installed.
    """
    if file.suffix in USD_SUFFIXES:
        return convert_usd(file)
    if is_mjcf(file):
        return convert_mjcf(file)
    try:
        root = read_xml(file, max_depth=MAX_NESTING)
    except InputError:
        # Whoever reads it next says why.
        return None
    return ConvertedModel(urdf=convert_sdf(root, file)) if root.tag == "sdf" else None


def _apply_limits(made: ConvertedModel, file: Path, source: Source) -> ConvertedModel:
    """The URDF with the joint limits of a file of MoveIt's kind, stated or found beside the model, that are tighter."""
    files = joint_limits_beside(file) if source.limits is None else [source.limits]
    if not files:
        return made
    root = fromstring(made.urdf or expand_xacro(file, source.arguments, source.package_path))
    keep_stated_limits(root, file)
    names = [joint.get("name", "") for joint in root.findall("joint")]
    tightened, tables = dict[str, dict[str, list[str]]](), list[PositionTable]()
    for one in files:
        found = read_limits_file(one, names, given=source.limits is not None)
        named = "/".join(one.parts[-3:] if source.limits is None else one.parts[-1:])
        tightened[named] = with_tables(tighten_limits(root, found.limits, file, one.name), found)
        tables += found.tables
    if not any(tightened.values()):
        return made
    assumed, text = (
        (*made.assumed, *assumed_limits(tightened)),
        tostring(root, encoding="unicode"),
    )
    return replace(made, urdf=text, assumed=assumed, by_position=tuple(tables))


def _check_absent(path: Path, overwrite: bool) -> None:
    if os.path.exists(path) and not overwrite:
        raise InputError("exists already", source=path, remedy="give --force to overwrite it, or --out DIR")


def _read_assumed(text: str) -> tuple[Assumed, ...]:
    return tuple(Assumed(**one) for one in yaml.safe_load(text)["assumed"])


# Xacro files expanded to URDF, with mesh files found.

_NAMESPACE = "ros.org/wiki/xacro"
# A model of 2 000 links from a macro each takes 5 s and 0.13 GB on a busy core.
_SECONDS = 30.0
# Named arguments and macros.
_NAMED = 8
_UNKNOWN_ARGUMENT = re.compile(r"Undefined substitution argument (\w+)")


def is_xacro(path: Path) -> bool:
    """Whether a file is to be expanded before it is a URDF."""
    return path.suffix == ".xacro" or _NAMESPACE.encode() in first_bytes(path, 4096)


@raised_as(RobotError)
def expand_xacro(path: Path, arguments: Mapping[str, str], package_path: tuple[Path, ...] = ()) -> str:
    """URDF text of a URDF or xacro file, its mesh paths absolute where the files are found.

    Args:
        arguments: of the xacro file, by name.
        package_path: folders in which packages lie.

    Raises:
        RobotError: the file is missing, or xacro cannot expand it, or not within half a minute, or to no link.
    """
    root = _without_xacro(path) if is_xacro(path) else read_xml(path)
    try:
        root = _expanded_root(path, arguments, package_path) if is_xacro(path) else root
    except RobotError:
        # What every reader of URDF makes of a file with leftovers: elements of xacro mean nothing to them.
        if root is None:
            raise
    for mesh in () if root is None else root.iter("mesh"):
        name = mesh.get("filename", "")
        found = find_mesh(name, path) or _in_packages(name, package_path)
        if found is not None:
            mesh.set("filename", str(found))
    return "" if root is None else tostring(root, encoding="unicode")


def _expanded_root(path: Path, arguments: Mapping[str, str], package_path: tuple[Path, ...]) -> Element:
    # In a process of its own: xacro evaluates what a file says as Python, which need not end.
    text = in_child(
        f"{__name__}:_expand_xacro",
        path,
        dict(arguments),
        package_path,
        source=path,
        seconds=_SECONDS,
        memory_gb=4.0,
        endless=(
            "is not expanded after {seconds:g} s: an expression or macro in it does not end",
            "find the ${…} that takes so long, or expand it with xacro and give the URDF",
        ),
    )
    root = fromstring(text)
    if root.find("link") is None:
        macros = [str(one.get("name")) for one in _xacro_elements(path, "macro")]
        if not macros:
            remedy = "give the file that describes the robot"
            raise robot_error(path, None, "expands to no <link>", remedy)
        what = f"only defines macros ({', '.join(macros[:_NAMED])})"
        remedy = f"give the file that includes it and calls {'it' if len(macros) == 1 else 'one'}"
        raise robot_error(path, None, what, remedy)
    return root


def _xacro_elements(path: Path, kind: str) -> list[Element]:
    return [one for one in read_xml(path).iter() if one.tag.endswith(f"/xacro}}{kind}")]


def _without_xacro(path: Path) -> Element | None:
    """A file called a URDF without elements of xacro that were left over in it; None where it needs xacro.

    It does where nothing moves without them, or a value is to be evaluated.
    """
    root = read_xml(path)
    if path.suffix == ".xacro":
        return None
    for element in list(root.iter()):
        for child in [one for one in element if _NAMESPACE in one.tag]:
            element.remove(child)
    evaluated = any(
        sign in value for one in root.iter() for value in one.attrib.values() for sign in ("${", "$(")
    )
    moves = any(joint.get("type") in MOVING for joint in root.findall("joint"))
    return root if moves and not evaluated else None


def _in_packages(name: str, package_path: tuple[Path, ...]) -> Path | None:
    package, _, inside = name.removeprefix("package://").lstrip("/").partition("/")
    if package and name.startswith("package://") and "\0" not in name:
        for given in package_path:
            folder = package_folder(package, (given,))
            if folder is not None and (folder / inside).is_file():
                return (folder / inside).resolve()
    return None


def _expand_xacro(path: Path, arguments: Mapping[str, str], package_path: tuple[Path, ...]) -> str:
    import xacro
    from xacro import substitution_args

    def find_package(package: str) -> str:
        place = package_folder(package, package_path, path.resolve().parents)
        if place is None:
            remedy = "give --package-path FOLDER, in which it or its clone lies"
            raise robot_error(path, "$(find)", f"needs the package {package!r}", remedy)
        return str(place)

    # The child ends with this: nobody else's names are found so.
    substitution_args._eval_find = find_package
    try:
        return str(xacro.process_file(str(path), mappings=dict(arguments)).toxml())
    except Exception as error:
        # Xacro evaluates what files say as Python: they raise whatever they like.
        cause = _wrapped_error(error)
        if cause is not None:
            raise cause from error
        said = in_one_line(error)[:200]
        if isinstance(error, RecursionError) or "recursion depth" in str(error):
            said = "it includes a file, or calls a macro, without end"
        unknown = _UNKNOWN_ARGUMENT.search(said)
        # Which arguments it takes that do not follow from others, and what they are without being given.
        free = [arg for arg in _xacro_elements(path, "arg") if "$" not in arg.get("default", "")]
        takes = [":=".join(filter(None, (arg.get("name"), arg.get("default")))) for arg in free[:_NAMED]]
        more = ", …" if len(free) > _NAMED else ""
        known = f" (it takes {', '.join(takes)}{more})" if takes else ""
        remedy = f"mend it, or give its arguments with --xacro-arg {unknown[1] if unknown else 'name'}:=value{known}"
        raise robot_error(path, None, f"xacro cannot expand it ({said})", remedy) from error


def _wrapped_error(error: BaseException | None) -> RobotError | None:
    """Our own error among those that xacro wrapped."""
    while error is not None:
        if isinstance(error, RobotError):
            return error
        own = getattr(error, "exc", None)
        error = own if isinstance(own, BaseException) else error.__context__
    return None


# SDF models as URDF: the same links, joints and shapes, each link's frame put where its joint is.
#
# The semantics are those of sdformat.org's specification, versions 1.4 to 1.11: a pose is relative to the frame that
# ``relative_to`` names, else to the model (links), to the child (joints) or to the link (inertials and shapes); an axis
# is expressed in its joint's frame unless ``expressed_in`` says otherwise, up to version 1.4 in the model's.

_MODEL, _WORLD = "__model__", "world"
_KINDS = {"revolute", "continuous", "prismatic", "fixed"}
# Limits of SDF from which on a joint has none [rad or m].
_UNLIMITED = 1e10


def convert_sdf(root: Element, path: Path) -> str:
    """The URDF of the only model in an SDF file.

    Args:
        root: the ``sdf`` element.
        path: its file, beside which meshes are looked for; for errors.

    Returns:
        URDF text. Meshes that are found are named by their whole path, ``model://`` becomes ``package://``.

    Raises:
        RobotError: there is no model or more than one, it holds other models, a joint has more than one coordinate that
            URDF knows, a frame is not there or hangs on itself, or a number is none.
    """
    models = [*root.findall("model"), *root.findall("world/model")]
    if len(models) != 1:
        names = ", ".join(model.get("name", "") for model in models)
        raise robot_error(
            path,
            "sdf",
            f"holds {len(models)} models{f', {names}' if names else ''}",
            "give a file with the robot's model alone",
        )
    return tostring(_Conversion(models[0], root.get("version", "1.7"), path).build_urdf(), "unicode")


class _Conversion:
    def __init__(self, model: Element, version: str, path: Path) -> None:
        self._model, self._path = model, path
        self._old = tuple(int(part) for part in version.split(".")[:2] if part.isdigit()) <= (1, 4)
        for tag in ("model", "include"):
            if model.find(tag) is not None:
                raise self._error_at(
                    f"holds another model (<{tag}>)", "model", "give the file with that resolved"
                )
        self._links, self._joints, frames = (
            {one.get("name", ""): one for one in model.findall(tag)} for tag in ("link", "joint", "frame")
        )
        self._parents, self._children = (
            {name: _text_of(joint, end) for name, joint in self._joints.items()}
            for end in ("parent", "child")
        )
        self._attached = {name: frame.get("attached_to") or _MODEL for name, frame in frames.items()}
        # What has a pose, and what that is relative to where it does not say.
        self._placed = {name: (frame, self._attached[name]) for name, frame in frames.items()}
        self._placed |= {name: (joint, self._children[name]) for name, joint in self._joints.items()}
        self._placed |= {name: (link, _MODEL) for name, link in self._links.items()}
        # A link's frame in URDF is its joint's.
        self._carriers = {self._carrying_link(child): name for name, child in self._children.items()}

    def build_urdf(self) -> Element:
        robot = Element("robot", name=self._model.get("name") or "robot")
        if _WORLD in self._parents.values():
            SubElement(robot, "link", name=_WORLD)
        for name, link in self._links.items():
            out = SubElement(robot, "link", name=name)
            moved = self._link_pose(name).actInv(self._read_pose(name))
            inertial = link.find("inertial")
            holder = Element("inertial") if inertial is None else inertial
            # What is left out is 1 kg and 1 kg·m² about each axis.
            mass, about = self._read_numbers(holder, "mass", 1, "1"), holder.find("inertia")
            moments = [self._read_numbers(about, key, 1, "1" if key[1] == key[2] else "0") for key in MOMENTS]
            add_inertial(out, moved * self._own_pose(holder), mass, moments)
            for kind in GEOMETRY:
                for shape in link.findall(kind):
                    self._write_shape(out, kind, shape, moved * self._own_pose(shape))
        for name, joint in self._joints.items():
            self._write_joint(robot, name, joint)
        return robot

    def _error_at(self, what: str, field: str, remedy: str) -> RobotError:
        return robot_error(self._path, field, what, remedy)

    def _read_numbers(self, element: Element | None, tag: str, n: int, default: str | None = None) -> Array:
        """Numbers in the text of an element below another one."""
        found = None if element is None else element.find(tag)
        text = default if found is None or found.text is None else found.text
        holder = Element(tag) if text is None else Element(tag, {tag: text})
        return np.array(read_numbers(holder, tag, n, self._path, f"{self._model.get('name')}/{tag}"))

    def _own_pose(self, element: Element) -> pin.SE3:
        pose = element.find("pose")
        text = "" if pose is None or pose.text is None else pose.text.strip()
        if pose is not None and pose.get("rotation_format") == "quat_xyzw":
            values = self._read_numbers(element, "pose", 7)
            quaternion = values[3:] / np.linalg.norm(values[3:])
            return pin.SE3(pin.Quaternion(quaternion).toRotationMatrix(), values[:3])
        values = self._read_numbers(element, "pose", 6) if text else np.zeros(6)
        degrees = pose is not None and pose.get("degrees") in {"true", "1"}
        return pin.SE3(pin.rpy.rpyToMatrix(*(np.radians(values[3:]) if degrees else values[3:])), values[:3])

    def _read_pose(self, name: str, seen: tuple[str, ...] = ()) -> pin.SE3:
        """Pose of a link, joint or frame in the model."""
        if name in {_MODEL, _WORLD}:
            return pin.SE3.Identity()
        if name not in self._placed:
            raise self._error_at("is not in the model", f"frame {name!r}", "name a link, a joint or a frame")
        element, default = self._placed[name]
        pose = element.find("pose")
        base = default if pose is None else pose.get("relative_to") or pose.get("frame") or default
        if name in seen:
            raise self._error_at(
                "is relative to itself", f"frame {name!r}", "name another frame, relative_to"
            )
        return self._read_pose(base, (*seen, name)) * self._own_pose(element)

    def _link_pose(self, name: str) -> pin.SE3:
        """Pose in the model of the frame that a link has in the URDF."""
        return self._read_pose(self._carriers.get(name, name))

    def _carrying_link(self, name: str) -> str:
        """The link that a joint's parent or child is, or is a frame of."""
        # No way from frame to frame is longer than there are frames.
        for _ in self._attached:
            name = self._attached.get(name, name)
        if name not in self._links and name != _WORLD:
            raise self._error_at(
                "is no link of the model", f"link {name!r}", "name links, and frames attached to them"
            )
        return name

    def _write_shape(self, out: Element, kind: str, shape: Element, pose: pin.SE3) -> None:
        for solid in (solid for solid in shape.iterfind("geometry/*") if solid.tag in LENGTHS):
            sizes = {
                key: self._read_numbers(solid, key, n, "1 1 1"[: 2 * n - 1])
                for key, n, _ in LENGTHS[solid.tag]
            }
            added = add_solid(out, kind, pose, solid.tag, **sizes)
            if solid.tag == "mesh":
                uri = _text_of(solid, "uri").replace("model://", "package://", 1)
                file = self._path.resolve().parent / uri.removeprefix("file://")
                added.set("filename", str(file) if "://" not in uri and file.is_file() else uri)

    def _write_joint(self, robot: Element, name: str, joint: Element) -> None:
        kind = joint.get("type", "")
        if kind not in _KINDS:
            remedy = "replace it by joints of one coordinate (revolute, continuous, prismatic), or fix it"
            raise self._error_at(f"is of type {kind!r}", f"joint {name!r}", remedy)
        parent, child = self._carrying_link(self._parents[name]), self._carrying_link(self._children[name])
        base = pin.SE3.Identity() if parent == _WORLD else self._link_pose(parent)
        written = add_joint(robot, name, kind, parent, child, base.actInv(self._read_pose(name)))
        if kind != "fixed":
            self._write_axis(written, name, joint)

    def _write_axis(self, written: Element, name: str, joint: Element) -> None:
        axis = joint.find("axis")
        direction = self._read_numbers(axis, "xyz", 3, "0 0 1")
        add_element(written, "axis", xyz=self._axis_frame(name, axis).rotation.T @ direction)
        limit, dynamics, mimic = (joint.find(f"axis/{tag}") for tag in ("limit", "dynamics", "mimic"))
        ends = {
            key: self._read_numbers(limit, key, 1, end)
            for key, end in {"lower": "-1e16", "upper": "1e16"}.items()
        }
        largest = {key: self._read_numbers(limit, key, 1, "-1") for key in ("effort", "velocity")}
        known = {key: value for key, value in largest.items() if 0.0 <= value[0] < _UNLIMITED}
        limited = -_UNLIMITED < ends["lower"][0] and ends["upper"][0] < _UNLIMITED
        if not limited and written.get("type") == "revolute":
            written.set("type", "continuous")
        add_element(written, "limit", **(ends if limited else {}), **known)
        if dynamics is not None:
            losses = {key: self._read_numbers(dynamics, key, 1, "0") for key in ("damping", "friction")}
            add_element(written, "dynamics", **losses)
        if mimic is not None:
            factor, offset, reference = (
                self._read_numbers(mimic, key, 1, "0") for key in ("multiplier", "offset", "reference")
            )
            shift = offset - factor * reference
            add_element(written, "mimic", joint=mimic.get("joint", ""), multiplier=factor, offset=shift)

    def _axis_frame(self, name: str, axis: Element | None) -> pin.SE3:
        """From the frame in which an axis is expressed to its joint's: that frame's axes are seen from the joint."""
        direction = None if axis is None else axis.find("xyz")
        expressed = None if direction is None else direction.get("expressed_in")
        in_model = axis is not None and _text_of(axis, "use_parent_model_frame", "0") in {"1", "true"}
        if expressed is None and (in_model or self._old):
            expressed = _MODEL
        return (
            pin.SE3.Identity()
            if expressed is None
            else self._read_pose(expressed).actInv(self._read_pose(name))
        )


def _text_of(element: Element, tag: str, default: str = "") -> str:
    found = element.find(tag)
    return default if found is None or found.text is None else found.text.strip()
