"""A robot's description judged by itself: every rule on all of it, worst first, each with its smallest correction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

from excite.atomic import write_text
from excite.display import count
from excite.errors import RobotError, raised_as
from excite.finding import Examination, Finding, list_names, merge_findings, worst_first
from excite.formats.documents import read_xml
from excite.robot.description import FREE_BASES, RobotDescription, read_description
from excite.robot.init_robot.description import AS_IT_IS
from excite.robot.init_robot.files import convert_model, expand_xacro, is_xacro
from excite.robot.init_robot.packages import find_model
from excite.robot.init_robot.source import Source
from excite.robot.inspection.links import DescribedRobot
from excite.robot.inspection.rules import RULES, impossible_inertia
from excite.robot.loading import load_robot, urdf_of
from excite.robot.mjcf.conversion import is_mjcf
from excite.robot.robot import Robot
from excite.robot.urdf.inertia import drop_points, inertial_faults
from excite.robot.urdf.reading import MAX_NESTING, prepare_urdf
from excite.robot.urdf.tree import check_tree
from excite.robot.urdf.writing import MOMENTS, add_element
from excite.temporary_folder import TemporaryFolder

# What follows from another fault of the same link is not said beside it.
_TELLS = {"inertia_scale": ("density", "placeholder")}


@dataclass(frozen=True, eq=False, repr=False)
class RobotChart(Examination):
    """What was found in a robot's description, with the smallest correction that would cure each fault."""

    def sentence(self, finding: Finding) -> str:
        """What was found with the links or joints that it is of."""
        return f"{list_names(finding.places)}: {finding.text}" if finding.places else finding.text

    @property
    def spoiling(self) -> tuple[Finding, ...]:
        """Those that spoil what is computed with the robot, worst first."""
        return tuple(one for one in self.findings if one.severity in {"fatal", "spoils"})

    def worst_in_words(self) -> str:
        """The worst of what spoils results in a line, and how many more there are; empty where nothing does."""
        if not self.spoiling:
            return ""
        more = f" (and {len(self.spoiling) - 1} more)" if len(self.spoiling) > 1 else ""
        return f"the model's {self.sentence(self.spoiling[0])}{more}"


def examine_description(name_or_path: str | Path) -> RobotChart:
    """Judge a robot's description by itself, without a log.

    Args:
        name_or_path: bundled name, folder, or path of a ``robot.yaml``, URDF, xacro or MJCF.

    Returns:
        The findings, worst first.

    Raises:
        RobotError: the file is missing, or so broken that nothing in it can be judged.
        UnknownNameError: neither a file nor a bundled robot.
    """
    path, _ = find_model(name_or_path, Source())
    if path.suffix in {".yaml", ".yml"}:
        description = read_description(path)
        chart = _of_description(description, path)
        if chart.healthy:
            try:
                load_robot(path)
            except RobotError as error:
                return RobotChart(chart.robot, worst_first((_refusal_finding(error), *chart.findings)))
        return chart
    place = TemporaryFolder()
    folder, urdf = place.path, path
    try:
        converted = convert_model(path)
        if converted is not None:
            urdf = converted.write(folder / f"{path.stem}.urdf")
        elif is_xacro(path):
            urdf = write_text(folder / f"{path.stem}.urdf", expand_xacro(path, {}, ()))
    except RobotError as error:
        return _inertials_alone(path, folder, error)
    return _examine_urdf(path.stem, urdf)


def examine_model(robot: Robot) -> RobotChart:
    """Judge the description of a robot that was loaded, in seconds: all that spoils results is found, less is not.

    Links without collision geometry are not judged by their looks.
    """
    return _of_description(robot.description, robot.source, thorough=False)


def _of_description(description: RobotDescription, path: Path, *, thorough: bool = True) -> RobotChart:
    stated = description.model.acknowledged.items()
    accepted = {link: reason for link, reason in stated if not reason.startswith(AS_IT_IS)}
    free, urdf = description.base in FREE_BASES, urdf_of(description, path)
    shaped = frozenset(shape.link for shape in description.collision.shapes)
    return _examine_urdf(
        description.name, urdf, floating=free, acknowledged=accepted, shaped=shaped, thorough=thorough
    )


