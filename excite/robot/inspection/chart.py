"""A robot's description judged by itself: every rule on all of it, worst first, each with its smallest correction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

from excite.display import count
from excite.errors import RobotError
from excite.finding import Examination, Finding, list_names, merge_findings, worst_first
from excite.formats.documents import read_xml
from excite.robot.catalogue import find_robot
from excite.robot.description import FREE_BASES, RobotDescription, read_description
from excite.robot.init_robot.description import AS_IT_IS
from excite.robot.init_robot.files import expand_xacro, is_xacro
from excite.robot.inspection.links import DescribedRobot
from excite.robot.inspection.rules import COMPARISON_RULES, SHAPE_RULES, impossible_inertia
from excite.robot.loading import load_robot, urdf_of
from excite.robot.mjcf.conversion import convert_mjcf, is_mjcf
from excite.robot.robot import Robot
from excite.robot.urdf.inertia import drop_points, inertial_faults
from excite.robot.urdf.reading import MAX_NESTING, parse_urdf
from excite.robot.urdf.tree import check_tree
from excite.temporary_folder import TemporaryFolder

RULES: tuple[Callable[[DescribedRobot], Iterator[Finding]], ...] = (
    impossible_inertia,
    *SHAPE_RULES,
    *COMPARISON_RULES,
)
# What follows from another fault of the same link is not said beside it.
_TELLS = {"inertia_scale": ("density", "placeholder")}
_OF_INERTIA = {"triangle", "not_positive", "inertial"}


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
    path = Path(name_or_path)
    if path.suffix != ".xacro":
        path = find_robot(name_or_path)
    if path.suffix not in {".yaml", ".yml"}:
        place = TemporaryFolder()
        try:
            urdf = _urdf_of_model(path, place.path)
        except RobotError as error:
            return _inertials_alone(path, place.path, error)
        return _examined(path.stem, urdf)
    chart = _of_description(read_description(path), path)
    if not chart.healthy:
        return chart
    try:
        load_robot(path)
    except RobotError as error:
        return RobotChart(chart.robot, worst_first((_refusal(error), *chart.findings)))
    return chart


def examine_model(robot: Robot) -> RobotChart:
    """Judge the description of a robot that was loaded, in seconds: all that spoils results is found, less is not.

    Links without collision geometry are not judged by their looks.
    """
    return _of_description(robot.description, robot.source, thorough=False)


def _of_description(description: RobotDescription, path: Path, *, thorough: bool = True) -> RobotChart:
    urdf = urdf_of(description, path)
    accepted = {
        link: reason
        for link, reason in description.model.acknowledged.items()
        if not reason.startswith(AS_IT_IS)
    }
    return _examined(
        description.name,
        urdf,
        floating=description.base in FREE_BASES,
        acknowledged=accepted,
        thorough=thorough,
    )


def _inertials_alone(path: Path, folder: Path, error: RobotError) -> RobotChart:
    """Judge the inertials that a MuJoCo model states which MuJoCo refuses; raise its error where that is not why."""
    if not is_mjcf(path):
        raise error
    urdf = ElementTree.Element("robot", name=path.stem)
    for number, body in enumerate(read_xml(path, error=RobotError, max_depth=MAX_NESTING).iter("body")):
        stated = body.find("inertial")
        if stated is None:
            continue
        moments = stated.get("fullinertia", stated.get("diaginertia", "")).split()
        if len(moments) not in {3, 6}:
            raise error
        xx, yy, zz, xy, xz, yz = [*moments, "0", "0", "0"][:6]
        link = ElementTree.SubElement(urdf, "link", name=body.get("name") or f"body_{number}")
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=stated.get("pos", "0 0 0"))
        ElementTree.SubElement(inertial, "mass", value=stated.get("mass", "0"))
        ElementTree.SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy=xy, ixz=xz, iyz=yz)
    robot = DescribedRobot(urdf, folder / f"{path.stem}.urdf")
    found = (*robot.faults, *impossible_inertia(robot))
    if not found:
        raise error
    return RobotChart(path.stem, worst_first(merge_findings((*found, _refusal(error)))))


def _urdf_of_model(path: Path, folder: Path) -> Path:
    """The URDF that a model is, or is made of it in a folder."""
    if is_mjcf(path):
        return convert_mjcf(path).write(folder / f"{path.stem}.urdf")
    if is_xacro(path):
        made = folder / f"{path.stem}.urdf"
        made.write_text(expand_xacro(path, {}, ()))
        return made
    return path


def _examined(
    name: str,
    urdf: Path,
    *,
    floating: bool = False,
    acknowledged: Mapping[str, str] | None = None,
    thorough: bool = True,
) -> RobotChart:
    """Judge a URDF."""
    root = read_xml(urdf, error=RobotError, max_depth=MAX_NESTING)
    if root.tag != "robot":
        parse_urdf(urdf)
    drop_points(root)
    robot = DescribedRobot(root, urdf, floating=floating, thorough=thorough)
    found = [finding for rule in RULES for finding in rule(robot)]
    found = [*robot.faults, *found]
    found += _refused(urdf, floating, {place for one in found for place in one.places})
    stated = acknowledged or {}
    told = {(one.kind, place) for one in found for place in one.places}
    found = [
        _accepted(one, stated)
        for one in found
        if not any((kind, place) in told for kind in _TELLS.get(one.kind, ()) for place in one.places)
    ]
    return RobotChart(name, worst_first(tuple(_shortened(one) for one in merge_findings(tuple(found)))))


def _shortened(finding: Finding) -> Finding:
    """A finding of many links told of the first."""
    first, *others = finding.text.split("; ")
    return (
        replace(finding, text=f"{first}; the like of {count(len(others), 'other')}")
        if len(others) > 1
        else finding
    )


def _accepted(finding: Finding, acknowledged: Mapping[str, str]) -> Finding:
    """A finding, a note where the robot's description accepts the fault of that link with a reason."""
    if finding.kind not in _OF_INERTIA or not set(finding.places) <= set(acknowledged):
        return finding
    reason = acknowledged[finding.places[0]]
    return Finding(
        finding.kind,
        finding.text,
        finding.figures,
        finding.places,
        "note",
        finding.sure,
        remedy=f"accepted in robot.yaml: {reason}",
    )


def _refused(urdf: Path, floating: bool, named: set[str]) -> Iterator[Finding]:
    """What the strict reader refuses that no rule has named."""
    try:
        root = parse_urdf(urdf)
        joints = check_tree(root, urdf)
        faults = inertial_faults(root, joints, floating, urdf)
    except RobotError as error:
        if not any(f"'{name}'" in str(error.field) for name in named):
            yield _refusal(error)
        return
    for name, fault in faults.items():
        if name not in named:
            said = f"{str(fault.field).partition('/')[2]} {fault.what}"
            yield Finding(
                "inertial", said, {}, (name,), "spoils", remedy="give it a mass and moments that a body has"
            )


def _refusal(error: RobotError) -> Finding:
    field = str(error.field or "")
    place = tuple(field.split("'")[1:2])
    return Finding(
        "refused", f"{field} {error.what}".strip(), {}, place, "spoils", remedy=error.remedy or "correct it"
    )
