"""Short roll-outs of a standing robot's nominal and augmented simulator against the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.result import Rollout
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.spectrum import BAND_HZ
from excite.diagnosis.floating.search.refinement import Fitted, explained_state, refine
from excite.diagnosis.floating.simulator.augmented import standing_model
from excite.diagnosis.floating.simulator.rollout import Simulator
from excite.diagnosis.floating.simulator.rollout_path import base_path
from excite.diagnosis.simulator.model_text import LOUDER, MODEL, ignored, without
from excite.errors import InputError
from excite.logs.signals.butterworth import lowpass
from excite.progress import step

HORIZON_S = 0.5
CHANNELS = ("base.px", "base.py", "base.pz", "base.rx", "base.ry", "base.rz")
# Roll-outs by which it is told whether an effect helps, and whether the simulator hears of it.
_CHECKED, _HEARD = 40, 3


@dataclass(frozen=True, eq=False)
class Noise:
    """A draw of the record's noise.

    Attributes:
        wrench: ``(n_samples, 6)`` [N, N·m], base frame.
        start: ``(n_samples, 6)`` of a velocity, should a roll-out start there [m/s, rad/s].
    """

    wrench: Array
    start: Array


class Reloaded:
    """The simulator of a fit, its model written and loaded again.

    Attributes:
        problem: the problem.
        fitted: the fit.
        model: the model as written.
    """

    def __init__(self, problem: Problem, fitted: Fitted):
        """Write the model and load it; InputError where MuJoCo refuses it."""
        self.problem, self.fitted = problem, fitted
        self.model = standing_model(problem, fitted)
        self._simulator = Simulator(self.model.xml, problem.record)

    def errors(self, windows: Sequence[slice], noise: Noise | None = None) -> Array:
        """Where the base ends up less where it was, ``(n_windows, n_samples, 6)`` [m, rad]."""
        if noise is None:
            return np.array([self._simulator.run(window) for window in windows])
        return np.array([self._simulator.run(w, noise.wrench, noise.start[w.start]) for w in windows])


@step("roll out in the simulator")
def simulated(
    problem: Problem, before: Fitted, after: Fitted, rng: np.random.Generator, out: Path | None
) -> Rollout:
    """Roll-outs of the validation trials; the augmented model is written where there is a folder.

    The base starts where the record has it and is moved by the wrenches that the sensors read, while the joints do what
    they did. Effects that bring the roll-outs of the identification trials no nearer to the record are left out of the
    model, the last first, and a warning says so.

    Args:
        problem: the problem.
        before: the baseline's fit to the identification trials.
        after: that of the accepted effects.
        rng: of the replicas.
        out: folder of the model.
    """
    try:
        found, xml = _compared(problem, before, after, rng)
    except InputError as error:
        # A body that no simulator has is no reason to say nothing else.
        return Rollout({}, {}, HORIZON_S, None, warnings=(f"no roll-outs: {error}",))
    if out is None:
        return found
    write_text(out / MODEL, xml)
    return replace(found, model=MODEL)


def _compared(
    problem: Problem, before: Fitted, after: Fitted, rng: np.random.Generator
) -> tuple[Rollout, str]:
    """The comparison and the augmented model; InputError where there can be no roll-outs."""
    record = problem.record
    windows = _windows(record, validation=True) or _windows(record, validation=False)
    if not windows:
        raise InputError(f"no trial is as long as a roll-out of {HORIZON_S:g} s", remedy="record longer ones")
    nominal = Reloaded(problem, before)
    plain, noise = nominal.errors(windows), _noise(problem, rng)
    made = _helpful(nominal, after)
    moved = made.errors(windows) if made.fitted.placed else plain
    left = [f"{p.effect.name} at {p.location}" for p in after.placed[len(made.fitted.placed) :]]
    found = Rollout(
        before=_rms(plain),
        after=_rms(moved),
        horizon_s=(windows[0].stop - windows[0].start - 1) / record.rate_hz,
        model=None,
        driven_by="the sensors' wrenches and the joints' motion, the base free",
        warnings=(*made.model.warnings, *unheard(made), *without(left)),
        floor=_rms(nominal.errors(windows, noise) - plain),
        path=base_path(record, windows, plain, moved),
    )
    return found, made.model.xml


def _windows(record: FloatingRecord, *, validation: bool) -> list[slice]:
    """Roll-outs, one after the other, of the trials of a role."""
    length = round(HORIZON_S * record.rate_hz)
    return [
        slice(first, first + length + 1)
        for span, held_out in zip(record.spans, record.validation, strict=True)
        if held_out is validation
        for first in range(span.start, span.stop - length, length)
    ]


def _helpful(nominal: Reloaded, after: Fitted) -> Reloaded:
    """The simulator with as many effects as bring roll-outs of the identification trials nearer.

    The last of them has to do so as well. Where all trials are for validation, these tell.
    """
    problem, made = nominal.problem, [nominal]
    for count in range(1, len(after.placed) + 1):
        fitted = after
        if count < len(after.placed):
            placed, theta = after.placed[:count], after.theta[:count]
            fitted = refine(problem.identification_only, placed, theta, after)
        made.append(Reloaded(problem, fitted))
    if len(made) > 1:
        windows = _windows(problem.record, validation=False) or _windows(problem.record, validation=True)
        windows = windows[:: max(1, len(windows) // _CHECKED)]
        left = [np.square(each.errors(windows)).mean(axis=(0, 1)) for each in made]
        for count in range(len(after.placed), 0, -1):
            # In proportion: metres and radians do not add.
            if all(float(np.mean(left[count] / left[other])) < 1.0 for other in (0, count - 1)):
                return made[count]
    return nominal


def unheard(made: Reloaded) -> tuple[str, ...]:
    """Effects that the written model, loaded again, ignores: half as large again, they move no roll-out.

    They are looked for where they matter most.
    """
    problem, fitted, said = made.problem, made.fitted, []
    every = [*_windows(problem.record, validation=False), *_windows(problem.record, validation=True)]
    here = explained_state(problem, fitted).residual
    for k, item in enumerate(fitted.placed):
        theta = (*fitted.theta[:k], LOUDER * fitted.theta[k], *fitted.theta[k + 1 :])
        louder = replace(fitted, theta=theta)
        change = np.abs(explained_state(problem, louder).residual - here).sum(axis=1)
        windows = sorted(every, key=lambda window: -float(change[window].sum()))[:_HEARD]
        moved = Reloaded(problem, louder).errors(windows) - made.errors(windows)
        # What is no number, since so much of it makes a roll-out diverge, is not zero either.
        if not moved.any():
            said.append(ignored(item.effect.name, item.location))
    return tuple(said)


def _noise(problem: Problem, rng: np.random.Generator) -> Noise:
    """Wrenches as the whitening takes them away; velocities of what is above the motion's band, and noise alone."""
    whitening, record = problem.whitening, problem.record
    wrench = np.zeros((record.n_samples, 6))
    for span, factor in zip(record.spans, whitening.factors, strict=True):
        n, bins = span.stop - span.start, len(factor)
        white = rng.standard_normal((2, bins, 6, 1))
        white[1, 0] = 0.0
        real, imaginary = np.linalg.solve(factor, white)[..., 0]
        spectrum = np.zeros((n // 2 + 1, 6), dtype=complex)
        spectrum[:bins] = np.sqrt(n) * (real + 1j * imaginary)
        wrench[span] = np.fft.irfft(spectrum, n, axis=0)
    twist = record.v[:, :6]
    slow = np.concatenate([lowpass(twist[span], record.rate_hz, BAND_HZ) for span in record.spans])
    return Noise(wrench, (twist - slow).std(axis=0) * rng.standard_normal((record.n_samples, 6)))


def _rms(values: Array) -> dict[str, float]:
    return dict(zip(CHANNELS, np.sqrt(np.square(values).mean(axis=(0, 1))).tolist(), strict=True))
