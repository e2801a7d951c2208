"""Rules by which a robot's description is judged: inertias, shapes, comparison of links, slips of unit and sign."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.display import count
from excite.finding import Finding, Severity, list_names
from excite.robot.init_robot.first_guesses import mirror_names
from excite.robot.inspection.links import MOMENTS, DescribedLink, DescribedRobot, Solid, tensor
from excite.robot.quantities import MAX_TRAVEL, looks_like_degrees
from excite.robot.urdf.inertia import TOLERANCE

# Inertias that no body has, and the smallest correction that makes one of them possible.

# The nearest possible inertia is the correction where it is this near; farther off, other readings are tried.
_NEAR = 0.2
# A reading of an inertia is believed within this factor of the shape's.
_ODD = 10.0
# What six digits round away.
_HAIR = 1e-5
# Rounding to few digits breaks the inequality by less than this share.
_ROUNDED = 0.01


def impossible_inertia(robot: DescribedRobot) -> Iterator[Finding]:
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
        if moments[0] < -TOLERANCE * max(moments[2], 0.0) or moments[2] <= 0.0:
            said = f"its inertia is not positive definite: the smallest principal moment is {moments[0]:.3g} kg·m²"
            found = Finding("not_positive", said, {"smallest_moment": float(moments[0])})
        elif excess > TOLERANCE * moments[2]:
            share = 100.0 * excess / moments[2]
            said = (
                f"its inertia breaks the triangle inequality by {share:.2g} %: the principal moment {moments[2]:.4g}"
                f" about ({numbers_in_words(axes[:, 2])}), nearest {'xyz'[int(np.abs(axes[:, 2]).argmax())]}, is more"
                f" than the sum {moments[0]:.4g} + {moments[1]:.4g} kg·m² of the other two"
            )
            rounded = excess <= min(slack, _ROUNDED * moments[2])
            found = Finding(
                "triangle", said + ", by rounding" * bool(rounded), {"excess_percent": float(share)}
            )
        else:
            continue
        note = robot.is_weightless(link) or found.text.endswith("rounding")
        words, better = _better_inertia(link, next(iter(robot.hulls(link.name)), None))
        values = " ".join(f'{name}="{value:.6g}"' for name, value in zip(MOMENTS, better, strict=True))
        severity: Severity = "note" if note and found.kind == "triangle" else "spoils"
        yield replace(found, places=(link.name,), severity=severity, remedy=f"{words}: {values}")


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
    found = [(words, reading) for words, reading in _readings(six, even) if is_possible(reading)]
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
    yield "in URDF's order, ixx ixy ixz iyy iyz izz", np.array([a, d, f, b, c, e])
    yield "its lower triangle row by row, ixx ixy iyy ixz iyz izz", np.array([a, b, d, c, e, f])
    for index in range(6):
        turned = six.copy()
        turned[index] *= -1.0
        yield f"sign lost of {MOMENTS[index]}", turned
    turned = six.copy()
    turned[[1, 2, 4]] *= -1.0
    yield "signs lost of all products of inertia", turned
    # Without a shape any digit may be the lost one.
    for index in range(6 if even.any() else 0):
        for factor in (0.1, 10.0, 0.01, 100.0, 1e-3, 1e3):
            moved = six.copy()
            moved[index] *= factor
            yield f"a decimal point lost in {MOMENTS[index]}", moved


def is_possible(six: Array) -> bool:
    """Whether a body can have the inertia of ixx, ixy, ixz, iyy, iyz, izz ``(6,)`` [kg·m²]."""
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


# Numbers of a description in words: vectors, and factors that look like slips of unit or decimal point.

# By the factor that they make of a mass or of an inertia.
_SLIPS: Mapping[float, str] = {
    10.0: "a decimal point",
    100.0: "a decimal point",
    1e3: "grams for kilograms",
    1e4: "kg·cm² for kg·m²",
    1e6: "kg·mm² for kg·m²",
    1e7: "g·cm² for kg·m²",
    1e9: "g·mm² for kg·m²",
}


def by_factor(what: str, value: float | None, factor: float) -> str:
    """The remedy of something that is to be multiplied by about a factor; exactly by the slip's that is near it.

    Args:
        what: the quantity, in words.
        value: the mass that is stated [kg]; None of anything else.
        factor: what makes it usual.
    """
    slip = _nearest_slip(1.0 / factor)
    exact = factor if slip is None else 1.0 / slip
    better = "" if value is None else f", {value * exact:.3g} kg"
    return f"{what} × {exact:.2g}{better}" + slip_in_words(1.0 / factor)


def slip_in_words(factor: float) -> str:
    """What a factor looks like; empty where it is near no slip."""
    slip = _nearest_slip(factor)
    if slip is None:
        return ""
    words = _SLIPS[max(slip, round(1.0 / slip))]
    return f" (looks like {words}{', the other way round' if slip < 1e-2 else ''})"


def _nearest_slip(factor: float) -> float | None:
    """The slip that a factor is nearest to; None where it is near none.

    What is usual is known to a factor of three: half a decade for units, less for a digit more or less.
    """
    slips = [slip for size in _SLIPS for slip in (size, 1.0 / size)]
    nearest = min(slips, key=lambda slip: abs(math.log10(factor / slip)))
    decades = 0.5 if abs(math.log10(nearest)) > 2.5 else 0.25
    return nearest if abs(math.log10(factor / nearest)) < decades else None


def numbers_in_words(values: Array) -> str:
    """The numbers of a vector as an attribute holds them."""
    return " ".join(f"{value:.4g}" for value in values)


# What a link's mass, centre and inertia say of its shape: no body is denser than metal, or lies beside
# itself.

# Osmium, the densest there is; and copper: of 408 links of published models none is denser than 7 700 kg/m³.
_DENSEST, _COPPER = 22_600.0, 8_960.0
# Light foam, of which the lightest of these links is not, with 15 kg/m³; and water.
_FOAM, _WATER = 10.0, 1e3
# No link of a robot takes a thousand cubic metres [litres].
_ROOM = 1e6
# A centre of mass may lie this share of its shape's size beside it, since collision solids are drawn roughly: of these
# links one in a hundred does, by up to 0.13, and one whose sign was lost by 0.3.
_SLACK, _FAR = 0.05, 0.15
# Share of an even body's inertia below which one stands for a point; the least of these links has 0.04.
_POINT = 1e-2
# How far beyond its shape's farthest corner an inertia is a slip of unit; identified ones are up to 6 times beyond.
_SLIPPED = 30.0


def density(robot: DescribedRobot) -> Iterator[Finding]:
    """Mass over the volume of the link's shape: nothing is denser than osmium, and no link as light as foam."""
    usual = _usual_density(robot)
    slip = _common_slip(robot)
    for link in robot.links.values():
        mass, own = link.mass, robot.own_hull(link.name)
        if not mass or own is None or _is_stand_in(robot, link):
            continue
        light = mass / own.volume
        dense = _least(robot, link, _density_in, _COPPER)
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
            remedy = f"all masses × {1.0 / slip:g}" + slip_in_words(slip)
        elif litres > _ROOM:
            remedy = 'its shape is in millimetres: write scale="0.001 0.001 0.001"'
        elif usual:
            remedy = (
                f"{by_factor('mass', mass, usual / density)}, at the {usual:.2g} kg/m³ of its other links"
            )
        else:
            remedy = "correct the mass, or the size of its shape"
        yield Finding("density", said, {"density": density}, (link.name,), "spoils", sure, remedy=remedy)


