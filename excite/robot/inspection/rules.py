"""Rules by which a robot's description is judged: inertias, shapes, comparison of links, slips of unit and sign."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import cast

import numpy as np

from excite.arrays import Array
from excite.display import count
from excite.finding import Finding, Severity, list_names
from excite.robot.init_robot.first_guesses import mirror_names
from excite.robot.inspection.links import DescribedJoint, DescribedLink, DescribedRobot, Solid
from excite.robot.quantities import MAX_TRAVEL, looks_like_degrees
from excite.robot.urdf.inertia import TOLERANCE, moments_fault, symmetric_matrix
from excite.robot.urdf.writing import MOMENTS

# Inertias that no body has, and the smallest correction that makes one of them possible.

# Where the six numbers of a URDF stand in what was written in another order.
_ORDERS = {
    "in MJCF's order, ixx iyy izz ixy ixz iyz": (0, 3, 4, 1, 5, 2),
    "in URDF's order, ixx ixy ixz iyy iyz izz": (0, 3, 5, 1, 2, 4),
    "its lower triangle row by row, ixx ixy iyy ixz iyz izz": (0, 1, 3, 2, 4, 5),
}


def impossible_inertia(robot: DescribedRobot) -> Iterator[Finding]:
    """Principal moments are positive, and none is larger than the other two together (triangle inequality)."""
    for link in robot.links.values():
        if not link.stated.any():
            continue
        place = (link.name,)
        if link.mass < 0.0:
            said, better = f"its mass is {link.mass:g} kg", f'value="{-link.mass:g}"'
            yield Finding("not_positive", said, {"mass": link.mass}, place, "spoils", remedy=better)
        moments, axes = np.linalg.eigh(link.moments)
        excess, severity, kind = moments[2] - moments[0] - moments[1], "spoils", moments_fault(moments)
        if kind == "not_positive":
            figures = {"smallest_moment": float(moments[0])}
            said = f"its inertia is not positive definite: the smallest principal moment is {moments[0]:.3g} kg·m²"
        elif kind:
            figures = {"excess_percent": float(100.0 * excess / moments[2])}
            # Digits that were not written move a principal moment by at most the norm of a matrix of half-steps.
            slack = TOLERANCE * abs(moments[2]) + 3.0 * link.step
            # Rounding to few digits breaks the inequality by less than this share.
            rounded = excess <= min(slack, 0.01 * moments[2])
            severity = "note" if rounded or robot.is_weightless(link) else "spoils"
            said = (
                f"its inertia breaks the triangle inequality by {figures['excess_percent']:.2g} %: the principal moment"
                f" {moments[2]:.4g} about ({numbers_in_words(axes[:, 2])}), nearest"
                f" {'xyz'[int(np.abs(axes[:, 2]).argmax())]}, is more than the sum"
                f" {moments[0]:.4g} + {moments[1]:.4g} kg·m² of the other two{', by rounding' * bool(rounded)}"
            )
        else:
            continue
        words, six = _better_inertia(link, robot.first_hull(link.name))
        six = _without_traces(six)
        values = " ".join(f'{name}="{value:.6g}"' for name, value in zip(MOMENTS, six, strict=True))
        yield Finding(kind, said, figures, place, cast(Severity, severity), remedy=f"{words}: {values}")


def _better_inertia(link: DescribedLink, solid: Solid | None) -> tuple[str, Array]:
    """The smallest correction that makes an inertia possible, as the six numbers to write.

    Where the nearest possible one is far, the numbers may stand in another order, or one of them has lost its sign or
    decimal point: of those readings that are possible, the one nearest to a body of even density.
    """
    six = link.stated
    nearest = "the nearest inertia that a body can have", nearest_inertia(six)
    # The nearest possible inertia is the correction where it is this near; farther off, other readings are tried.
    if np.linalg.norm(nearest[1] - six) <= 0.2 * np.linalg.norm(six):
        return nearest
    even = np.zeros(6)
    if solid is not None and link.weight:
        covariance = link.axes.T @ solid.spread @ link.axes * link.weight
        even = (np.trace(covariance) * np.eye(3) - covariance)[np.triu_indices(3)]
    found = [(words, reading) for words, reading in _possible_inertias(six, even) if is_possible(reading)]
    if not found or not even.any():
        return found[0] if found else nearest
    # How far diagonals are from the even body's; a hundredth of a factor of e for each place in the list besides.
    shares = [np.log(np.abs(reading[[0, 3, 5]] / even[[0, 3, 5]]) + 1e-300) for _, reading in found]
    off = [float(np.linalg.norm(share)) + 0.01 * place for place, share in enumerate(shares)]
    # A reading of an inertia is believed within this factor of the shape's.
    return nearest if min(off) > math.log(10.0) else found[int(np.argmin(off))]


def _possible_inertias(six: Array, even: Array) -> Iterator[tuple[str, Array]]:
    """What six numbers may have been meant to be; ``even`` is the inertia of the shape, zeros where it has none."""
    if math.isclose(six[1], six[3], rel_tol=1e-6, abs_tol=1e-12):
        # izz was the ninth number and is not there: as of the shape, else of a body as thick as it is wide.
        lost = max(six[0], six[4])
        if even.any():
            lost = even[5] * (six[0] + six[4]) / (even[0] + even[3])
        words = "a 3 × 3 written row by row; its ninth number, izz, is lost and estimated"
        yield words, np.array([*six[[0, 1, 2, 4, 5]], lost])
    for words, order in _ORDERS.items():
        yield words, six[list(order)]
    for index, name in enumerate(MOMENTS):
        yield f"sign lost of {name}", six * np.where(np.arange(6) == index, -1.0, 1.0)
    yield "signs lost of all products of inertia", six * [1.0, -1.0, -1.0, 1.0, -1.0, 1.0]
    yield "signs lost of all moments", six * [-1.0, 1.0, 1.0, -1.0, 1.0, -1.0]
    # Without a shape any digit may be the lost one.
    for index, name in enumerate(MOMENTS if even.any() else ()):
        for factor in (0.1, 10.0, 0.01, 100.0, 1e-3, 1e3):
            yield f"a decimal point lost in {name}", six * np.where(np.arange(6) == index, factor, 1.0)


def is_possible(six: Array) -> bool:
    """Whether a body can have the inertia of ixx, ixy, ixz, iyy, iyz, izz ``(6,)`` [kg·m²]."""
    moments = np.linalg.eigvalsh(symmetric_matrix(six))
    return bool(moments[0] > 0.0) and not moments_fault(moments)


def nearest_inertia(six: Array) -> Array:
    """The inertia nearest to one that no body can have, in the Frobenius norm.

    It has the same principal axes, and the moments nearest to the stated ones that are sums of two second moments which
    are not negative, L = ½ tr(I) − I, as the triangle inequality asks.

    Args:
        six: ixx, ixy, ixz, iyy, iyz, izz ``(6,)`` [kg·m²].

    Returns:
        The same six of the nearest ``(6,)`` [kg·m²].
    """
    from scipy.optimize import nnls

    moments, axes = np.linalg.eigh(symmetric_matrix(six))
    sums = np.ones((3, 3)) - np.eye(3)
    # A hair inside, so that rounding to six digits does not break it again.
    # What six digits round away.
    best = sums @ nnls(sums, moments)[0] + 1e-5 * np.abs(moments).max()
    return np.asarray((axes * best @ axes.T)[np.triu_indices(3)])


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


_LENGTHS = {
    0.1: "a decimal point",
    0.01: "centimetres for metres",
    1e-3: "millimetres for metres",
    10.0: "a decimal point",
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
    return " ".join(f"{value:.4g}" for value in _without_traces(values))


def _without_traces(values: Array) -> Array:
    """Numbers, of which those that only rounding left beside the largest are zero."""
    return np.where(np.abs(values) < 1e-6 * np.abs(values).max(), 0.0, values)


# What a link's mass, centre and inertia say of its shape: no body is denser than metal, or lies beside
# itself.

# Osmium, the densest there is; and copper: of 408 links of published models none is denser than 7 700 kg/m³.
_DENSEST, _COPPER = 22_600.0, 8_960.0
# Light foam, of which the lightest of these links is not, with 15 kg/m³; and water.
_FOAM, _WATER = 10.0, 1e3
# A centre of mass may lie this share of its shape's size beside it, since collision solids are drawn roughly: of these
# links one in a hundred does, by up to 0.13, and one whose sign was lost by 0.3.
_SLACK, _FAR = 0.05, 0.15
# How far beyond its shape's farthest corner an inertia is a slip of unit; identified ones are up to 6 times beyond.
_SLIPPED = 30.0


def check_density(robot: DescribedRobot) -> Iterator[Finding]:
    """Mass over the volume of the link's shape: nothing is denser than osmium, and no link as light as foam."""
    found = {
        link.name: link.weight / own.volume
        for link in robot.weighty_links()
        if (own := robot.own_hull(link.name)) is not None
    }
    median = float(np.median([*found.values()])) if found else _WATER
    # Power of ten by which the masses of most links are too large.
    slip = 1.0 if _FOAM <= median <= _COPPER else 10.0 ** round(math.log10(median / _WATER))
    hulls = [
        (link, solid) for link in robot.weighty_links() if (solid := robot.first_hull(link.name)) is not None
    ]
    sound = [share for link, solid in hulls if _FOAM < (share := link.weight / solid.volume) < _COPPER]
    for link in robot.links.values():
        own = robot.own_hull(link.name) if link.weight else None
        # A power of ten of next to nothing was put in only so that there is a mass, as frames have.
        if own is None or (robot.is_weightless(link) and math.log10(link.weight).is_integer()):
            continue
        light = link.weight / own.volume
        dense = _least_over_hulls(robot, link, _COPPER, lambda link, solid: link.weight / solid.volume)
        if light < _FOAM:
            value, than, sure = light, "lighter than foam", 0.7
        elif dense > _DENSEST:
            value, than, sure = dense, "denser than any metal", 1.0
        elif dense > _COPPER:
            value, than, sure = dense, "denser than solid copper", 0.8
        else:
            continue
        litres = 1e3 * link.weight / value
        said = f"{link.weight:.3g} kg in {litres:.3g} litres are {value:.2g} kg/m³, {than}"
        remedy = "correct the mass, or the size of its shape"
        if slip != 1.0:
            remedy = f"all masses × {1.0 / slip:g}" + slip_in_words(slip)
        # No link of a robot takes a thousand cubic metres [litres].
        elif litres > 1e6:
            remedy = 'its shape is in millimetres: write scale="0.001 0.001 0.001"'
        elif sound:
            usual = float(np.median(sound))
            better = by_factor("mass", link.weight, usual / value)
            remedy = f"{better}, at the {usual:.2g} kg/m³ of its other links"
        yield Finding("density", said, {"density": value}, (link.name,), "spoils", sure, remedy=remedy)


