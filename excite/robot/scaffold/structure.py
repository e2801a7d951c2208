"""What a first description assumed about a robot's build, by consequence."""

from __future__ import annotations

from excite.finding import first_names
from excite.robot.description import Assumed
from excite.robot.scaffold.held import Held
from excite.robot.scaffold.limbs import Figure
from excite.robot.scaffold.rest import Rest
from excite.robot.shapes.ground import links_below

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
    if faults:
        found.append(
            Assumed(
                what="inertia as the model has it",
                value=first_names(list(faults)),
                consequence="missing or impossible there: torques predicted for them are a guess",
            )
        )
    if geometry is not None:
        found.append(
            Assumed(
                what="geometry",
                value="boxes of the links' own inertia",
                consequence=(
                    "no longer than their joints say; collisions are checked roughly: the model's geometry cannot be "
                    f"used ({geometry[:150]})"
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
