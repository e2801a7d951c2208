"""What a first description assumed about a robot's build, by consequence."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.finding import first_names
from excite.robot.description import Assumed
from excite.robot.scaffold.held import Held
from excite.robot.scaffold.limbs import Figure
from excite.robot.scaffold.rest import Rest
from excite.robot.shapes.ground import links_below
from excite.robot.shapes.shape import shape_points
from excite.shown import count

FRICTION = 0.5
"""Friction of soles that nobody stated: rubber on a dusty floor has 0.5 … 0.8."""


def assumed_structure(
    held: dict[str, Held],
    faults: dict[str, str],
    geometry: str | None,
    rest: Rest,
    ground: float | None,
    figure: Figure,
    ranged: tuple[str, ...] = (),
    unlimited: tuple[str, ...] = (),
) -> list[Assumed]:
    """Joints held or kept in a range, inertia, geometry and ground (or soles' friction) as they were assumed."""
    found = held_still(held)
    if ranged:
        found.append(
            Assumed(
                what="joints called continuous that do not turn on and on",
                value=first_names(ranged),
                consequence="the limits that the model states of them are kept: state limits.position if they are none",
            )
        )
    if unlimited:
        found.append(
            Assumed(
                what="position limits of joints that turn without end",
                value=f"half a turn either way: {first_names(unlimited)}",
                consequence="nothing stops the joint there: state limits.position, and wider ones if cables allow",
            )
        )
    if faults:
        found.append(
            Assumed(
                what="inertia as the model has it",
                value=first_names(list(faults)),
                consequence="missing or impossible there: torques predicted for them are a guess",
            )
        )
    block = figure.robot.description.collision
    boxes = [shape.link for shape in block.shapes if shape.link in block.stand_ins]
    if boxes:
        why = f" ({geometry[:150]})" if geometry else ""
        found.append(
            Assumed(
                what=f"geometry of {count(len(boxes), 'link')}",
                value=f"boxes of their own inertia, as large as their mass: {first_names(boxes)}",
                consequence=f"collisions of these are checked roughly: theirs is not there or cannot be used{why}; "
                "give --package-path FOLDER, where meshes are, or collision.shapes",
            )
        )
    if spread := _spread_links(figure):
        found.append(
            Assumed(
                what="moments of inertia that no body of a link's size has",
                value=first_names(
                    [f"{link} ({gyration:.3g} m, {reach:.3g} m)" for link, gyration, reach in spread]
                ),
                consequence=(
                    "radius of gyration, and how far its shapes reach from its centre of mass: with moments in another "
                    "unit, torques and acceleration limits are far off; correct the model"
                ),
            )
        )
    shaped = {shape.joint for shape in figure.shapes}
    bare = [segment.link for segment in figure.robot.segments if segment.joint not in shaped]
    if bare:
        found.append(
            Assumed(
                what="links without geometry",
                value=first_names(bare),
                consequence="nothing checks what they touch: give them <collision>, or collision.shapes",
            )
        )
    if ground is not None:
        margin = figure.robot.description.collision.margin
        below = links_below(figure.model, figure.shapes, rest.q, ground, margin)
        more = f"; excepted: {', '.join(below)}" if below else ""
        found.append(
            Assumed(
                what="ground",
                value=f"a plane at {ground:.3f} m of the base's frame",
                consequence=(
                    f"hold the robot so high that this is its floor: nothing it may reach touches it{more}"
                    if rest.base == "held"
                    else f"motions stay above it: state collision.table_height if it is elsewhere{more}"
                ),
            )
        )
    else:
        found.append(
            Assumed(
                what="friction of soles",
                value=f"{FRICTION}",
                consequence="feet may slip on a floor that is smoother",
            )
        )
    return found


def _spread_links(figure: Figure) -> list[tuple[str, float, float]]:
    """Links whose radius of gyration is larger than the farthest of their shapes is from their centre of mass [m].

    Wherever within its shapes a body's mass lies, no moment is more than the mass times that distance squared. Of 405
    links of 33 published models 393 keep that, 380 with less than 0.8 of the distance; eight break it by up to 2.4, and
    the four of a pair of hands that stands in kg·cm² by 23 to 37.
    """
    found = []
    for segment, ten in zip(
        figure.robot.segments, figure.robot.nominal_parameters.reshape(-1, 10), strict=True
    ):
        own = [shape for shape in figure.shapes if shape.joint == segment.joint]
        if any(shape.link in figure.robot.description.collision.stand_ins for shape in own):
            continue
        corners = [shape_points(shape) for shape in own]
        body = pin.Inertia.FromDynamicParameters(ten)
        if not corners or body.mass <= 0.0:
            continue
        reach = float(np.linalg.norm(np.vstack(corners) - body.lever, axis=1).max())
        gyration = float(np.sqrt(max(np.linalg.eigvalsh(body.inertia)[-1], 0.0) / body.mass))
        if gyration > reach:
            found.append((segment.link, gyration, reach))
    return sorted(found, key=lambda one: one[1] / one[2], reverse=True)


def held_still(held: dict[str, Held]) -> list[Assumed]:
    """Joints that do not move, those of one reason together."""
    found = []
    for why in sorted({one.why for one in held.values()}):
        names = [name for name, one in held.items() if one.why == why]
        found.append(
            Assumed(
                what=f"{len(names)} joint{'s' * (len(names) > 1)} held still ({why})",
                value=first_names(names),
                consequence="their links count as part of what carries them; hold them so at the robot",
            )
        )
    return found
