"""What a link's mass, centre and inertia say of its shape: no body is denser than metal, or lies beside itself."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np

from excite.arrays import Array
from excite.finding import Finding, list_names
from excite.robot.inspection.inertia_rules import is_possible
from excite.robot.inspection.links import DescribedLink, DescribedRobot, Solid
from excite.robot.inspection.slips import by_factor, numbers_in_words, slip_in_words
from excite.shown import count

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