def com_outside(robot: DescribedRobot) -> Iterator[Finding]:
    """No body's centre of mass lies outside the convex hull of its matter."""
    for link in robot.weighty_links():
        own = robot.first_hull(link.name)
        if own is None:
            continue
        at_frame = not link.centre.any()
        share = own.distance_outside(link.centre) / own.size
        if not at_frame:
            most = _SLACK if robot.thorough else _FAR
            share = _least_over_hulls(
                robot, link, most, lambda link, solid: solid.distance_outside(link.centre) / solid.size
            )
        if share <= _SLACK:
            continue
        outside, sure = share * own.size, 0.9 if share > _FAR and not at_frame else 0.6
        said = (
            f"its centre of mass ({numbers_in_words(link.centre)}) m lies {outside:.2g} m outside its shape"
        )
        said += ": it was left at the link's frame" * at_frame
        words, better = next(
            (
                (words, com)
                for words, com in _com_readings(link.centre, own.size)
                if own.distance_outside(com) < 0.0
            ),
            ("the nearest point of its shape", own.nearest_point(link.centre)),
        )
        remedy = f'{words}: xyz="{numbers_in_words(better)}"'
        severity: Severity = "spoils" if sure > 0.6 else "limits"
        yield Finding(
            "com_outside", said, {"outside_m": outside}, (link.name,), severity, sure, remedy=remedy
        )