def _usual_density(robot: DescribedRobot) -> float:
    """Median density of links that may be bodies [kg/m³]; 0 where there are none."""
    found = []
    for link in robot.bodies():
        solid = next(iter(robot.hulls(link.name)), None)
        if solid is not None and _FOAM < float(link.mass or 0.0) / solid.volume < _COPPER:
            found.append(float(link.mass or 0.0) / solid.volume)
    return float(np.median(found)) if found else 0.0


def _common_slip(robot: DescribedRobot) -> float:
    """Power of ten by which the masses of most links are too large, as their median density says; 1 of sound ones."""
    found = [(link.mass or 0.0) / own.volume for link in robot.bodies() if (own := robot.own_hull(link.name))]
    median = float(np.median(found)) if found else _WATER
    return 1.0 if _FOAM <= median <= _COPPER else 10.0 ** round(math.log10(median / _WATER))


def _is_stand_in(robot: DescribedRobot, link: DescribedLink) -> bool:
    """Whether a mass was put in only so that there is one: a power of ten of next to nothing, as frames have."""
    return not link.weighs or (robot.is_weightless(link) and math.log10(link.mass or 1.0).is_integer())


def com_outside(robot: DescribedRobot) -> Iterator[Finding]:
    """No body's centre of mass lies outside the convex hull of its matter."""
    for link in robot.bodies():
        own = next(iter(robot.hulls(link.name)), None)
        if own is None:
            continue
        at_frame, most = not link.com.any(), _SLACK if robot.thorough else _FAR
        share = own.distance(link.com) / own.size
        if not at_frame:
            share = _least(robot, link, _share_outside, most)
        if share <= _SLACK:
            continue
        outside = share * own.size
        said = f"its centre of mass ({numbers_in_words(link.com)}) m lies {outside:.2g} m outside its shape"
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
            remedy=f'{words}: xyz="{numbers_in_words(better)}"',
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


