"""The files of a first description: ``robot.yaml``, and the URDF of a model that is no plain URDF, with its meshes."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import yaml

from excite.atomic import all_or_nothing, write_text
from excite.errors import InputError, RobotError
from excite.formats.child import in_child
from excite.formats.documents import read_xml
from excite.formats.file import first_bytes
from excite.results import Assumed
from excite.robot.description import PositionTable
from excite.robot.init_robot.description import scaffold_description
from excite.robot.init_robot.first_guesses import Held, held_still
from excite.robot.init_robot.model_metadata import Said, states_mass, weigh_links
from excite.robot.init_robot.source import Source
from excite.robot.mjcf.conversion import MjcfConversion, convert_mjcf, is_mjcf
from excite.robot.refusal import robot_error
from excite.robot.urdf.limits import (
    assumed_limits,
    joint_limits_beside,
    keep_stated_limits,
    read_limits_file,
    tighten,
    with_tables,
)
from excite.robot.urdf.reading import MAX_NESTING, find_mesh
from excite.robot.urdf.sdf import convert_sdf
from excite.robot.urdf.tree import MOVING, free_root, planar_root
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
        file: the URDF, xacro or MJCF.
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
    source = source or Source()
    target = folder / "robot.yaml"
    _check_absent(target, overwrite)
    ignored = () if source.srdf is None else read_srdf(source.srdf)
    if is_mjcf(file):
        urdf = folder / f"{file.stem}.urdf"
        _check_absent(urdf, overwrite)
        conversion = convert_mjcf(file)
        limited = _limited(_Made(conversion.urdf, None), file, source)
        conversion = replace(conversion, urdf=limited.text or conversion.urdf)
        text = _describe_copy(conversion, urdf, file, seed, ignored, limited)
        with all_or_nothing():
            conversion.write(urdf)
            write_text(target, text)
        return ScaffoldFiles(target, urdf, _read_assumed(text), conversion.notes)
    found, said = _limited(_expand_model(file, source), file, source), Said(ignored=ignored)
    if found.text is None:
        said = replace(said, floating=found.floating, assumed=found.assumed)
        text = scaffold_description(
            file, None if absolute else folder, seed=seed, said=said, absolute=absolute
        )
        return ScaffoldFiles(write_text(target, text), file, _read_assumed(text), ())
    urdf = folder / f"{file.name.removesuffix('.xacro').removesuffix('.sdf').removesuffix('.urdf')}.urdf"
    if urdf.resolve() == file.resolve():
        urdf = urdf.with_name(f"{urdf.stem}_expanded.urdf")
    _check_absent(urdf, overwrite)
    place = TemporaryFolder()
    copy = write_text(place.path / urdf.name, found.text)
    said = replace(said, floating=found.floating, assumed=found.assumed, by_position=found.by_position)
    text = _renamed_errors(copy, place.path, file, seed, said)
    with all_or_nothing():
        write_text(urdf, found.text)
        write_text(target, text)
    return ScaffoldFiles(target, urdf, _read_assumed(text), ())


@dataclass(frozen=True)
class _Made:
    """A URDF that is made of a file.

    Attributes:
        text: None where the file is the URDF.
        floating: True where it says that its base is free; None where it does not say.
        assumed: what was assumed to make it.
        by_position: limits that depend on positions.
    """

    text: str | None
    floating: bool | None
    assumed: tuple[Assumed, ...] = ()
    by_position: tuple[PositionTable, ...] = ()


def _expand_model(file: Path, source: Source) -> _Made:
    """The URDF that is made of a xacro file, or of one that leaves masses out."""
    plain = not is_xacro(file) and not source.package_path
    root = read_xml(file, error=RobotError, max_depth=MAX_NESTING) if plain or file.suffix == ".sdf" else None
    if root is not None and root.tag == "sdf":
        return _Made(convert_sdf(root, file), None)
    if root is not None and (states_mass(root) or root.tag != "robot"):
        return _Made(None, _stated_floating(root), _wheeled_assumption(root))
    text = expand_xacro(file, source.arguments, source.package_path)
    root = ElementTree.fromstring(text)
    found = weigh_links(root, file)
    if found is not None:
        return _Made(found.text, _stated_floating(root), (found.assumed, *_wheeled_assumption(root)))
    return _Made(None if plain else text, _stated_floating(root), _wheeled_assumption(root))


def _limited(made: _Made, file: Path, source: Source) -> _Made:
    """The URDF with the joint limits of a file of MoveIt's kind, stated or found beside the model, that are tighter."""
    files = joint_limits_beside(file) if source.limits is None else [source.limits]
    if not files:
        return made
    text = made.text or expand_xacro(file, source.arguments, source.package_path)
    root = ElementTree.fromstring(text)
    keep_stated_limits(root, file)
    names = [joint.get("name", "") for joint in root.findall("joint")]
    tightened, by_position = dict[str, dict[str, list[str]]](), list[PositionTable]()
    for one in files:
        found = read_limits_file(one, names)
        if not found.limits and not found.tables and source.limits is not None:
            what, has = "names no joint of the robot", "the model has " + ", ".join(names)
            raise robot_error(one, "joint_limits", what, has)
        named = "/".join(one.parts[-3:] if source.limits is None else one.parts[-1:])
        tightened[named] = with_tables(tighten(root, found.limits, file, one.name), found.tables)
        by_position += found.tables
    if not any(tightened.values()):
        return made
    text = ElementTree.tostring(root, encoding="unicode")
    said = (*made.assumed, *assumed_limits(tightened))
    return replace(made, text=text, assumed=said, by_position=tuple(by_position))