def _inertials_alone(path: Path, folder: Path, error: RobotError) -> RobotChart:
    """Judge the inertials that a MuJoCo model states which MuJoCo refuses; raise its error where that is not why."""
    if not is_mjcf(path):
        raise error
    urdf = Element("robot", name=path.stem)
    for number, body in enumerate(read_xml(path, max_depth=MAX_NESTING).iter("body")):
        stated = body.find("inertial")
        if stated is None:
            continue
        moments = stated.get("fullinertia", stated.get("diaginertia", "")).split()
        if len(moments) not in {3, 6}:
            raise error
        xx, yy, zz, xy, xz, yz = [*moments, "0", "0", "0"][:6]
        link = add_element(urdf, "link", name=body.get("name") or f"body_{number}")
        inertial = add_element(link, "inertial")
        add_element(inertial, "origin", xyz=stated.get("pos", "0 0 0"))
        add_element(inertial, "mass", value=stated.get("mass", "0"))
        add_element(inertial, "inertia", **dict(zip(MOMENTS, (xx, xy, xz, yy, yz, zz), strict=True)))
    robot = DescribedRobot(urdf, folder / f"{path.stem}.urdf")
    found = (*robot.faults, *impossible_inertia(robot))
    if not found:
        raise error
    return RobotChart(path.stem, worst_first(merge_findings((*found, _refusal_finding(error)))))


@raised_as(RobotError)
def _examine_urdf(
    name: str,
    urdf: Path,
    *,
    floating: bool = False,
    acknowledged: Mapping[str, str] | None = None,
    shaped: frozenset[str] = frozenset(),
    thorough: bool = True,
) -> RobotChart:
    """Judge a URDF; faults of the links in ``acknowledged`` are accepted, for the reasons there.

    The links in ``shaped`` have shapes that are authored elsewhere.
    """
    root = read_xml(urdf, max_depth=MAX_NESTING)
    if root.tag != "robot":
        prepare_urdf(root, urdf)
    drop_points(root)
    robot = DescribedRobot(root, urdf, shaped, thorough=thorough)
    ruled = [finding for rule in RULES for finding in rule(robot)]
    found = [*robot.faults, *ruled]
    # What a rule said of a link's shape says nothing of its inertial.
    judged = {
        place for one in found if one.kind not in {"missing_meshes", "no_shape"} for place in one.places
    }
    found += _refused_rest(root, urdf, floating, judged)
    told = {(one.kind, place) for one in found for place in one.places}
    kept = []
    for one in found:
        if any((kind, place) in told for kind in _TELLS.get(one.kind, ()) for place in one.places):
            continue
        if (
            acknowledged
            and one.kind in {"triangle", "not_positive", "inertial"}
            and set(one.places) <= set(acknowledged)
        ):
            reason = f"accepted in robot.yaml: {acknowledged[one.places[0]]}"
            one = replace(one, severity="note", remedy=reason)
        kept.append(one)
    merged = merge_findings(tuple(kept))
    return RobotChart(name, worst_first(tuple(_shorten_finding(one) for one in merged)))


def _shorten_finding(finding: Finding) -> Finding:
    """A finding of many links told of the first."""
    first, *others = finding.text.split("; ")
    text = f"{first}; the like of {count(len(others), 'other')}" if len(others) > 1 else finding.text
    return replace(finding, text=text)


def _refused_rest(root: Element, urdf: Path, floating: bool, named: set[str]) -> Iterator[Finding]:
    """What the strict reader refuses that no rule has named."""
    try:
        prepare_urdf(root, urdf)
        joints = check_tree(root, urdf)
        faults = inertial_faults(root, joints, floating, urdf)
    except RobotError as error:
        if not any(f"'{name}'" in str(error.field) for name in named):
            yield _refusal_finding(error)
        return
    for name, fault in faults.items():
        if name not in named:
            said = f"{str(fault.field).partition('/')[2]} {fault.what}"
            remedy = "give it a mass and moments that a body has"
            yield Finding("inertial", said, {}, (name,), "spoils", remedy=remedy)


def _refusal_finding(error: RobotError) -> Finding:
    field = str(error.field or "")
    said, place = f"{field} {error.what}".strip(), tuple(field.split("'")[1:2])
    return Finding("refused", said, {}, place, "spoils", remedy=error.remedy or "correct it")