def inertia_scale(robot: DescribedRobot) -> Iterator[Finding]:
    """How far the mass is spread: not beyond its shape, and not as if it all were in one point of it."""
    for link in robot.bodies():
        own = next(iter(robot.hulls(link.name)), None)
        if own is None or not is_possible(link.stated) or own.distance(link.com) > 0.0:
            continue
        squared = _squared_spread(link)
        even = float(np.trace(own.spread[1]))
        most = 1.0 if robot.thorough else _SLIPPED
        beyond = _least(robot, link, _spread_beyond, most)
        factor = squared / even
        said = f"its inertia spreads its mass over a radius of {_millimetres(squared)}"
        if beyond > 1.0:
            said += f", beyond its shape, which ends {_millimetres(squared / beyond)} from its centre of mass"
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
            remedy=by_factor("inertia", None, 1.0 / factor),
        )


def _least(
    robot: DescribedRobot, link: DescribedLink, measure: Callable[[DescribedLink, Solid], float], most: float
) -> float:
    """The least of a measure over the hulls that a link may be; no further one is made once it is within ``most``."""
    least = math.inf
    for solid in robot.hulls(link.name):
        least = min(least, measure(link, solid))
        if least <= most:
            break
    return least


def _density_in(link: DescribedLink, solid: Solid) -> float:
    return (link.mass or 0.0) / solid.volume


def _share_outside(link: DescribedLink, solid: Solid) -> float:
    return solid.distance(link.com) / solid.size


def _spread_beyond(link: DescribedLink, solid: Solid) -> float:
    return _squared_spread(link) / float(((solid.points - link.com) ** 2).sum(axis=1).max())


def _squared_spread(link: DescribedLink) -> float:
    """Mean squared distance of a link's mass from its centre [m²]."""
    return 0.5 * float(np.trace(link.inertia)) / float(link.mass or 1.0)


def _millimetres(squared: float) -> str:
    return f"{1e3 * math.sqrt(squared):.3g} mm"


def missing_meshes(robot: DescribedRobot) -> Iterator[Finding]:
    """Meshes that are named and not there: the links have no shape to check."""
    files = [name for names in robot.missing.values() for name in names]
    if files:
        said = (
            f"meshes of {count(len(robot.missing), 'link')} are not there: {list_names(sorted({*files}), 3)}"
        )
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


SHAPE_RULES = (density, com_outside, inertia_scale, missing_meshes)


# What links and joints say of each other: copies, left and right, limits, and drives that hold what they
# carry.

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
