"""Xacro files expanded to URDF, with mesh files found."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree

from excite.errors import RobotError
from excite.reading.child import in_child
from excite.reading.file import first_bytes
from excite.reading.xml_document import read_xml
from excite.robot.packages import package_folder
from excite.robot.urdf.reading import find_mesh
from excite.robot.urdf.tree import MOVING

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
        raise RobotError(
            f"needs the package {package!r}",
            source=path,
            field="$(find)",
            remedy="give --package-path FOLDER, in which it or its clone lies",
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
        raise RobotError(
            f"xacro cannot expand it ({said})",
            source=path,
            remedy=f"mend it, or give its arguments with --xacro-arg {name}:=value{_describe_arguments(path)}",
        ) from error
    finally:
        substitution_args._eval_find = known


def _defines_alone(path: Path) -> RobotError:
    """What to say of a file that expands to no link, as those do that only define macros."""
    macros = [str(one.get("name")) for one in read_xml(path).iter() if one.tag.endswith("/xacro}macro")]
    if not macros:
        return RobotError(
            "expands to no <link>", source=path, remedy="give the file that describes the robot"
        )
    named = ", ".join(macros[:_NAMED])
    remedy = f"give the file that includes it and calls {'it' if len(macros) == 1 else 'one'}"
    return RobotError(f"only defines macros ({named})", source=path, remedy=remedy)


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
