"""A robot's description judged by itself: one small rule a fault, with the smallest correction that would cure it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from excite.arrays import Array
from excite.errors import RobotError
from excite.finding import Finding, FindingList, listed, merged, worst_first
from excite.reading.xml_document import read_xml
from excite.robot.catalogue import find_robot
from excite.robot.described_links import MOMENTS, DescribedLink, DescribedRobot, Solid, tensor
from excite.robot.description import FREE_BASES, RobotDescription, read_description
from excite.robot.loading import load_robot, urdf_of
from excite.robot.mjcf.conversion import convert_mjcf, is_mjcf
from excite.robot.quantities import MAX_TRAVEL, looks_like_degrees
from excite.robot.robot import Robot
from excite.robot.scaffold.description import AS_IT_IS
from excite.robot.scaffold.guesses import mirror_names
from excite.robot.urdf.geometry import drop_points
from excite.robot.urdf.inertia import TOLERANCE, WEIGHTLESS, inertial_faults
from excite.robot.urdf.reading import MAX_NESTING, parse_urdf
from excite.robot.urdf.tree import check_tree
from excite.robot.xacro_file import expanded, is_xacro
from excite.shown import count
from excite.temporary_folder import TemporaryFolder

SCHEMA = "excite.doctor/1"
# Osmium, the densest there is; and copper, the densest that links are made of [kg/m³].
_DENSEST, _COPPER = 22_600.0, 8_960.0
# Light foam, and water; the lightest of 408 links of published models has 15.
_FOAM, _WATER = 10.0, 1e3
# No link of a robot takes a thousand cubic metres [litres].
_ROOM = 1e6
_GRAVITY = 9.81
# Units and slips of the decimal point, by the factor that they make of a mass or of an inertia.
_SLIPS: Mapping[float, str] = {
    10.0: "a decimal point",
    100.0: "a decimal point",
    1e3: "grams for kilograms",
    1e4: "kg·cm² for kg·m²",
    1e6: "kg·mm² for kg·m²",
    1e7: "g·cm² for kg·m²",
    1e9: "g·mm² for kg·m²",
}

# A centre of mass, or a twin's, may lie this share of its shape's size beside it: collision solids are drawn roughly.
_SLACK, _FAR = 0.05, 0.15
# The nearest possible inertia is the correction where it is this near; farther off, other readings are tried.
_NEAR = 0.2
# A reading of an inertia is believed within this factor of the shape's.
_ODD = 10.0
_HAIR = 1e-5
# Rounding to few digits breaks the inequality by less than this share.
_ROUNDED = 0.01
# Share of an even body's inertia below which one stands for a point.
_POINT = 1e-2
# How far beyond its shape's farthest corner an inertia is a slip of unit: identified ones may be a few times that.
_SLIPPED = 30.0
_OTHER_SIZE = 1.5
_ALIKE = ", the same about every axis"
_TWIN, _TWIN_INERTIA = 1.02, 1.5
# Known robots' limbs weigh at most twice what their drives hold.
_HOLDS = 4.0
# What follows from another fault of the same link is not said beside it.
_TELLS = {"inertia_scale": ("density", "placeholder")}
_OF_INERTIA = {"triangle", "not_positive", "inertial"}


@dataclass(frozen=True, eq=False, repr=False)
class RobotChart(FindingList):
    """What was found in a robot's description.

    Attributes:
        robot: name of the robot, or of its file.
        findings: what was found, worst first.
    """

    robot: str
    findings: tuple[Finding, ...]

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.doctor/1``."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "healthy": self.healthy,
            "findings": [finding.to_json() for finding in self.findings],
            "repaired": None,
        }

    def summary(self) -> str:
        """One finding a paragraph, worst first: what, and the smallest correction that would cure it."""
        lines = []
        for finding in self.findings:
            state = finding.severity + ("" if finding.sure == 1.0 else f", {100 * finding.sure:.0f} % sure")
            lines += [f"{finding.kind} ({state}): {_sentence(finding)}", f"    {finding.remedy}"]
        return "\n".join(lines) or "nothing wrong was found"

    @property
    def spoiling(self) -> tuple[Finding, ...]:
        """Those that spoil what is computed with the robot, worst first."""
        return tuple(one for one in self.findings if one.severity in {"fatal", "spoils"})

    def worst_in_words(self) -> str:
        """The worst of what spoils results in a line, and how many more there are; empty where nothing does."""
        if not self.spoiling:
            return ""
        more = f" (and {len(self.spoiling) - 1} more)" if len(self.spoiling) > 1 else ""
        return f"the model's {_sentence(self.spoiling[0])}{more}"


def _sentence(finding: Finding) -> str:
    """What was found with the links or joints that it is of."""
    return f"{listed(finding.places)}: {finding.text}" if finding.places else finding.text


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
        return _examined(path.stem, _urdf_of_model(path, place.path), path)
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
        urdf,
        floating=description.base in FREE_BASES,
        acknowledged=accepted,
        thorough=thorough,
    )


def _urdf_of_model(path: Path, folder: Path) -> Path:
    """The URDF that a model is, or is made of it in a folder."""
    if is_mjcf(path):
        return convert_mjcf(path).write(folder / f"{path.stem}.urdf")
    if is_xacro(path):
        made = folder / f"{path.stem}.urdf"
        made.write_text(expanded(path, {}, ()))
        return made
    return path


def _examined(
    name: str,
    urdf: Path,
    path: Path,
    *,
    floating: bool = False,
    acknowledged: Mapping[str, str] | None = None,
    thorough: bool = True,
) -> RobotChart:
    """Judge a URDF; ``path`` is the file that a person knows."""
    root = read_xml(urdf, error=RobotError, max_depth=MAX_NESTING)
    if root.tag != "robot":
        parse_urdf(urdf)
    drop_points(root)
    robot = DescribedRobot(root, urdf, floating=floating, thorough=thorough)
    found = [finding for rule in RULES for finding in rule(robot)]
    found = [*robot.faults, *found]
    found += _refused(urdf, path, floating, {place for one in found for place in one.places})
    stated = acknowledged or {}
    told = {(one.kind, place) for one in found for place in one.places}
    found = [
        _accepted(one, stated)
        for one in found
        if not any((kind, place) in told for kind in _TELLS.get(one.kind, ()) for place in one.places)
    ]
    return RobotChart(name, worst_first(tuple(_shortened(one) for one in merged(tuple(found)))))


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


def _refused(urdf: Path, path: Path, floating: bool, named: set[str]) -> Iterator[Finding]:
    """What the strict reader refuses that no rule has named."""
    try:
        root = parse_urdf(urdf)
        joints = check_tree(root, urdf)
        faults = inertial_faults(root, joints, floating, urdf)
    except RobotError as error:
        if not any(f"'{name}'" in str(error.field) for name in named):
            yield _refusal(error)
        return
    for name, error in faults.items():
        if name not in named:
            said = f"{str(error.field).partition('/')[2]} {error.what}"
            yield Finding(
                "inertial", said, {}, (name,), "spoils", remedy="give it a mass and moments that a body has"
            )


def _refusal(error: RobotError) -> Finding:
    field = str(error.field or "")
    place = tuple(field.split("'")[1:2])
    return Finding(
        "refused", f"{field} {error.what}".strip(), {}, place, "spoils", remedy=error.remedy or "correct it"
    )


def _density(robot: DescribedRobot) -> Iterator[Finding]:
    """Mass over the volume of the link's shape: nothing is denser than osmium, and no link as light as foam."""
    usual = _usual_density(robot)
    slip = _common_slip(robot)
    for link in robot.links.values():
        mass, own = link.mass, robot.own_hull(link.name)
        if not mass or own is None or _is_stand_in(robot, link):
            continue
        light = mass / own.volume
        dense = _least(robot, link, lambda solid, mass=mass: mass / solid.volume, _COPPER)
        if light >= _FOAM and dense <= _COPPER:
            continue
        density, than, sure = dense, "denser than any metal", 1.0
        if dense <= _DENSEST:
            than, sure = "denser than solid copper", 0.8
        if light < _FOAM:
            density, than, sure = light, "lighter than foam", 0.7
        litres = 1e3 * mass / density
        said = f"{mass:.3g} kg in {litres:.3g} litres are {density:.2g} kg/m³, {than}"
        if slip != 1.0:
            remedy = f"all masses × {1.0 / slip:g}" + _slip(slip)
        elif litres > _ROOM:
            remedy = 'its shape is in millimetres: write scale="0.001 0.001 0.001"'
        elif usual:
            remedy = (
                f"{_by_factor('mass', mass, usual / density)}, at the {usual:.2g} kg/m³ of its other links"
            )
        else:
            remedy = "correct the mass, or the size of its shape"
        yield Finding("density", said, {"density": density}, (link.name,), "spoils", sure, remedy=remedy)