def _com_readings(com: Array, size: float) -> Iterator[tuple[str, Array]]:
    """What a centre of mass outside a shape of a size [m] may have been meant to be, the least change first."""
    for n in (1, 2, 3):
        for axes in itertools.combinations(range(3), n):
            words = " and ".join("xyz"[i] for i in axes)
            yield f"sign lost of {words}", np.where(np.isin(range(3), axes), -com, com)
    for factor, words in _LENGTHS.items():
        # A point that is near the frame anyway is no slip of unit.
        if max(factor, 1.0) * float(np.linalg.norm(com)) > size * min(1.0, 0.1 / factor):
            yield words, com * factor
    for order in itertools.permutations(range(3)):
        yield f"components exchanged, as {''.join('xyz'[i] for i in order)}", com[list(order)]


def inertia_scale(robot: DescribedRobot) -> Iterator[Finding]:
    """How far the mass is spread: not beyond its shape, and not as if it all were in one point of it."""
    for link in robot.weighty_links():
        own = robot.first_hull(link.name)
        if own is None or not is_possible(link.stated):
            continue
        outside = own.distance_outside(link.centre) > 0.0
        squared, even = _squared_spread(link), float(np.trace(own.spread))
        beyond = _least_over_hulls(
            robot,
            link,
            1.0 if robot.thorough and not outside else _SLIPPED,
            lambda link, solid: _squared_spread(link) / ((solid.points - link.centre) ** 2).sum(axis=1).max(),
        )
        # Of a centre that is wrong itself, less than a slip of unit tells nothing.
        if outside and beyond <= _SLIPPED:
            continue
        said = f"its inertia spreads its mass over a radius of {_in_millimetres(squared)}"
        if beyond > 1.0:
            said += (
                f", beyond its shape, which ends {_in_millimetres(squared / beyond)} from its centre of mass"
            )
        # Share of an even body's inertia below which one stands for a point; the least of these links has 0.04.
        elif squared < 1e-2 * even:
            said += f", where an even body of its shape has {_in_millimetres(even)}"
        else:
            continue
        slip, remedy = beyond > _SLIPPED, by_factor("inertia", None, even / squared)
        severity: Severity = "spoils" if slip else "limits"
        figures, sure = {"of_even_body": squared / even}, 0.9 if slip else 0.6
        yield Finding("inertia_scale", said, figures, (link.name,), severity, sure, remedy=remedy)


