"""Friction that changes with temperature, over the session or in each trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes, Told
from excite.diagnosis.effects.note import Beyond, JointStep, Note
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import COULOMB, VISCOUS, coulomb_level
from excite.lazy_kernel import LazyKernel

# Samples over which what the record tells of the drift is averaged.
_SMOOTH = 201


@dataclass(frozen=True)
class Drift(Note):
    """Friction that has drifted so far.

    Attributes:
        coulomb_change: dry friction at the session's end, less that at its start [N·m].
        viscous_change: viscous friction likewise [N·m·s/rad].
        time_constant: [s].
        session_end: [s].
        in_each_trial: given where it begins anew in every trial.
    """

    coulomb_change: float
    viscous_change: float
    time_constant: float
    session_end: float
    in_each_trial: float | None = None

    beyond = Beyond.FRICTION

    @property
    def rubs(self) -> bool:
        return True

    def friction(self, level: Array, at: JointStep) -> tuple[Array, Array]:
        growth = self._growth(at)
        return level + growth * self.coulomb_change, growth * self.viscous_change

    def _growth(self, at: JointStep) -> Array:
        """How far it has come: held at what it was when a roll-out began, unless it may be over by its end."""
        if at.growth is not None and self.in_each_trial is None:
            return at.growth
        time = at.session_s if self.in_each_trial is None else at.trial_s
        return np.asarray(
            np.expm1(-time / self.time_constant) / np.expm1(-self.session_end / self.time_constant)
        )


@LazyKernel
def heated(heat, share, state):  # pragma: no cover - compiled
    """A first-order lag of ``heat (n,)`` that follows a ``share`` of the difference a sample, from a state."""
    out = np.empty(len(heat))
    for i in range(len(heat)):
        state = share * heat[i] + (1.0 - share) * state
        out[i] = state
    return out


class FrictionDrift(Effect):
    """``τ = g(t) (d_c sign(v) + d_v v)``: Coulomb and viscous friction that change as g from 0 to 1.

    g is ``1 − exp(−t/T)`` scaled to 1 at the session's end (Newton's heating of a joint under a constant
    load); large T is a drift linear in time.
    """

    name = "friction_drift"
    linear = (Parameter("coulomb_change", "N·m"), Parameter("viscous_change", "N·m·s/rad"))
    searched = (Parameter("time_constant", "s", 5.0, 3000.0),)
    confusable_with = ("coulomb_friction", "viscous_friction")
    separating_motion = "the same trial at the start, in the middle and at the end of the session"
    mujoco = "none of its own: a control callback"
    friction = True
    note = Drift

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (HeatedFriction(),)

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (DriftInTrial(),)

    def offered(self, modelled: tuple[str, ...]) -> bool:
        return self.name not in modelled and (COULOMB.asked(modelled) or VISCOUS.asked(modelled))

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(t,) for t in (12.0, 50.0, 2000.0)]

    def growth(self, context: Context, j: int, theta: Theta) -> Array:
        """g at every sample, ``(n_samples,)``."""
        end = float(context.session.max())
        return np.expm1(-context.session / theta[0]) / np.expm1(-end / theta[0])

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        growth = self.growth(context, j, theta)
        # What the baseline has not cannot have drifted: a viscous column would stand in for viscous friction.
        modelled = context.baseline.modelled
        coulomb = growth * context.sign(j) if COULOMB.asked(modelled) else np.zeros_like(growth)
        viscous = growth * context.v[:, j] if VISCOUS.asked(modelled) else np.zeros_like(growth)
        return Shape({j: np.column_stack([coulomb, viscous])})

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        found = super().estimates(context, location, theta, fit)
        level = coulomb_level(context.baseline.modelled, fit.own[context.row(location)])
        if level <= 0.0:
            return found
        share = Estimate(float(fit.extra[0]) / level, float(fit.extra_std[0]) / level, "1")
        return {"relative_change": share, **found}

    def sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        return super().sizes(context, location, theta, fit) | {"session_end": self._end(context)}

    def _end(self, context: Context) -> float:
        return float(context.session.max())

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.noted(item),))

    def told(self, context: Context, location: str, theta: Theta) -> Told:
        """Its Coulomb column over the sign of motion, or its viscous one over the velocity where it has no other."""
        from scipy.ndimage import uniform_filter1d

        j, samples = context.row(location), context.baseline.samples
        columns = self.shape(context, location, theta).columns[j]
        made: list[Array] = []
        for column, unit in zip(columns.T, (context.sign(j), context.v[:, j]), strict=True):
            parts = zip(*(samples.split(x) for x in (column * unit, unit**2)), strict=True)
            made = [
                uniform_filter1d(a, _SMOOTH) / np.maximum(uniform_filter1d(b, _SMOOTH), 1e-12)
                for a, b in parts
            ]
            if column.any():
                break
        return Told(growth=made)


class DriftInTrial(FrictionDrift):
    """The same in every trial anew: a joint that cools between trials, as where it waits for the next one."""

    searched = (Parameter("time_constant", "s", 0.5, 100.0),)

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(t,) for t in (2.0, 8.0)]

    def growth(self, context: Context, j: int, theta: Theta) -> Array:
        time = np.concatenate([trial.time for trial in context.baseline.samples.trials])
        return np.expm1(-time / theta[0]) / np.expm1(-float(time.max()) / theta[0])

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        return super().estimates(context, location, theta, fit) | {"in_each_trial": Estimate(1.0, None, "1")}

    def _end(self, context: Context) -> float:
        return max(float(trial.time[-1]) for trial in context.baseline.samples.trials)


class HeatedFriction(FrictionDrift):
    """The temperature follows the joint's own speed: ``T' = (|v|/mean|v| − T)/τ``, cooling between trials."""

    seen_alone = True

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(max(theta[0], self.searched[0].low),)]

    def growth(self, context: Context, j: int, theta: Theta) -> Array:
        samples = context.baseline.samples
        speed = np.abs(context.v[:, j])
        heat = samples.split(speed / max(float(speed.mean()), 1e-9))
        share = -np.expm1(-1.0 / (samples.rate_hz * theta[0]))
        made, state, last = {}, 0.0, 0.0
        # In the order in which the trials were run.
        for k in np.argsort([t.session_s[0] for t in samples.trials], kind="stable"):
            trial = samples.trials[k]
            state *= np.exp(-max(float(trial.session_s[0]) - last, 0.0) / theta[0])
            made[int(k)] = heated(heat[k], share, state)
            state, last = float(made[int(k)][-1]), float(trial.session_s[-1])
        growth = np.concatenate([made[k] for k in range(len(samples.trials))])
        return growth / max(float(np.abs(growth).max()), 1e-9)