def _common_slip(robot: DescribedRobot) -> float:
    """Power of ten by which the masses of most links are too large, as their median density says; 1 of sound ones."""
    found = [(link.mass or 0.0) / own.volume for link in _bodies(robot) if (own := robot.own_hull(link.name))]
    median = float(np.median(found)) if found else _WATER
    return 1.0 if _FOAM <= median <= _COPPER else 10.0 ** round(math.log10(median / _WATER))


def _is_weightless(robot: DescribedRobot, link: DescribedLink) -> bool:
    """Whether a link's share of the robot's mass is that of a frame."""
    return (link.mass or 0.0) < WEIGHTLESS * robot.mass


def _is_stand_in(robot: DescribedRobot, link: DescribedLink) -> bool:
    """Whether a mass was put in only so that there is one: a power of ten of next to nothing, as frames have."""
    return not link.weighs or (_is_weightless(robot, link) and math.log10(link.mass or 1.0).is_integer())


def _usual_density(robot: DescribedRobot) -> float:
    """Median density of links that may be bodies [kg/m³]; 0 where there are none."""
    found = []
    for link in _bodies(robot):
        solid = next(iter(robot.hulls(link.name)), None)
        if solid is not None and _FOAM < float(link.mass or 0.0) / solid.volume < _COPPER:
            found.append(float(link.mass or 0.0) / solid.volume)
    return float(np.median(found)) if found else 0.0


