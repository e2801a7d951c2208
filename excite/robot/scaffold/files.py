"""The files of a first description: ``robot.yaml``, and the URDF of a model that is no plain URDF, with its meshes."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import yaml

from excite.atomic import all_or_nothing, write_text
from excite.errors import InputError, RobotError
from excite.reading.xml_document import read_xml
from excite.robot.description import Assumed
from excite.robot.mjcf.conversion import MjcfConversion, convert_mjcf, is_mjcf
from excite.robot.scaffold.description import scaffold_description
from excite.robot.scaffold.held import Held
from excite.robot.scaffold.said import Said
from excite.robot.scaffold.source import Source
from excite.robot.scaffold.structure import held_still
from excite.robot.scaffold.weighed import states_mass, weigh_links
from excite.robot.srdf import read_srdf
from excite.robot.urdf.free_root import free_root, planar_root
from excite.robot.urdf.limits import (
    assumed_limits,
    joint_limits_beside,
    keep_stated_limits,
    read_joint_limits,
    tighten,
)
from excite.robot.urdf.reading import MAX_NESTING
from excite.robot.xacro_file import expand_xacro, is_xacro
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
        text = _describe_copy(conversion, urdf, file, seed, ignored, limited.assumed)
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
    urdf = folder / f"{file.name.removesuffix('.xacro').removesuffix('.urdf')}.urdf"
    if urdf.resolve() == file.resolve():
        urdf = urdf.with_name(f"{urdf.stem}_expanded.urdf")
    _check_absent(urdf, overwrite)
    place = TemporaryFolder()
    copy = write_text(place.path / urdf.name, found.text)
    said = replace(said, floating=found.floating, assumed=found.assumed)
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
    """

    text: str | None
    floating: bool | None
    assumed: tuple[Assumed, ...] = ()


def _expand_model(file: Path, source: Source) -> _Made:
    """The URDF that is made of a xacro file, or of one that leaves masses out."""
    plain = not is_xacro(file) and not source.package_path
    root = read_xml(file, error=RobotError, max_depth=MAX_NESTING) if plain else None
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
    tightened: dict[str, dict[str, list[str]]] = {}
    for one in files:
        limits = read_joint_limits(one, names)
        if not limits and source.limits is not None:
            raise RobotError(
                "names no joint of the robot",
                source=one,
                field="joint_limits",
                remedy="the model has " + ", ".join(names),
            )
        named = "/".join(one.parts[-3:] if source.limits is None else one.parts[-1:])
        tightened[named] = tighten(root, limits, file, one.name)
    if not any(tightened.values()):
        return made
    text = ElementTree.tostring(root, encoding="unicode")
    return replace(made, text=text, assumed=(*made.assumed, *assumed_limits(tightened)))


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
    assumed: tuple[Assumed, ...],
) -> str:
    """Describe the URDF from a copy that goes away again, so that nothing is written where that fails."""
    said = Said(
        conversion.floating,
        conversion.posture,
        (*conversion.excluded, *ignored),
        conversion.loops,
        conversion.couplings,
        assumed=assumed,
        armature=conversion.armature,
    )
    place = TemporaryFolder()
    return _renamed_errors(conversion.write(place.path / urdf.name), place.path, file, seed, said)


def _renamed_errors(copy: Path, folder: Path, file: Path, seed: int, said: Said) -> str:
    try:
        return scaffold_description(copy, folder, seed=seed, said=said)
    except RobotError as error:
        # The person knows the model, not the copy of its URDF.
        raise RobotError(error.what, source=file, field=error.field, remedy=error.remedy) from error


def _check_absent(path: Path, overwrite: bool) -> None:
    if os.path.exists(path) and not overwrite:
        raise InputError("exists already", source=path, remedy="give --force to overwrite it, or --out DIR")


def _read_assumed(text: str) -> tuple[Assumed, ...]:
    return tuple(Assumed.model_validate(one) for one in yaml.safe_load(text)["assumed"])
