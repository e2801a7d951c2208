"""The one change most likely to help: what refuses candidates is lifted, and those that then pass are counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from excite.motion.motion import Motion
from excite.parallel.jobs import Jobs
from excite.robot.description import UncertaintyBlock
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE
from excite.safety.filter import Filtered, filter_candidates
from excite.safety.refusals import Refused, Remedy

# Refused candidates that are tried again with each change, and changes that are tried: some 30 candidates' work at
# most, beside the 140 that a plan generates.
TRIED = 8
_CHANGES = 3
# How often refusals that come to light are lifted too: pairs that always touch are few, or the posture is wrong.
_ROUNDS = 4
# Beyond any drive: in rad and s, or m and s, and N·m or N.
_UNLIMITED = {"velocity": 20.0, "acceleration": 100.0, "jerk": 1e4, "torque": 1e4}
# Soles whose corners lie this much further out [m]: no posture of a standing robot leaves these.
_LARGER_M = 0.5
_MORE_FRICTION = 10.0


Lift = Callable[[Robot, tuple[str, ...]], Robot]


def find_remedy(
    robot: Robot,
    refused: Sequence[Refused],
    candidates: Sequence[Filtered],
    *,
    jobs: Jobs = 1,
    robust: bool = False,
) -> Remedy | None:
    """The change with which most refused candidates pass, counted by trying.

    Each of the commonest refusals is lifted alone, then all of the commonest reason together. A change that
    cannot be tried, because no entry of ``robot.yaml`` says it (legs that do not reach), is none.

    Args:
        robot: the robot.
        refused: what refuses its candidates, the commonest first.
        candidates: refused ones.
        jobs: number of processes, or an executor; the answer does not depend on it.
        robust: whether they shall hold for all robots of the set that the description states.

    Returns:
        The change; None if no change lets any of them pass.
    """
    best: Remedy | None = None
    for group in _refusal_groups(refused) if candidates else []:
        tried = _try_remedy(robot, group, candidates, jobs, robust)
        if tried is not None and tried.passes > (0 if best is None else best.passes):
            best = tried
    return best


def _try_remedy(
    robot: Robot,
    group: tuple[Refused, ...],
    candidates: Sequence[Filtered],
    jobs: Jobs,
    robust: bool,
) -> Remedy | None:
    """Candidates tried without some refusals; None where these cannot be lifted.

    Candidates are given up at the first pair that touches, so that others come to light only once that is lifted:
    where all of a reason go together, these go too.
    """
    for _ in range(_ROUNDS):
        lifted = _lift_refusal(robot, group)
        if lifted is None:
            return None
        report = filter_candidates(lifted, candidates, jobs=jobs, keep=_keep_nothing, robust=robust)
        passes = report.generated - sum(report.rejected.values())
        more = tuple(item for item in report.refused if item.reason == group[0].reason)
        if passes or len(group) == 1 or not more:
            break
        group += more
    places = tuple(item.where for item in group)
    return Remedy(_in_words(group), group[0].reason, places, passes, len(candidates))


def _keep_nothing(robot: Robot, motion: Motion) -> None:
    """Keeps no motion."""


def _refusal_groups(refused: Sequence[Refused]) -> list[tuple[Refused, ...]]:
    single: list[tuple[Refused, ...]] = [(item,) for item in refused[:_CHANGES]]
    alike = tuple(item for item in refused if item.reason == refused[0].reason) if refused else ()
    return [*single, alike] if len(alike) > 1 else single


def _lift_refusal(robot: Robot, group: Sequence[Refused]) -> Robot | None:
    """A robot that is not refused for this; None where nothing can be lifted."""
    if group[0].reason not in _LIFTS:
        return None
    changed = _LIFTS[group[0].reason][0](robot, tuple(item.where for item in group))
    places = ", ".join(item.where for item in group)
    # Collision geometry is remembered by this.
    return replace(changed, hash=f"{robot.hash}, without {group[0].reason} of {places}")


def _without_pairs(robot: Robot, where: tuple[str, ...]) -> Robot:
    block = robot.description.collision
    pairs = [tuple(pair.split(" - ")) for pair in where]
    links = tuple(pair for pair in pairs if TABLE not in pair)
    ignored = (*block.ignored_pairs, *links)
    changes: dict[str, object] = {"ignored_pairs": ignored}
    if len(links) < len(pairs):
        # A surface that is gone is near nothing.
        changes = {
            "table_height": None,
            "ignored_pairs": tuple(pair for pair in ignored if TABLE not in pair),
        }
    block = block.model_copy(update=changes)
    return replace(robot, description=robot.description.model_copy(update={"collision": block}))


def _without_limit(kind: str) -> Lift:
    def lift(robot: Robot, where: tuple[str, ...]) -> Robot:
        values = getattr(robot.limits, kind).copy()
        values[[robot.joint_names.index(joint) for joint in where]] = max(
            _UNLIMITED[kind], 10.0 * float(np.max(values))
        )
        return replace(robot, limits=replace(robot.limits, **{kind: values}))

    return lift


def _larger_soles(robot: Robot, where: tuple[str, ...]) -> Robot:
    feet = []
    for foot in robot.feet:
        out = foot.sole - foot.sole.mean(axis=0)
        out = out / np.linalg.norm(out, axis=1, keepdims=True)
        feet.append(replace(foot, sole=foot.sole + _LARGER_M * out))
    return replace(robot, feet=tuple(feet))


def _more_friction(robot: Robot, where: tuple[str, ...]) -> Robot:
    return replace(
        robot, feet=tuple(replace(foot, friction=_MORE_FRICTION * foot.friction) for foot in robot.feet)
    )


def _certain(robot: Robot, where: tuple[str, ...]) -> Robot:
    certain = UncertaintyBlock(mass=0.0, com=0.0, inertia=0.0)
    return replace(robot, description=robot.description.model_copy(update={"uncertainty": certain}))


_SOLES = "state the true size of the soles, or a posture.joints with the centre of mass above their middle"
_SMALLER = "state a smaller uncertainty, as an identification leaves it, or plan without --robust"
# By reason: the robot without its limit at some places, and what to do about them in words.
_LIFTS: dict[str, tuple[Lift, str]] = {
    "self_collision": (
        _without_pairs,
        "name {places} in collision.ignored_pairs if they may touch, or change posture.joints",
    ),
    **{
        f"joint_{kind}": (_without_limit(kind), f"raise limits.{kind} of {{places}}, if the drives allow it")
        for kind in _UNLIMITED
    },
    "zmp": (_larger_soles, _SOLES),
    "com": (_larger_soles, _SOLES),
    "friction": (_more_friction, "state the true friction of the feet"),
    **{f"robust_{kind}": (_certain, _SMALLER) for kind in ("joint_torque", "zmp", "friction")},
}
_TABLE = "move {places} apart, lower collision.table_height, or start from another posture.joints"


def _in_words(group: Sequence[Refused]) -> str:
    on_table = any(TABLE in item.where.split(" - ") for item in group)
    words = _TABLE if on_table and group[0].reason == "self_collision" else _LIFTS[group[0].reason][1]
    return words.format(places=", ".join(item.where for item in group))