def _com_outside(robot: DescribedRobot) -> Iterator[Finding]:
    """No body's centre of mass lies outside the convex hull of its matter."""
    for link in _bodies(robot):
        own = next(iter(robot.hulls(link.name)), None)
        if own is None:
            continue
        at_frame, most = not link.com.any(), _SLACK if robot.thorough else _FAR
        share = own.distance(link.com) / own.size
        if not at_frame:
            share = _least(robot, link, lambda solid, com=link.com: solid.distance(com) / solid.size, most)
        if share <= _SLACK:
            continue
        outside = share * own.size
        said = f"its centre of mass ({_vector(link.com)}) m lies {outside:.2g} m outside its shape"
        if at_frame:
            said += ": it was left at the link's frame"
        words, better = _better_com(link.com, own)
        sure = 0.9 if share > _FAR and not at_frame else 0.6
        yield Finding(
            "com_outside",
            said,
            {"outside_m": outside},
            (link.name,),
            "spoils" if sure > 0.6 else "limits",
            sure,
            remedy=f'{words}: xyz="{_vector(better)}"',
        )


def _better_com(com: Array, solid: Solid) -> tuple[str, Array]:
    """The least change that brings a centre of mass into its shape: signs, unit, order, else the nearest point."""
    for n in (1, 2, 3):
        for axes in itertools.combinations(range(3), n):
            turned = com.copy()
            turned[list(axes)] *= -1.0
            if solid.distance(turned) < 0.0:
                return f"sign lost of {' and '.join('xyz'[i] for i in axes)}", turned
    for factor, words in (
        (0.1, "a decimal point"),
        (1e-3, "millimetres for metres"),
        (10.0, "a decimal point"),
    ):
        # A point that is near the frame anyway is no slip of unit.
        farther = max(factor, 1.0) * float(np.linalg.norm(com)) > solid.size * min(1.0, 0.1 / factor)
        if farther and solid.distance(com * factor) < 0.0:
            return words, com * factor
    for order in itertools.permutations(range(3)):
        if solid.distance(com[list(order)]) < 0.0:
            return f"components exchanged, as {''.join('xyz'[i] for i in order)}", com[list(order)]
    return "the nearest point of its shape", solid.nearest(com)


