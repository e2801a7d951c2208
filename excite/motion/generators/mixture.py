"""The mixture of generators that a plan is made of, and what each of them proposes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from excite.data_tables import read_rows
from excite.errors import RobotError
from excite.motion.generators.generator import Candidate, Generator, Proposal, support_corners
from excite.motion.generators.registry import GENERATORS, make_generator
from excite.robot.robot import Robot
from excite.robot.shapes.shape import has_area


def draw_candidate(robot: Robot, proposal: Proposal) -> Candidate:
    """The candidate that a proposal stands for; raises UnknownNameError."""
    return make_generator(proposal.generator).draw(robot, proposal.seed, proposal.targets, proposal.name)


def plan_candidates(
    robot: Robot,
    count: int,
    seed: np.random.SeedSequence,
    *,
    mix: Mapping[str, float] | None = None,
    targets: Sequence[str] = (),
) -> list[Candidate]:
    """Candidates of several generators, in shares.

    Args:
        robot: the robot.
        count: how many in total.
        seed: the candidates of generator ``name`` come from the child that the registry's order gives it.
        mix: share by generator name; by default a mixture for arms, two feet or more, without or with targets, less
            what does not apply to the robot.
        targets: joints to aim at; each generator takes those that it can aim at, and a generator that can
            aim at none of them is left out. Empty: all joints.

    Returns:
        ``count`` candidates, generator by generator, with unique names.

    Raises:
        UnknownNameError: a generator or a target is unknown.
        RobotError: a generator of ``mix`` does not apply to the robot.
    """
    return [
        draw_candidate(robot, item) for item in plan_proposals(robot, count, seed, mix=mix, targets=targets)
    ]


def plan_proposals(
    robot: Robot,
    count: int,
    seed: np.random.SeedSequence,
    *,
    mix: Mapping[str, float] | None = None,
    targets: Sequence[str] = (),
    beyond: int = 0,
) -> Iterator[Proposal]:
    """What :func:`plan_candidates` draws, not drawn yet; same arguments and errors.

    Of ``count`` proposals those are left out that a plan of ``beyond`` has.
    """
    if beyond:
        known = {item.name for item in plan_proposals(robot, beyond, seed, mix=mix, targets=targets)}
        every = plan_proposals(robot, count, seed, mix=mix, targets=targets)
        return (item for item in every if item.name not in known)
    shares = dict(mix if mix is not None else usual_mix(robot, aimed=bool(targets)))
    for joint in targets:
        robot.joint_index(joint)
    aims = {name: _target_joints(make_generator(name), robot, targets) for name in shares}
    if targets:
        shares = {name: share for name, share in shares.items() if aims[name]}
    numbers = _apportion_counts(np.array(list(shares.values()), dtype=float), count)
    drawn: list[Iterator[Proposal]] = []
    for name, number in zip(shares, numbers, strict=True):
        position = list(GENERATORS).index(name)
        child = np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, position))
        drawn.append(make_generator(name).proposals(robot, int(number), child, aims[name]))
    return chain.from_iterable(drawn)


def usual_mix(robot: Robot, *, aimed: bool) -> dict[str, float]:
    """The shares of a plan for a robot, those left out that do not apply to it; ``aimed`` at some of its joints.

    Raises:
        RobotError: none applies, or its feet have no area between them.
    """
    if robot.feet and not has_area(support_corners(robot, robot.feet)):
        raise RobotError(
            "its feet have no area between them, on which it could stand",
            source=robot.source,
            field="feet",
            remedy="describe more feet or corners, or say that its base is suspended or held",
        )
    stands = "nothing" if not robot.feet else "two feet" if len(robot.feet) <= 2 else "more feet"
    usual = {
        row["generator"]: float(row["share"])
        for row in read_rows(__file__, "mixes.csv")
        if (row["stands_on"], row["aimed"] == "yes") == (stands, aimed)
    }
    shares = {name: share for name, share in usual.items() if make_generator(name).applies(robot)}
    if not shares:
        needs = "; ".join(f"{name}: {make_generator(name).needs}" for name in usual)
        raise RobotError(
            f"no generator of motions applies to it ({needs})",
            source=robot.source,
            field="feet",
            remedy="say that its base is suspended or held",
        )
    return shares


def _target_joints(generator: Generator, robot: Robot, targets: Sequence[str]) -> tuple[str, ...]:
    if not targets or not generator.applies(robot):
        return ()
    possible = generator.aims(robot)
    return tuple(joint for joint in targets if joint in possible)


def _apportion_counts(shares: np.ndarray, count: int) -> np.ndarray:
    """Whole numbers in proportion to ``shares`` that add up to ``count`` (largest remainders)."""
    exact = count * shares / shares.sum()
    numbers = np.floor(exact).astype(int)
    order = np.argsort(-(exact - numbers), kind="stable")
    numbers[order[: count - int(numbers.sum())]] += 1
    return np.asarray(numbers)