def _wheeled_assumption(root: ElementTree.Element) -> tuple[Assumed, ...]:
    """A base that slides and turns on a plane is held still."""
    joint = planar_root(root)
    held = {} if joint is None else {str(joint.get("name")): Held(0.0, "what its wheels or legs do")}
    return tuple(held_still(held))


def _stated_floating(root: ElementTree.Element) -> bool | None:
    return None if free_root(root) is None else True


def _describe_copy(
    conversion: MjcfConversion,
    urdf: Path,
    file: Path,
    seed: int,
    ignored: tuple[tuple[str, str], ...],
    limited: _Made,
) -> str:
    """Describe the URDF from a copy that goes away again, so that nothing is written where that fails."""
    said = Said(
        conversion.floating,
        conversion.posture,
        (*conversion.excluded, *ignored),
        conversion.loops,
        conversion.couplings,
        assumed=limited.assumed,
        armature=conversion.armature,
        by_position=limited.by_position,
    )
    place = TemporaryFolder()
    return _renamed_errors(conversion.write(place.path / urdf.name), place.path, file, seed, said)


def _renamed_errors(copy: Path, folder: Path, file: Path, seed: int, said: Said) -> str:
    try:
        return scaffold_description(copy, folder, seed=seed, said=said)
    except RobotError as error:
        # The person knows the model, not the copy of its URDF.
        raise robot_error(file, error.field, error.what, error.remedy) from error


def _check_absent(path: Path, overwrite: bool) -> None:
    if os.path.exists(path) and not overwrite:
        raise InputError("exists already", source=path, remedy="give --force to overwrite it, or --out DIR")


def _read_assumed(text: str) -> tuple[Assumed, ...]:
    return tuple(Assumed(**one) for one in yaml.safe_load(text)["assumed"])


# Pairs of links that an SRDF file lets touch.


def read_srdf(path: Path) -> tuple[tuple[str, str], ...]:
    """Pairs that ``disable_collisions`` names.

    Raises:
        RobotError: the file is missing, is no SRDF, or a pair names one link only.
    """
    root = read_xml(path, error=RobotError)
    if root.tag != "robot" or root.find("link") is not None:
        raise robot_error(path, root.tag, "is no SRDF", "give the .srdf of a MoveIt configuration")
    pairs = []
    for number, element in enumerate(root.findall("disable_collisions")):
        first, second = element.get("link1"), element.get("link2")
        if not first or not second:
            raise robot_error(
                path, f"disable_collisions {number}", "names one link only", "give link1 and link2"
            )
        pairs.append((first, second))
    return tuple(pairs)