def _impossible_inertia(robot: DescribedRobot) -> Iterator[Finding]:
    """Principal moments are positive, and none is larger than the other two together (triangle inequality)."""
    for link in robot.links.values():
        if link.mass is None or not link.stated.any():
            continue
        if link.mass < 0.0:
            said, figures = f"its mass is {link.mass:g} kg", {"mass": link.mass}
            yield Finding(
                "not_positive", said, figures, (link.name,), "spoils", remedy=f'value="{-link.mass:g}"'
            )
        moments, axes = np.linalg.eigh(link.inertia)
        # Digits that were not written move a principal moment by at most the norm of a matrix of half-steps.
        slack = TOLERANCE * abs(moments[2]) + 3.0 * link.step
        excess = moments[2] - moments[0] - moments[1]
        solid = next(iter(robot.hulls(link.name)), None)
        if moments[0] < -TOLERANCE * max(moments[2], 0.0) or moments[2] <= 0.0:
            said = f"its inertia is not positive definite: the smallest principal moment is {moments[0]:.3g} kg·m²"
            kind, figures = "not_positive", {"smallest_moment": float(moments[0])}
        elif excess > TOLERANCE * moments[2]:
            axis = axes[:, 2]
            share = 100.0 * excess / moments[2]
            said = (
                f"its inertia breaks the triangle inequality by {share:.2g} %: the principal moment {moments[2]:.4g}"
                f" about ({_vector(axis)}), nearest {'xyz'[int(np.abs(axis).argmax())]}, is more than the sum"
                f" {moments[0]:.4g} + {moments[1]:.4g} kg·m² of the other two"
            )
            kind, figures = "triangle", {"excess_percent": float(share)}
        else:
            continue
        rounded = kind == "triangle" and excess <= min(slack, _ROUNDED * moments[2])
        words, better = _better_inertia(link, solid)
        values = " ".join(f'{name}="{value:.6g}"' for name, value in zip(MOMENTS, better, strict=True))
        yield Finding(
            kind,
            said + (", by rounding" if rounded else ""),
            figures,
            (link.name,),
            "note" if rounded or _is_weightless(robot, link) else "spoils",
            remedy=f"{words}: {values}",
        )


def _better_inertia(link: DescribedLink, solid: Solid | None) -> tuple[str, Array]:
    """The smallest correction that makes an inertia possible, as the six numbers to write.

    Where the nearest possible one is far, the numbers may stand in another order, or one of them has lost its sign or
    decimal point: of those readings that are possible, the one nearest to a body of even density.
    """
    six = link.stated
    nearest = nearest_inertia(six)
    if np.linalg.norm(nearest - six) <= _NEAR * np.linalg.norm(six):
        return "the nearest inertia that a body can have", nearest
    even = np.zeros(6)
    if solid is not None and link.weighs:
        covariance = link.axes.T @ solid.spread[1] @ link.axes * float(link.mass or 0.0)
        even = _six(np.trace(covariance) * np.eye(3) - covariance)
    found = [(words, reading) for words, reading in _readings(six, even) if _possible(reading)]
    if not found:
        return "the nearest inertia that a body can have", nearest
    if even.any():
        # A hundredth of a factor of e for each place in the list: of readings that fit alike, the first.
        off = [_off(reading, even) + 0.01 * place for place, (_, reading) in enumerate(found)]
        if min(off) > math.log(_ODD):
            return "the nearest inertia that a body can have", nearest
        return found[int(np.argmin(off))]
    return found[0]


