"""One standing case: its log and what is hidden in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.blind.floating.draw import FloatingDraft
from excite.blind.floating.magnitudes import MAKERS, Hidden
from excite.blind.floating.record import trial_of
from excite.blind.floating.site import Site
from excite.blind.floating.stand import Stand, stand_of
from excite.blind.floating.truth import Truth, truth_of
from excite.blind.floating.visible import Yardstick
from excite.blind.hidden import Answer
from excite.logs.log import Log, Trial
from excite.simulation.recording import Recording

# An effect is drawn again, larger, until it stands out as much.
_CLEAR, _DRAWS, _GROWTH = 0.6, 6, 1.25


@dataclass(frozen=True, eq=False)
class FloatingCase:
    """A standing case.

    Attributes:
        log: what is diagnosed.
        answer: what is hidden in it.
        quiet: the same trials without noise, for judging how much of a gap was really closed.
    """

    log: Log
    answer: Answer
    quiet: Log


def build_floating_case(plan: FloatingDraft, rng: np.random.Generator) -> FloatingCase:
    """Simulate one case.

    Args:
        plan: what it is to have.
        rng: source of everything else.

    Raises:
        NoSolutionError: no safe motions were found.
    """
    stand = stand_of(plan.robot, plan.sensors, plan.fixed, plan.noise, rng)
    plain = truth_of(stand)
    recordings = plain.logged()
    truth, hidden = plain, []
    if plan.effects:
        noisy = _logged_trials(stand, recordings, plan.noise, rng)
        yardstick = Yardstick(stand.robot, stand.free, _logged_trials(stand, recordings, 0.0, rng), noisy)
        for k, (effect, form) in enumerate(plan.effects):
            place = _clear_place(plain, yardstick, effect, form, rng)
            truth, what = _hidden_record(truth, effect, form, place.size, place.seed)
            hidden.append(replace(what, detectability=place.clear))
            recordings = place.recordings if k == 0 else truth.logged()
    hidden.sort(key=lambda item: -(item.detectability or 0.0))
    trials = _logged_trials(stand, recordings, plan.noise, rng)
    log = Log(header=stand.header, trials=trials, robot_text=stand.robot.urdf)
    answer = Answer(plan.kind, plan.robot, stand.header.modelled, tuple(hidden), plan.noise)
    return FloatingCase(log, answer, replace(log, trials=_logged_trials(stand, recordings, 0.0, rng)))


@dataclass(frozen=True, eq=False)
class _Place:
    """A drawn effect by itself: its draw, how far it stands out, and what perfect sensors log of it."""

    clear: float
    seed: int
    size: float
    recordings: list[Recording]


def _clear_place(
    plain: Truth, yardstick: Yardstick, effect: str, form: str, rng: np.random.Generator
) -> _Place:
    """The first draw that stands out, or the clearest of several."""
    drawn: list[_Place] = []
    for k in range(_DRAWS):
        seed, size = int(rng.integers(1 << 53)), _GROWTH**k
        recordings = _hidden_record(plain, effect, form, size, seed)[0].logged()
        clear = yardstick.detectability(_logged_trials(plain.stand, recordings, 0.0, rng))
        drawn.append(_Place(clear, seed, size, recordings))
        if clear >= _CLEAR:
            break
    return max(drawn, key=lambda item: item.clear)


def _hidden_record(truth: Truth, effect: str, form: str, size: float, seed: int) -> Hidden:
    return MAKERS[effect](Site(truth, effect, form, size, np.random.default_rng(seed)))


def _logged_trials(
    stand: Stand, recordings: list[Recording], noise: float, rng: np.random.Generator
) -> tuple[Trial, ...]:
    return tuple(
        trial_of(stand.robot, recording, header, noise, rng)
        for recording, header in zip(recordings, stand.header.trials, strict=True)
    )