def _least_over_hulls(
    robot: DescribedRobot, link: DescribedLink, most: float, measure: Callable[[DescribedLink, Solid], float]
) -> float:
    """The least of a measure over the hulls that a link may be; no further one is made once it is within ``most``."""
    least = math.inf
    for solid in robot.link_hulls(link.name):
        least = min(least, measure(link, solid))
        if least <= most:
            break
    return least


def _squared_spread(link: DescribedLink) -> float:
    """Mean squared distance of a link's mass from its centre [m²]."""
    return 0.5 * float(np.trace(link.moments)) / link.weight


def _in_millimetres(squared: float) -> str:
    return f"{1e3 * math.sqrt(squared):.3g} mm"


def missing_shapes(robot: DescribedRobot) -> Iterator[Finding]:
    """Meshes that are named and not there, and bodies of weight that name none: nothing checks what they touch."""
    files = [name for names in robot.missing.values() for name in names]
    if files:
        links, figures = count(len(robot.missing), "link"), {"files": float(len(files))}
        said = f"meshes of {links} are not there: {list_names(sorted({*files}), 3)}"
        remedy = (
            "put them where the model says, or give `excite init-robot --package-path FOLDER`, where they are"
        )
        yield Finding("missing_meshes", said, figures, tuple(robot.missing), "limits", remedy=remedy)
    named = {*robot.missing, *robot.shaped, *(place for fault in robot.faults for place in fault.places)}
    weighty = [link for link in robot.weighty_links() if link.name not in named] if robot.thorough else []
    if bare := tuple(link.name for link in weighty if robot.first_hull(link.name) is None):
        said = f"{count(len(bare), 'link')} of weight without a shape: nothing checks what they touch"
        remedy = "give them collision geometry"
        yield Finding("no_shape", said, {"links": float(len(bare))}, bare, "limits", remedy=remedy)


# What links and joints say of each other: copies, left and right, limits, and drives that hold what they
# carry.

_ALIKE = ", the same about every axis"
# Twins of published models differ by a few per cent in mass; beyond that, and half their size, they are gross.
_TWIN, _TWIN_INERTIA, _GROSS = 1.02, 1.5, 0.5
# Known robots' limbs weigh at most twice what their drives hold.
_HOLDS = 4.0