def _off(six: Array, even: Array) -> float:
    """How far the diagonal of an inertia is from that of an even body, as a logarithm."""
    return float(np.linalg.norm(np.log(np.abs(six[[0, 3, 5]] / even[[0, 3, 5]]) + 1e-300)))


def _readings(six: Array, even: Array) -> Iterator[tuple[str, Array]]:
    """What six numbers may have been meant to be; ``even`` is the inertia of the shape, zeros where it has none."""
    a, b, c, d, e, f = six
    if math.isclose(b, d, rel_tol=1e-6, abs_tol=1e-12):
        # izz was the ninth number and is not there: as of the shape, else of a body as thick as it is wide.
        scale = (a + e) / (even[0] + even[3]) if even.any() else 0.0
        zz = even[5] * scale if even.any() else max(a, e)
        yield (
            "a 3 × 3 written row by row; its ninth number, izz, is lost and estimated",
            np.array([a, b, c, e, f, zz]),
        )
    yield "in MJCF's order, ixx iyy izz ixy ixz iyz", np.array([a, d, e, b, f, c])
    yield "its lower triangle row by row, ixx ixy iyy ixz iyz izz", np.array([a, b, d, c, e, f])
    for index in range(6):
        turned = six.copy()
        turned[index] *= -1.0
        yield f"sign lost of {MOMENTS[index]}", turned
    turned = six.copy()
    turned[[1, 2, 4]] *= -1.0
    yield "signs lost of all products of inertia", turned
    for index in range(6):
        for factor in (0.1, 10.0, 0.01, 100.0, 1e-3, 1e3):
            moved = six.copy()
            moved[index] *= factor
            yield f"a decimal point lost in {MOMENTS[index]}", moved


def _possible(six: Array) -> bool:
    low, middle, high = np.linalg.eigvalsh(tensor(six))
    return bool(low > 0.0 and low + middle >= high * (1.0 - TOLERANCE))


def _six(matrix: Array) -> Array:
    return np.array([matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2]])


def nearest_inertia(six: Array) -> Array:
    """The inertia nearest to one that no body can have, in the Frobenius norm.

    It has the same principal axes, and the moments nearest to the stated ones that obey the triangle inequality: the
    second moments L = ½ tr(I) − I are projected onto those that are not negative.

    Args:
        six: ixx, ixy, ixz, iyy, iyz, izz ``(6,)`` [kg·m²].

    Returns:
        The same six of the nearest ``(6,)`` [kg·m²].
    """
    moments, axes = np.linalg.eigh(tensor(six))
    # Rows a·moments ≥ 0 of the triangle inequality; each set of active ones gives a projection, the nearest is right.
    rows = np.ones((3, 3)) - 2.0 * np.eye(3)
    best, distance = np.zeros(3), math.inf
    for n in range(4):
        for active in itertools.combinations(range(3), n):
            a = rows[list(active)]
            point = moments - (np.linalg.pinv(a) @ (a @ moments) if n else 0.0)
            off = float(np.linalg.norm(point - moments))
            if (rows @ point >= -1e-12 * np.abs(moments).max()).all() and off < distance:
                best, distance = point, off
    # A hair inside, so that rounding to six digits does not break it again.
    best = best + _HAIR * np.abs(moments).max()
    return _six(axes @ np.diag(best) @ axes.T)