# Xacro files expanded to URDF, with mesh files found.

_NAMESPACE = "ros.org/wiki/xacro"
# A model of 2 000 links from a macro each takes 5 s and 0.13 GB on a busy core.
_SECONDS, _MEMORY_GB = 30.0, 4.0
# Named arguments and macros.
_NAMED = 8
_UNKNOWN_ARGUMENT = re.compile(r"Undefined substitution argument (\w+)")


def is_xacro(path: Path) -> bool:
    """Whether a file is to be expanded before it is a URDF."""
    return path.suffix == ".xacro" or _NAMESPACE.encode() in first_bytes(path, 4096)


def expand_xacro(path: Path, arguments: Mapping[str, str], package_path: tuple[Path, ...] = ()) -> str:
    """URDF text of a URDF or xacro file, its mesh paths absolute where the files are found.

    Args:
        path: the file.
        arguments: of the xacro file, by name.
        package_path: folders in which packages lie.

    Raises:
        RobotError: the file is missing, or xacro cannot expand it, or not within half a minute, or to no link.
    """
    if is_xacro(path):
        leftovers = _without_xacro(path)
        try:
            root = _expanded_root(path, arguments, package_path)
        except RobotError:
            if leftovers is None:
                raise
            # What every reader of URDF makes of such a file: elements of xacro mean nothing to them.
            root = leftovers
    else:
        root = read_xml(path, error=RobotError)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        found = find_mesh(name, path) or _in_packages(name, package_path)
        if found is not None:
            mesh.set("filename", str(found))
    return ElementTree.tostring(root, encoding="unicode")


def _expanded_root(
    path: Path, arguments: Mapping[str, str], package_path: tuple[Path, ...]
) -> ElementTree.Element:
    # In a process of its own: xacro evaluates what a file says as Python, which need not end.
    text = in_child(
        f"{__name__}:_expand",
        path,
        dict(arguments),
        package_path,
        source=path,
        error=RobotError,
        seconds=_SECONDS,
        memory_gb=_MEMORY_GB,
        endless=(
            "is not expanded after {seconds:g} s: an expression or macro in it does not end",
            "find the ${…} that takes so long, or expand it with xacro and give the URDF",
        ),
    )
    root = ElementTree.fromstring(text)
    if root.find("link") is None:
        raise _defines_alone(path)
    return root


def _without_xacro(path: Path) -> ElementTree.Element | None:
    """A file called a URDF without elements of xacro that were left over in it; None where it needs xacro.

    It does where nothing moves without them, or a value is to be evaluated.
    """
    root = read_xml(path, error=RobotError)
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
    if not name.startswith("package://"):
        return None
    package, _, inside = name.removeprefix("package://").lstrip("/").partition("/")
    for given in package_path if package and "\0" not in name else ():
        folder = package_folder(package, (given,))
        if folder is not None and (folder / inside).is_file():
            return (folder / inside).resolve()
    return None


def _expand(path: Path, arguments: Mapping[str, str], package_path: tuple[Path, ...]) -> str:
    import xacro
    from xacro import substitution_args

    def find(package: str) -> str:
        place = package_folder(package, package_path, path.resolve().parents)
        if place is not None:
            return str(place)
        raise robot_error(
            path,
            "$(find)",
            f"needs the package {package!r}",
            "give --package-path FOLDER, in which it or its clone lies",
        )

    known: Callable[[str], str] = substitution_args._eval_find
    substitution_args._eval_find = find
    try:
        return str(xacro.process_file(str(path), mappings=dict(arguments)).toxml())
    except Exception as error:
        # Xacro evaluates what files say as Python: they raise whatever they like.
        cause = _wrapped_error(error)
        if cause is not None:
            raise cause from error
        endless = isinstance(error, RecursionError) or "recursion depth" in str(error)
        said = (
            "it includes a file, or calls a macro, without end"
            if endless
            else " ".join(str(error).split())[:200] or type(error).__name__
        )
        unknown = _UNKNOWN_ARGUMENT.search(said)
        name = unknown.group(1) if unknown else "name"
        raise robot_error(
            path,
            None,
            f"xacro cannot expand it ({said})",
            f"mend it, or give its arguments with --xacro-arg {name}:=value{_describe_arguments(path)}",
        ) from error
    finally:
        substitution_args._eval_find = known


