"""Torque ripple and cogging: a torque periodic in the joint's position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.note import Beyond, JointStep, Note

# Periods over a joint's motion below which nothing has been seen to repeat: a spring or a stop would do as well.
_SEEN = 2.0
# Spacing of the periods a revolution that are tried, and the most of them: strain-wave gears have two waves a turn of
# the motor, 200 to 320 a turn of the joint at the usual ratios of 100 to 160.
_APART, _MOST = 0.5, 340.0


@dataclass(frozen=True)
class Wave(Note):
    """A torque periodic in a joint's position, with its second harmonic and the part that grows with the load.

    Attributes:
        cosine: [N·m]; sine alike.
        periods_per_rev: periods a revolution.
        cosine_2: of the second harmonic [N·m]; sine_2 alike.
        cosine_load: by the torque that the gear carries [N·m/(N·m)]; sine_load alike.
    """

    cosine: float
    sine: float
    periods_per_rev: float
    cosine_2: float | None = None
    sine_2: float | None = None
    cosine_load: float | None = None
    sine_load: float | None = None

    beyond = Beyond.SPRING

    def torque(self, at: JointStep) -> Array:
        phase = self.periods_per_rev * at.q
        c, s = np.cos(phase), np.sin(phase)
        wave = self.cosine * c + self.sine * s
        if self.cosine_2 is not None and self.sine_2 is not None:
            wave = wave + self.cosine_2 * np.cos(2.0 * phase) + self.sine_2 * np.sin(2.0 * phase)
        if self.cosine_load is not None and self.sine_load is not None:
            wave = wave + np.abs(at.carried()) * (self.cosine_load * c + self.sine_load * s)
        return np.asarray(-wave)


class TorqueRipple(Effect):
    """``τ = A cos(N q) + B sin(N q)`` with N periods a revolution."""

    name = "torque_ripple"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("cosine", "N·m"), Parameter("sine", "N·m"))
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("periods_per_rev", "1", 4.0, 1.2 * _MOST),)
    confusable_with = ("joint_spring",)
    separating_motion = "a slow sweep of the joint at constant speed"
    mujoco = "none of its own: a control callback"
    by_motion = True
    note = Wave

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (RippleHarmonics(),)

    def grid(self, context: Context, location: str) -> list[Theta]:
        """The three best of those seen to repeat, by a projection of the baseline's residual at the rows."""
        j = context.row(location)
        samples = context.baseline.samples
        q = np.concatenate(
            [p[t.rows] for p, t in zip(samples.split(context.q[:, j]), samples.trials, strict=True)]
        )
        use = samples.identification
        # Every second row: the sampling of the phase matters little, that of the periods much.
        residual, q = context.baseline.fit.residual[j][use][::2], q[use][::2]
        least = _SEEN * 2.0 * np.pi / max(float(np.ptp(context.q[:, j])), 1e-9)
        periods = np.arange(max(4.0, np.ceil(2.0 * least) / 2.0), _MOST, _APART)
        power = _projections(periods, q, residual)
        best: list[Theta] = []
        for k in np.argsort(-power):
            if all(abs(periods[k] - b[0]) > 1.5 for b in best):
                best.append((float(periods[k]),))
            if len(best) == 3:
                break
        return best

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        phase = theta[0] * context.q[:, j]
        return Shape({j: np.column_stack([np.cos(phase), np.sin(phase)])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        seen = theta[0] * float(np.ptp(context.q[:, context.row(location)])) / (2.0 * np.pi)
        return seen >= _SEEN and super().admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.noted(item),))


def _projections(periods: Array, q: Array, residual: Array) -> Array:
    """``|Σ r exp(−i N q)|`` at evenly spaced N, ``(n_periods,)``; each wave is the one before, turned on."""
    power = np.empty(len(periods))
    if len(periods) == 0:
        return power
    wave, turn = residual * np.exp(-1j * periods[0] * q), np.exp(-1j * _APART * q)
    for k in range(len(periods)):
        power[k] = np.abs(wave.sum())
        wave *= turn
    return power


class RippleHarmonics(TorqueRipple):
    """The same with a second harmonic, and an amplitude that grows with the load on the gear."""

    by_motion = False
    linear = (
        *TorqueRipple.linear,
        *(Parameter(name, "N·m") for name in ("cosine_2", "sine_2")),
        *(Parameter(name, "N·m/(N·m)") for name in ("cosine_load", "sine_load")),
    )

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        phase, load = theta[0] * context.q[:, j], np.abs(context.baseline.rigid[:, j])
        waves = [np.cos(phase), np.sin(phase)]
        second = [np.cos(2.0 * phase), np.sin(2.0 * phase)]
        return Shape({j: np.column_stack([*waves, *second, *(load * wave for wave in waves)])})