def _inertia_scale(robot: DescribedRobot) -> Iterator[Finding]:
    """How far the mass is spread: not beyond its shape, and not as if it all were in one point of it."""
    for link in _bodies(robot):
        own = next(iter(robot.hulls(link.name)), None)
        if own is None or not _possible(link.stated) or own.distance(link.com) > 0.0:
            continue
        squared = 0.5 * float(np.trace(link.inertia)) / float(link.mass or 1.0)
        even = float(np.trace(own.spread[1]))
        most = 1.0 if robot.thorough else _SLIPPED
        beyond = _least(
            robot, link, lambda solid, link=link, r=squared: r / _farthest(solid, link.com) ** 2, most
        )
        factor = squared / even
        said = f"its inertia spreads its mass over a radius of {_millimetres(squared)}"
        if beyond > 1.0:
            said += f", beyond its shape, whose farthest corner is {_millimetres(squared / beyond)} from its centre of mass"
        elif factor < _POINT:
            said += f", where an even body of its shape has {_millimetres(even)}"
        else:
            continue
        slip = beyond > _SLIPPED
        yield Finding(
            "inertia_scale",
            said,
            {"of_even_body": factor},
            (link.name,),
            "spoils" if slip else "limits",
            0.9 if slip else 0.6,
            remedy=_by_factor("inertia", None, 1.0 / factor),
        )


def _placeholders(robot: DescribedRobot) -> Iterator[Finding]:
    """Inertials that were put in for want of better: the same on links of different shape, or a unit's multiple."""
    bodies = list(_bodies(robot))
    groups: dict[str, list[DescribedLink]] = {}
    for link in bodies:
        xx, xy, xz, yy, yz, zz = link.stated
        alike = xx == yy == zz and not (xy or xz or yz)
        groups.setdefault(f"the moments {xx:g} {yy:g} {zz:g} kg·m²" + (_ALIKE if alike else ""), []).append(
            link
        )
        if link.mass == 1.0:
            groups.setdefault("the mass 1 kg", []).append(link)
    for what, links in groups.items():
        sizes = [solid.size for link in links if (solid := robot.own_hull(link.name)) is not None]
        differ = len(sizes) > 1 and max(sizes) > _OTHER_SIZE * min(sizes)
        masses = len({link.mass for link in links}) > 1
        if len(links) < 3 or not (differ or masses or (_ALIKE in what and not sizes)):
            continue
        why = f", though their {'shapes' if differ else 'masses'} differ" if differ or masses else ""
        most = 2 * len(links) > len(bodies)
        yield Finding(
            "placeholder",
            f"{len(links)} links share {what}{why}: copied, not measured",
            {"links": len(links)},
            tuple(link.name for link in links),
            "spoils" if most else "limits",
            0.8,
            remedy="take masses and inertias from CAD, or identify them: torques predicted of them are a guess",
        )


def _asymmetry(robot: DescribedRobot) -> Iterator[Finding]:
    """Left and right are mirror images: masses, centres and inertias of twins whose frames mirror each other."""
    pairs = []
    for left in _bodies(robot):
        for name in mirror_names(left.name):
            right = robot.links.get(name)
            if name != left.name and right is not None and right.weighs and right.pose is not None:
                pairs.append((left, right))
                break
    plane = _mirror_plane(pairs)
    if plane is None:
        return
    mirror = np.eye(3)
    mirror[plane, plane] = -1.0
    for left, right in pairs:
        size = _reach(robot, left, right)
        if left.pose is None or right.pose is None or not _mirrored(left, right, plane):
            continue
        masses = float(left.mass or 0.0), float(right.mass or 0.0)
        wanted = right.pose.actInv(mirror @ left.pose.act(left.com))
        off = float(np.linalg.norm(wanted - right.com))
        inertias = [np.linalg.eigvalsh(one.inertia) for one in (left, right)]
        ratio = float(np.max(np.abs(np.log(np.maximum(inertias[0], 1e-12) / np.maximum(inertias[1], 1e-12)))))
        faults = {}
        if max(masses) > _TWIN * min(masses):
            faults["masses"] = f"{masses[0]:.4g} and {masses[1]:.4g} kg"
        if off > _SLACK * size:
            faults["centres of mass"] = f"{off:.3g} m apart once mirrored"
        if ratio > math.log(_TWIN_INERTIA):
            faults["principal moments"] = f"by a factor of up to {math.exp(ratio):.3g}"
        if not faults:
            continue
        gross = max(masses) > 1.5 * min(masses) or off > 0.5 * size
        said = "left and right differ: " + ", ".join(f"{name} {text}" for name, text in faults.items())
        values = f'mass {masses[0]:.4g} and xyz="{_vector(wanted)}" for {right.name}'
        yield Finding(
            "asymmetry",
            said,
            {"mass_ratio": max(masses) / min(masses), "com_m": off},
            (left.name, right.name),
            "spoils" if gross else "note",
            0.8 if gross else 0.5,
            remedy=f"one is right at most; {left.name} mirrored: {values}",
        )