def find_placeholders(robot: DescribedRobot) -> Iterator[Finding]:
    """Inertials that were put in for want of better: the same on links of different shape, or a unit's multiple."""
    bodies = list(robot.weighty_links())
    groups: dict[str, list[DescribedLink]] = {}
    for link in bodies:
        xx, xy, xz, yy, yz, zz = link.stated
        alike = _ALIKE * bool(xx == yy == zz and not (xy or xz or yz))
        groups.setdefault(f"the moments {xx:g} {yy:g} {zz:g} kg·m²{alike}", []).append(link)
        if link.mass == 1.0:
            groups.setdefault("the mass 1 kg", []).append(link)
    for what, links in groups.items():
        sizes = [solid.size for link in links if (solid := robot.own_hull(link.name)) is not None]
        # Links whose sizes differ so far are no copies of each other.
        differ = len(sizes) > 1 and max(sizes) > 1.5 * min(sizes)
        masses = len({link.mass for link in links}) > 1
        # Of three reasons to think of a copy, two.
        if len(links) < 3 - differ or not (differ or (_ALIKE in what) + masses + (not sizes) > 1):
            continue
        why = f", though their {'shapes' if differ else 'masses'} differ" * (differ or masses)
        said = f"{len(links)} links share {what}{why}: copied, not measured"
        severity: Severity = "spoils" if 2 * len(links) > len(bodies) else "limits"
        names, figures = tuple(link.name for link in links), {"links": len(links)}
        remedy = "take masses and inertias from CAD, or identify them: torques predicted of them are a guess"
        yield Finding("placeholder", said, figures, names, severity, 0.8, remedy=remedy)


def find_asymmetry(robot: DescribedRobot) -> Iterator[Finding]:
    """Left and right are mirror images: masses, centres and inertias of twins whose frames mirror each other."""
    pairs = []
    for left in robot.weighty_links():
        twins = (robot.links.get(name) for name in mirror_names(left.name) if name != left.name)
        right = next((twin for twin in twins if twin and twin.weight and twin.pose is not None), None)
        if right is not None and left.pose is not None and right.pose is not None:
            pairs.append((left, right, left.pose, right.pose))
    if not pairs:
        return
    # The plane across which most twins mirror each other with all joints at zero.
    places = np.array([[here.translation, there.translation] for *_, here, there in pairs])
    signs = 1.0 - 2.0 * np.eye(3)
    off = np.linalg.norm(signs * places[:, :1] - places[:, 1:], axis=2)
    mirrored = (np.abs(places[:, 1]) > 1e-3) & (off < 2e-3)
    plane = int(mirrored.sum(axis=0).argmax())
    if 2 * mirrored[:, plane].sum() <= len(pairs):
        return
    for (left, right, here, there), holds in zip(pairs, mirrored[:, plane], strict=True):
        if holds:
            wanted = there.actInv(signs[plane] * here.act(left.centre))
            yield from _twin_difference(robot, left, right, np.asarray(wanted))


def _twin_difference(
    robot: DescribedRobot, left: DescribedLink, right: DescribedLink, wanted: Array
) -> Iterator[Finding]:
    """How twins differ, of which the left one mirrored has its centre of mass at ``wanted`` of the right [m]."""
    hulls = [robot.first_hull(link.name) for link in (left, right)]
    sizes = [solid.size for solid in hulls if solid is not None]
    # Of links without shape, about that of their inertia.
    size = (
        max(sizes) if sizes else max(2.0 * float(np.linalg.norm(one.centre)) for one in (left, right)) + 1e-3
    )
    least, most = sorted((left.weight, right.weight))
    off = float(np.linalg.norm(wanted - right.centre))
    here, there = (np.maximum(np.linalg.eigvalsh(one.moments), 1e-12) for one in (left, right))
    ratio = float(np.exp(np.abs(np.log(here / there)).max()))
    faults = {
        f"masses {left.weight:.4g} and {right.weight:.4g} kg": most > _TWIN * least,
        f"centres of mass {off:.2g} m apart once mirrored": off > (_TWIN - 1.0) * size,
        f"principal moments by a factor of up to {ratio:.3g}": ratio > _TWIN_INERTIA,
    }
    if not any(faults.values()):
        return
    said = f"left and right differ: {', '.join(words for words, holds in faults.items() if holds)}"
    gross = most > (1.0 + _GROSS) * least or off > _GROSS * size
    values = f'mass {left.weight:.4g} and xyz="{numbers_in_words(wanted)}" for {right.name}'
    figures = {"mass_ratio": most / least, "com_m": off, "inertia_ratio": ratio}
    severity: Severity = "spoils" if gross else "note"
    remedy = f"one of them is wrong; {left.name} mirrored gives {values}"
    names = (left.name, right.name)
    yield Finding("asymmetry", said, figures, names, severity, 0.8 if gross else 0.5, remedy=remedy)


