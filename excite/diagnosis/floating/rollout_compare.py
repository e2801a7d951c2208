"""Short roll-outs of a standing robot's nominal and augmented simulator against the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.atomic import write_text
from excite.diagnosis.floating.augmented import StandingModel, standing_model
from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.refinement import Fitted, refine
from excite.diagnosis.floating.rollout import Simulator
from excite.diagnosis.result import Rollout
from excite.errors import InputError
from excite.robot.robot import Array

HORIZON_S = 0.5
MODEL = "augmented.xml"
CHANNELS = ("base.px", "base.py", "base.pz", "base.rx", "base.ry", "base.rz")
# Roll-outs by which it is told whether an effect helps, and whether the simulator hears of it.
_CHECKED, _HEARD = 40, 3
_LOUDER = 1.5


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
    record = problem.record
    try:
        nominal = standing_model(problem, before)
        model, kept = _helpful(problem, nominal, before, after)
    except InputError as error:
        # A body that no simulator has is no reason to say nothing else.
        return Rollout({}, {}, HORIZON_S, None, warnings=(f"no roll-outs: {error}",))
    if out is not None:
        write_text(out / MODEL, model.xml)
    windows = _windows(record, validation=True) or _windows(record, validation=False)
    plain, noise = errors(nominal, record, windows), _noise(problem, rng)
    left = ", ".join(f"{p.effect.name} at {p.location}" for p in after.placed[len(kept.placed) :])
    said = (f"the model is without {left}: roll-outs of the identification trials are no nearer with it",)
    return Rollout(
        before=_rms(plain),
        after=_rms(errors(model, record, windows)),
        horizon_s=HORIZON_S,
        model=None if out is None else MODEL,
        driven_by="the sensors' wrenches and the joints' motion, the base free",
        warnings=(*model.warnings, *unheard(problem, kept, model), *(said if left else ())),
        floor=_rms(errors(nominal, record, windows, noise) - plain),
    )


def errors(
    model: StandingModel, record: FloatingRecord, windows: Sequence[slice], noise: Array | None = None
) -> Array:
    """Where the base ends up less where it was, ``(n_windows, n_samples, 6)`` [m, rad]."""
    simulator = Simulator(model.xml, record)
    drive = simulator.drive()
    return np.array([simulator.run(drive, window, noise) for window in windows])


def _windows(record: FloatingRecord, *, validation: bool) -> list[slice]:
    """Roll-outs, one after the other, of the trials of a role."""
    length = round(HORIZON_S * record.rate_hz)
    return [
        slice(first, first + length + 1)
        for span, held_out in zip(record.spans, record.validation, strict=True)
        if held_out is validation
        for first in range(span.start, span.stop - length, length)
    ]


def _helpful(
    problem: Problem, nominal: StandingModel, before: Fitted, after: Fitted
) -> tuple[StandingModel, Fitted]:
    """The model with as many effects as bring roll-outs of the identification trials nearer, and its fit."""
    windows = _windows(problem.record, validation=False)
    windows = windows[:: max(1, len(windows) // _CHECKED)]
    least = np.square(errors(nominal, problem.record, windows)).mean(axis=(0, 1))
    for count in range(len(after.placed), 0, -1):
        fitted = after
        if count < len(after.placed):
            placed, theta = after.placed[:count], after.theta[:count]
            fitted = refine(problem.identification_only, placed, theta, after)
        model = standing_model(problem, fitted)
        left = np.square(errors(model, problem.record, windows)).mean(axis=(0, 1))
        # In proportion: metres and radians do not add.
        if float(np.mean(left / least)) < 1.0:
            return model, fitted
    return nominal, before


def unheard(problem: Problem, fitted: Fitted, model: StandingModel) -> tuple[str, ...]:
    """Effects that the written model, loaded again, ignores: half as large again, they move no roll-out."""
    windows = _windows(problem.record, validation=False)
    windows = windows[:: max(1, len(windows) // _HEARD)]
    here, said = errors(model, problem.record, windows), []
    for k, item in enumerate(fitted.placed):
        theta = (*fitted.theta[:k], _LOUDER * fitted.theta[k], *fitted.theta[k + 1 :])
        louder = standing_model(problem, replace(fitted, theta=theta))
        if not np.abs(errors(louder, problem.record, windows) - here).max() > 0.0:
            said.append(f"the simulator ignores {item.effect.name} at {item.location}")
    return tuple(said)


def _noise(problem: Problem, rng: np.random.Generator) -> Array:
    """``(n_samples, 6)`` a draw of the noise that the whitening takes away [N, N·m], base frame."""
    whitening, record = problem.whitening, problem.record
    drawn = np.zeros((record.n_samples, 6))
    for span, factor in zip(record.spans, whitening.factors, strict=True):
        n, bins = span.stop - span.start, len(factor)
        white = rng.standard_normal((2, bins, 6, 1))
        white[1, 0] = 0.0
        real, imaginary = np.linalg.solve(factor, white)[..., 0]
        spectrum = np.zeros((n // 2 + 1, 6), dtype=complex)
        spectrum[:bins] = np.sqrt(n) * (real + 1j * imaginary)
        drawn[span] = np.fft.irfft(spectrum, n, axis=0)
    return drawn


def _rms(values: Array) -> dict[str, float]:
    return dict(zip(CHANNELS, np.sqrt(np.square(values).mean(axis=(0, 1))).tolist(), strict=True))