def _mirror_plane(pairs: list[tuple[DescribedLink, DescribedLink]]) -> int | None:
    """Axis across which most twins mirror each other with all joints at zero; None where no axis does."""
    votes = [sum(_mirrored(left, right, axis) for left, right in pairs) for axis in range(3)]
    axis = int(np.argmax(votes))
    return axis if votes[axis] > 0.5 * len(pairs) > 0.0 else None


def _mirrored(left: DescribedLink, right: DescribedLink, axis: int) -> bool:
    if left.pose is None or right.pose is None:
        return False
    here, there = left.pose.translation.copy(), right.pose.translation
    here[axis] *= -1.0
    return bool(abs(there[axis]) > 1e-3 and np.linalg.norm(here - there) < 2e-3)


def _reach(robot: DescribedRobot, left: DescribedLink, right: DescribedLink) -> float:
    """Size of the larger of two links; of those without shape, about that of their inertia [m]."""
    solids = [next(iter(robot.hulls(link.name)), None) for link in (left, right)]
    sizes = [solid.size for solid in solids if solid is not None]
    return max(sizes, default=max(2.0 * float(np.linalg.norm(one.com)) for one in (left, right)) + 1e-3)


def _limits(robot: DescribedRobot) -> Iterator[Finding]:
    """Limits exchanged, equal, in degrees, or without any force or speed."""
    for joint in robot.joints:
        low, high, place = joint.lower, joint.upper, (joint.name,)
        if joint.kind != "continuous" and low is not None and high is not None:
            figures = {"lower": low, "upper": high}
            if low > high:
                said, remedy = (
                    f"its lower limit {low:g} is above its upper {high:g}",
                    f'lower="{high:g}" upper="{low:g}"',
                )
                yield Finding(
                    "limits_turned", said, figures, place, "spoils", remedy=f"exchange them: {remedy}"
                )
            elif low == high:
                said = f"its limits are both {low:g}: it cannot move"
                remedy = "state its range, or make it fixed; until then it is held there"
                yield Finding("limits_equal", said, figures, place, "limits", remedy=remedy)
            elif joint.kind == "revolute" and (looks_like_degrees(low) or looks_like_degrees(high)):
                said = f"its limits {low:g} … {high:g} are degrees"
                remedy = f'write radians: lower="{math.radians(low):.4g}" upper="{math.radians(high):.4g}"'
                yield Finding("limits_degrees", said, figures, place, "spoils", 0.9, remedy=remedy)
            elif joint.kind == "prismatic" and MAX_TRAVEL < max(-low, high) <= 1e3 * MAX_TRAVEL:
                said = f"it slides from {low:g} to {high:g} m"
                yield Finding(
                    "limits_millimetres", said, figures, place, "limits", 0.8, remedy="write metres"
                )
        for name, value in (("effort", joint.effort), ("velocity", joint.velocity)):
            if value is not None and value < 0.0 and value != -1.0:
                said = f"its {name} limit is {value:g}"
                yield Finding(
                    "limits_negative", said, {name: value}, place, "spoils", remedy=f'{name}="{-value:g}"'
                )


