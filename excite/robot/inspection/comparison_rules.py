"""What links and joints say of each other: copies, left and right, limits, and drives that hold what they carry."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from excite.arrays import Array
from excite.finding import Finding
from excite.robot.inspection.links import DescribedLink, DescribedRobot
from excite.robot.inspection.shape_rules import density
from excite.robot.inspection.slips import numbers_in_words, slip_in_words
from excite.robot.quantities import MAX_TRAVEL, looks_like_degrees
from excite.robot.scaffold.guesses import mirror_names

_GRAVITY = 9.81
# Links whose sizes differ so far are no copies of each other.
_OTHER_SIZE = 1.5
_ALIKE = ", the same about every axis"
# Twins of published models differ by a few per cent in mass; beyond that, and half their size, they are gross.
_TWIN, _TWIN_INERTIA, _GROSS = 1.02, 1.5, 0.5
# Known robots' limbs weigh at most twice what their drives hold.
_HOLDS = 4.0


def placeholders(robot: DescribedRobot) -> Iterator[Finding]:
    """Inertials that were put in for want of better: the same on links of different shape, or a unit's multiple."""
    bodies = list(robot.bodies())
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
        # Of three reasons to think of a copy, two.
        if len(links) < 3 or not (differ or (_ALIKE in what) + masses + (not sizes) > 1):
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


def asymmetry(robot: DescribedRobot) -> Iterator[Finding]:
    """Left and right are mirror images: masses, centres and inertias of twins whose frames mirror each other."""
    pairs = []
    for left in robot.bodies():
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
        if _mirrored(left, right, plane):
            yield from _difference(robot, left, right, mirror)


def _difference(
    robot: DescribedRobot, left: DescribedLink, right: DescribedLink, mirror: Array
) -> Iterator[Finding]:
    """How twins differ whose frames mirror each other."""
    if left.pose is None or right.pose is None:
        return
    size = _reach(robot, left, right)
    masses = float(left.mass or 0.0), float(right.mass or 0.0)
    wanted = right.pose.actInv(mirror @ left.pose.act(left.com))
    off = float(np.linalg.norm(wanted - right.com))
    here, there = (np.maximum(np.linalg.eigvalsh(one.inertia), 1e-12) for one in (left, right))
    ratio = float(np.exp(np.abs(np.log(here / there)).max()))
    faults = []
    if max(masses) > _TWIN * min(masses):
        faults.append(f"masses {masses[0]:.4g} and {masses[1]:.4g} kg")
    if off > (_TWIN - 1.0) * size:
        faults.append(f"centres of mass {off:.2g} m apart once mirrored")
    if ratio > _TWIN_INERTIA:
        faults.append(f"principal moments by a factor of up to {ratio:.3g}")
    if not faults:
        return
    gross = max(masses) > (1.0 + _GROSS) * min(masses) or off > _GROSS * size
    values = f'mass {masses[0]:.4g} and xyz="{numbers_in_words(wanted)}" for {right.name}'
    yield Finding(
        "asymmetry",
        f"left and right differ: {', '.join(faults)}",
        {"mass_ratio": max(masses) / min(masses), "com_m": off, "inertia_ratio": ratio},
        (left.name, right.name),
        "spoils" if gross else "note",
        0.8 if gross else 0.5,
        remedy=f"one of them is wrong; {left.name} mirrored gives {values}",
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


def limits(robot: DescribedRobot) -> Iterator[Finding]:
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


def total_mass(robot: DescribedRobot) -> Iterator[Finding]:
    """Whole robots have a mass that their drives can hold."""
    if any(True for _ in density(robot)):
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
            remedy="correct the masses, or its effort limit" + slip_in_words(worst / _HOLDS),
        )


def _is_below(robot: DescribedRobot, link: str, above: str) -> bool:
    return above in robot.ancestors(link)


COMPARISON_RULES = (placeholders, asymmetry, limits, total_mass)