def check_limits(robot: DescribedRobot) -> Iterator[Finding]:
    """Limits exchanged, equal, in degrees, or negative."""
    for joint in robot.joints:
        place = (joint.name,)
        if joint.kind != "continuous" and {"lower", "upper"} <= joint.limits.keys():
            low, high = joint.limits["lower"], joint.limits["upper"]
            for kind, said, remedy, severity, sure in _range_faults(joint, low, high):
                figures = {"lower": low, "upper": high}
                yield Finding(kind, said, figures, place, severity, sure, remedy=remedy)
        for name in ("effort", "velocity"):
            value = joint.limits.get(name, 0.0)
            if value < 0.0 and value != -1.0:
                said, better = f"its {name} limit is {value:g}", f'{name}="{-value:g}"'
                yield Finding("limits_negative", said, {name: value}, place, "spoils", remedy=better)


def _range_faults(
    joint: DescribedJoint, low: float, high: float
) -> Iterator[tuple[str, str, str, Severity, float]]:
    """What is wrong with a range: kind, sentence, remedy, severity and how sure that is."""
    if low > high:
        said = f"its lower limit {low:g} is above its upper {high:g}"
        yield "limits_turned", said, f'exchange them: lower="{high:g}" upper="{low:g}"', "spoils", 1.0
    elif low == high:
        remedy = "state its range, or make it fixed; until then it is held there"
        yield "limits_equal", f"its limits are both {low:g}: it cannot move", remedy, "limits", 1.0
    elif joint.kind == "revolute" and (looks_like_degrees(low) or looks_like_degrees(high)):
        remedy = f'write radians: lower="{math.radians(low):.4g}" upper="{math.radians(high):.4g}"'
        yield "limits_degrees", f"its limits {low:g} … {high:g} are degrees", remedy, "spoils", 0.9
    elif joint.kind == "prismatic" and MAX_TRAVEL < max(-low, high) <= 1e3 * MAX_TRAVEL:
        yield "limits_millimetres", f"it slides from {low:g} to {high:g} m", "write metres", "limits", 0.8


def total_mass(robot: DescribedRobot) -> Iterator[Finding]:
    """Whole robots have a mass that their drives can hold."""
    if any(True for _ in check_density(robot)):
        return
    worst, place, load = 0.0, "", 0.0
    for joint in robot.joints:
        start, effort = robot.links.get(joint.child), joint.limits.get("effort", 0.0)
        if joint.kind == "prismatic" or not effort or start is None or start.pose is None:
            continue
        beyond = [
            (link.weight, link.pose.act(link.centre))
            for link in robot.links.values()
            if link.weight and link.pose is not None and joint.name in robot.tree.above(link.name)
        ]
        mass = sum(weight for weight, _ in beyond)
        # Moment of the weights about the joint, level at worst.
        arms = [weight * (centre - start.pose.translation) for weight, centre in beyond]
        lever = np.cross(start.pose.rotation @ joint.axis, sum(arms, start=np.zeros(3)))
        share = 9.81 * float(np.linalg.norm(lever)) / effort
        if share > worst:
            worst, place, load = share, joint.name, mass
    if worst > _HOLDS:
        said = f"the {load:.3g} kg beyond it weigh {worst:.2g} times what its drive can hold"
        severity: Severity = "spoils" if worst > 10.0 * _HOLDS else "limits"
        remedy, figures = "correct the masses, or its effort limit", {"weight_over_effort": worst}
        remedy += slip_in_words(worst / _HOLDS)
        yield Finding("total_mass", said, figures, (place,), severity, 0.7, remedy=remedy)


RULES: tuple[Callable[[DescribedRobot], Iterator[Finding]], ...] = (
    impossible_inertia,
    check_density,
    com_outside,
    inertia_scale,
    missing_shapes,
    find_placeholders,
    find_asymmetry,
    check_limits,
    total_mass,
)