def _missing_meshes(robot: DescribedRobot) -> Iterator[Finding]:
    """Meshes that are named and not there: the links have no shape to check."""
    files = [name for names in robot.missing.values() for name in names]
    if files:
        said = f"meshes of {count(len(robot.missing), 'link')} are not there: {listed(sorted({*files}), 3)}"
        remedy = (
            "put them where the model says, or give `excite init-robot --package-path FOLDER`, where they are"
        )
        yield Finding(
            "missing_meshes",
            said,
            {"files": float(len(files))},
            tuple(robot.missing),
            "limits",
            remedy=remedy,
        )


def _total_mass(robot: DescribedRobot) -> Iterator[Finding]:
    """Whole robots have a mass that their drives can hold."""
    if any(True for _ in _density(robot)):
        return
    worst, place, load = 0.0, "", 0.0
    for joint in robot.joints:
        start = robot.links.get(joint.child)
        if joint.kind == "prismatic" or not joint.effort or start is None or start.pose is None:
            continue
        beyond = [
            link for link in robot.links.values() if link.weighs and _is_below(robot, link.name, joint.child)
        ]
        mass = sum(float(link.mass or 0.0) for link in beyond)
        if mass:
            centre = (
                sum(float(k.mass or 0.0) * k.pose.act(k.com) for k in beyond if k.pose is not None) / mass
            )
            lever = np.cross(start.pose.rotation @ joint.axis, centre - start.pose.translation)
            torque = mass * _GRAVITY * float(np.linalg.norm(lever))
            if torque / joint.effort > worst:
                worst, place, load = torque / joint.effort, joint.name, mass
    if worst > _HOLDS:
        said = f"the {load:.3g} kg beyond it weigh {worst:.2g} times what its drive can hold"
        yield Finding(
            "total_mass",
            said,
            {"weight_over_effort": worst},
            (place,),
            "spoils" if worst > 10.0 * _HOLDS else "limits",
            0.7,
            remedy="correct the masses, or its effort limit" + _slip(worst / _HOLDS),
        )


def _is_below(robot: DescribedRobot, link: str, above: str) -> bool:
    return above in robot.ancestors(link)


def _least(
    robot: DescribedRobot, link: DescribedLink, measure: Callable[[Solid], float], most: float
) -> float:
    """The least of a measure over the hulls that a link may be; no further one is made once it is within ``most``."""
    least = math.inf
    for solid in robot.hulls(link.name):
        least = min(least, measure(solid))
        if least <= most:
            break
    return least


def _farthest(solid: Solid, point: Array) -> float:
    return float(np.linalg.norm(solid.points - point, axis=1).max())


def _millimetres(squared: float) -> str:
    return f"{1e3 * math.sqrt(squared):.3g} mm"


def _bodies(robot: DescribedRobot) -> Iterator[DescribedLink]:
    """Links that state a mass which counts."""
    return (link for link in robot.links.values() if link.weighs and not _is_weightless(robot, link))


def _by_factor(what: str, value: float | None, factor: float) -> str:
    """The remedy of something that is off by a factor: a slip of unit or decimal point where it is near one."""
    better = "" if value is None else f", {value * factor:.3g} kg"
    return f"{what} × {factor:.2g}{better}" + _slip(1.0 / factor)


def _slip(factor: float) -> str:
    """What a factor looks like, in words; empty where it is no slip."""
    for size, words in _SLIPS.items():
        if abs(math.log10(max(factor, 1.0 / factor) / size)) < 0.25:
            return f" (looks like {words if factor > 1.0 or size < 1e3 else words + ', the other way round'})"
    return ""


def _vector(values: Array) -> str:
    return " ".join(f"{value:.4g}" for value in values)


RULES: tuple[Callable[[DescribedRobot], Iterator[Finding]], ...] = (
    _impossible_inertia,
    _density,
    _com_outside,
    _inertia_scale,
    _placeholders,
    _asymmetry,
    _limits,
    _missing_meshes,
    _total_mass,
)
