"""The trials of a standing robot: motions of the toolkit's own generators, found safe, at a calm pace."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.errors import NoSolutionError
from excite.motion.generators.bodyparts import leg_joints
from excite.motion.generators.registry import make_generator
from excite.motion.motion import Motion, interpolate_motion
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.filter import filter_candidate

RATE_HZ = 100.0
_SHORTEST_S, _LONGEST_S = 7.0, 17.0
_TRIES = 12
# Planned motions use all that the limits allow; a laboratory runs them slower.
_PACE = {"random_joint": (0.55, 0.75), "fourier": (0.7, 1.0), "squat": (0.55, 0.75), "leg_swing": (0.8, 0.95)}
# One trial a row: generators to choose from.
_STANDING, _SQUATTING, _SWINGING = ("random_joint", "fourier"), ("squat",), ("leg_swing",)


def session_programme(robot: Robot, rng: np.random.Generator) -> tuple[tuple[Motion, ...], int]:
    """Motions of a session, each at least seven seconds long.

    Args:
        robot: a robot with two feet.
        rng: source of all that is drawn.

    Returns:
        Identification motions, then validation motions, and how many of the latter there are.

    Raises:
        NoSolutionError: no safe motion was found.
    """
    first, second = rng.permutation(2)
    # Now and then the same leg swings in both trials.
    legs = (int(first), int(first if rng.random() < 0.2 else second))
    tasks = [
        (_STANDING, None),
        (_SQUATTING, None),
        (_SWINGING, legs[0]),
        (_SWINGING, legs[1]),
        (_STANDING if rng.random() < 0.5 else _SQUATTING, None),
        (_SWINGING, int(rng.integers(2))),
    ]
    trials = [_build_trial(robot, names, leg, rng) for names, leg in tasks]
    return tuple(motion.renamed(f"trial_{k:02d}") for k, motion in enumerate(trials)), 2


def _build_trial(robot: Robot, names: tuple[str, ...], leg: int | None, rng: np.random.Generator) -> Motion:
    pieces: list[Motion] = []
    while sum(piece.duration for piece in pieces) < _SHORTEST_S:
        pieces.append(_build_piece(robot, str(rng.choice(names)), leg, rng))
    return _join_pieces(pieces)


def _build_piece(robot: Robot, name: str, leg: int | None, rng: np.random.Generator) -> Motion:
    generator = make_generator(name)
    aims = generator.aims(robot)
    if leg is not None:
        aims = tuple(robot.joint_names[i] for i in leg_joints(robot, robot.feet[leg]))
    for _ in range(_TRIES):
        seed, target = int(rng.integers(1 << 53)), str(rng.choice(aims))
        pace = float(rng.uniform(*_PACE[name]))
        motion = filter_candidate(robot, generator.draw(robot, seed, (target,), name)).motion
        if motion is None or motion.duration > pace * _LONGEST_S:
            continue
        slow = _slow_motion(robot, motion, pace)
        if check_motion(robot, slow).safe:
            return slow
    raise NoSolutionError(
        f"{_TRIES} candidates of {name!r} for {robot.name} were all unsafe", remedy="take another seed"
    )


def _slow_motion(robot: Robot, motion: Motion, pace: float) -> Motion:
    slow = replace(motion, time=motion.time / pace, v=motion.v * pace, a=motion.a * pace**2)
    time = slow.time[0] + np.arange(int(slow.duration * RATE_HZ) + 1) / RATE_HZ
    return interpolate_motion(slow, robot, time)


def _join_pieces(pieces: list[Motion]) -> Motion:
    """Pieces that all start and end at rest in the same posture, one after the other."""
    starts = np.cumsum([0.0, *(piece.duration + 1.0 / RATE_HZ for piece in pieces)])
    times = [piece.time - piece.time[0] + start for piece, start in zip(pieces, starts, strict=False)]
    names = pieces[0].contacts
    return replace(
        pieces[0],
        time=np.concatenate(times),
        q=np.vstack([piece.q for piece in pieces]),
        v=np.vstack([piece.v for piece in pieces]),
        a=np.vstack([piece.a for piece in pieces]),
        contacts={name: np.concatenate([piece.contacts[name] for piece in pieces]) for name in names},
    )