def _defines_alone(path: Path) -> RobotError:
    """What to say of a file that expands to no link, as those do that only define macros."""
    macros = [str(one.get("name")) for one in read_xml(path).iter() if one.tag.endswith("/xacro}macro")]
    if not macros:
        return robot_error(path, None, "expands to no <link>", "give the file that describes the robot")
    named = ", ".join(macros[:_NAMED])
    remedy = f"give the file that includes it and calls {'it' if len(macros) == 1 else 'one'}"
    return robot_error(path, None, f"only defines macros ({named})", remedy)


def _describe_arguments(path: Path) -> str:
    """Which arguments a file takes that do not follow from others, and what they are without being given."""
    found = [element for element in read_xml(path).iter() if element.tag.endswith("/xacro}arg")]
    free = [arg for arg in found if "$" not in arg.get("default", "")]
    said = [":=".join(filter(None, (arg.get("name"), arg.get("default")))) for arg in free[:_NAMED]]
    more = ", …" if len(free) > _NAMED else ""
    return f" (it takes {', '.join(said)}{more})" if said else ""


def _wrapped_error(error: BaseException | None) -> RobotError | None:
    """Our own error among those that xacro wrapped."""
    while error is not None:
        if isinstance(error, RobotError):
            return error
        own = getattr(error, "exc", None)
        error = own if isinstance(own, BaseException) else error.__context__
    return None


# Folders of ROS packages: those called so, and those whose ``package.xml`` says the name.

_MANIFEST = "package.xml"
# How far below a folder of packages they are looked for: a workspace holds src, clones, and packages in each of these.
_DEEP = 3


def package_folder(name: str, package_path: Iterable[Path], above: Iterable[Path] = ()) -> Path | None:
    """The folder of a package, or None.

    What a ``package.xml`` says goes first, as ROS goes by it: a clone may be called as its owner likes, and a folder
    of that name further up may be anything. Packages elsewhere in the clone that the file lies in are looked at too, as
    of an arm's maker whose torso is another package. Then come folders called so, which say no other name.

    Args:
        name: of the package.
        package_path: packages, or folders in which packages lie.
        above: folders above the file that needs it, the nearest first, of which each may be the package, or hold it
            under its name.
    """
    given, outer = tuple(package_path), tuple(above)
    near, far = ([*_folders_named(name, folders)] for folders in (given, outer))
    clone = next(((folder,) for folder in outer if (folder / ".git").exists()), ())
    said = (place for place in (*near, *far, *outer) if _package_name(place) == name)
    inside = (
        place
        for folder in (*given, *clone)
        for place in _find_packages(folder, _DEEP)
        if _package_name(place) == name
    )
    unsaid_near, unsaid_far = (
        [place for place in places if _package_name(place) is None] for places in (near, far)
    )
    return next(chain(said, unsaid_near, inside, unsaid_far), None)


def _folders_named(name: str, folders: Iterable[Path]) -> Iterator[Path]:
    """Folders of that name, of which each given one may be one, or hold one."""
    for place in (place for folder in folders for place in (folder, folder / name)):
        if place.name == name and place.is_dir():
            yield place


def _package_name(folder: Path) -> str | None:
    """The name in a folder's ``package.xml``; None where there is none that can be read."""
    file = folder / _MANIFEST
    if not file.is_file():
        return None
    try:
        named = read_xml(file, error=RobotError).find("name")
    except RobotError:
        return None
    return None if named is None or not named.text else named.text.strip()


def _find_packages(folder: Path, deep: int) -> Iterator[Path]:
    """Folders with a ``package.xml`` at and below one, hidden ones left out; packages hold no others."""
    if (folder / _MANIFEST).is_file():
        yield folder
        return
    if not deep or not os.access(folder, os.R_OK | os.X_OK) or not folder.is_dir():
        return
    for child in sorted(folder.iterdir()):
        if child.is_dir() and not child.name.startswith("."):
            yield from _find_packages(child, deep - 1)
