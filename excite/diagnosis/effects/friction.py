"""Effects of friction in the joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.bristle import Bristle, StaticFriction
from excite.diagnosis.effects.effect import Effect, Parameter, Theta
from excite.diagnosis.effects.form import Absence, Context, Form, InitialState, JointStep, Note, Noted, Sizes
from excite.diagnosis.effects.gears.backlash import Backlash
from excite.diagnosis.equations.dry_friction.friction_sign import (
    RATIO,
    WIDTHS,
    SignChange,
    bend_further,
    bristle_bend,
    damped_rate,
    damping_of_bristles,
    of_velocity,
    sign_of_motion,
)
from excite.diagnosis.equations.dry_friction.play import behind_play
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import COULOMB, VISCOUS, coulomb_level, own_terms
from excite.doctor.doubt import Doubt
from excite.lazy_kernel import LazyKernel

# Viscous friction: a torque against the velocity and proportional to it.


class ViscousFriction(Effect):
    """``τ = f_v v`` (Armstrong-Hélouvry, Dupont, Canudas de Wit 1994, section 2.1)."""

    name = "viscous_friction"
    observed_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    linear = (Parameter("coefficient", "N·m·s/rad", 0.0),)
    confusable_with = ("coulomb_friction", "actuator_lag")
    separating_motion = "constant speeds from slow to fast, both ways"
    mujoco = "joint damping"
    by_motion = True
    term = VISCOUS
    behind = True
    twins_of_a_gain = ("torque_gain",)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return context.signal_at(location, "v")[:, None]

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(viscous=item.value_of("coefficient"))


# All of a joint's dry friction builds up over a deflection: a note to the runner, of the baseline's friction
# too.

# What models call it.
PRESLIDING = "presliding"


@dataclass(frozen=True)
class PreslidingNote(Note):
    """Bristles that hold all of a joint's dry friction.

    Attributes:
        breakaway: deflection over which it builds up [rad].
        damping: of them [N·m·s].
        damped_below: speed up to which they are damped [rad/s].
    """

    breakaway: float
    damping: float | None = None
    damped_below: float | None = None

    beyond = Absence.FRICTION
    takes_all = True

    @property
    def has_friction(self) -> bool:
        return True

    def make_bristle(self) -> Bristle:
        below = np.inf if self.damped_below is None else self.damped_below
        return Bristle(self.breakaway, self.damping or 0.0, below)


# Friction that changes with temperature, over the session or in each trial.

# Samples over which what the record tells of the drift is averaged.
_SMOOTH = 201
# Quantiles of the speed at which friction that has drifted is asked whether it brakes.
_SLOW_AND_FAST = (0.05, 0.95)


@dataclass(frozen=True)
class DriftNote(Note):
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

    beyond = Absence.FRICTION

    @property
    def has_friction(self) -> bool:
        return True

    def joint_friction(self, level: Array, at: JointStep) -> tuple[Array, Array]:
        growth = self._growth_at_step(at)
        return level + growth * self.coulomb_change, growth * self.viscous_change

    def _growth_at_step(self, at: JointStep) -> Array:
        """How far it has come: held at what it was when a roll-out began, unless it may be over by its end."""
        if at.growth is not None and self.in_each_trial is None:
            return at.growth
        time = at.session_s if self.in_each_trial is None else at.trial_s
        return np.asarray(
            np.expm1(-time / self.time_constant) / np.expm1(-self.session_end / self.time_constant)
        )


@LazyKernel
def filter_heat(heat, share, state):  # pragma: no cover - compiled
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
    note = DriftNote

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (HeatedFriction(),)

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return (DriftInTrial(),)

    def is_candidate(self, modelled: tuple[str, ...]) -> bool:
        return self.name not in modelled and (COULOMB.is_modelled(modelled) or VISCOUS.is_modelled(modelled))

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return [(t,) for t in (12.0, 50.0, 2000.0)]

    def drift_growth(self, context: Context, j: int, theta: Theta) -> Array:
        """g at every sample, ``(n_samples,)``."""
        end = float(context.session_time.max())
        return np.expm1(-context.session_time / theta[0]) / np.expm1(-end / theta[0])

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        j = context.row(location)
        growth = self.drift_growth(context, j, theta)
        # What the baseline has not cannot have drifted: a viscous column would stand in for viscous friction.
        modelled = context.baseline.modelled
        coulomb = (
            growth * context.friction_sign(j) if COULOMB.is_modelled(modelled) else np.zeros_like(growth)
        )
        viscous = growth * context.v[:, j] if VISCOUS.is_modelled(modelled) else np.zeros_like(growth)
        return np.column_stack([coulomb, viscous])

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        """Whether friction brakes before it has changed and after it, where the joint is slow and where it is fast."""
        j, base = context.row(location), context.baseline
        own = dict(zip(own_terms(base.modelled), base.fit.own_coefs[j], strict=False))
        growth = self.drift_growth(context, j, theta)
        speed = np.quantile(np.abs(context.v[:, j]), _SLOW_AND_FAST)
        for change in (growth.min() - growth.mean(), growth.max() - growth.mean()):
            dry, viscous = own.get(COULOMB, 0.0) + change * beta[0], own.get(VISCOUS, 0.0) + change * beta[1]
            if (dry + viscous * speed < 0.0).any():
                return False
        return super().is_admissible(context, location, theta, beta)

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        found = super().to_estimates(context, location, theta, fit)
        level = coulomb_level(context.baseline.modelled, fit.own_coefs[context.row(location)])
        if level <= 0.0:
            return found
        share = Estimate(float(fit.extra[0]) / level, float(fit.extra_std[0]) / level, "1")
        return {"relative_change": share, **found}

    def to_sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        return super().to_sizes(context, location, theta, fit) | {"session_end": self._session_end(context)}

    def _session_end(self, context: Context) -> float:
        return float(context.session_time.max())

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.make_note(item),))

    def initial_state(self, context: Context, location: str, theta: Theta) -> InitialState:
        """Its Coulomb column over the sign of motion, or its viscous one over the velocity where it has no other."""
        from scipy.ndimage import uniform_filter1d

        j, samples = context.row(location), context.baseline.samples
        columns = self.unit_torques(context, location, theta)
        made: list[Array] = []
        for column, unit in zip(columns.T, (context.friction_sign(j), context.v[:, j]), strict=True):
            parts = zip(*(samples.by_trial(x) for x in (column * unit, unit**2)), strict=True)
            made = [
                uniform_filter1d(a, _SMOOTH) / np.maximum(uniform_filter1d(b, _SMOOTH), 1e-12)
                for a, b in parts
            ]
            if column.any():
                break
        return InitialState(growth=made)


class DriftInTrial(FrictionDrift):
    """The same in every trial anew: a joint that cools between trials, as where it waits for the next one."""

    searched = (Parameter("time_constant", "s", 0.5, 100.0),)

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return [(t,) for t in (2.0, 8.0)]

    def drift_growth(self, context: Context, j: int, theta: Theta) -> Array:
        time = np.concatenate([trial.time for trial in context.baseline.samples.trials])
        return np.expm1(-time / theta[0]) / np.expm1(-float(time.max()) / theta[0])

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        return super().to_estimates(context, location, theta, fit) | {
            "in_each_trial": Estimate(1.0, None, "1")
        }

    def _session_end(self, context: Context) -> float:
        return max(float(trial.time[-1]) for trial in context.baseline.samples.trials)


class HeatedFriction(FrictionDrift):
    """The temperature follows the joint's own speed: ``T' = (|v|/mean|v| − T)/τ``, cooling between trials."""

    seen_alone = True

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(max(theta[0], self.searched[0].low),)]

    def drift_growth(self, context: Context, j: int, theta: Theta) -> Array:
        samples = context.baseline.samples
        speed = np.abs(context.v[:, j])
        heat = samples.by_trial(speed / max(float(speed.mean()), 1e-9))
        share = -np.expm1(-1.0 / (samples.rate_hz * theta[0]))
        made, state, last = {}, 0.0, 0.0
        # In the order in which the trials were run.
        for k in np.argsort([t.session_s[0] for t in samples.trials], kind="stable"):
            trial = samples.trials[k]
            state *= np.exp(-max(float(trial.session_s[0]) - last, 0.0) / theta[0])
            made[int(k)] = filter_heat(heat[k], share, state)
            state, last = float(made[int(k)][-1]), float(trial.session_s[-1])
        growth = np.concatenate([made[k] for k in range(len(samples.trials))])
        return growth / max(float(np.abs(growth).max()), 1e-9)


# Friction that grows with the load on the gear.

# The share of the load that friction itself adds is the coefficient; it may be this many times that, no more: else a
# torque scale would pass for it.
_OWN = 2.0
# Correlation with the load below which nothing grows with it: rounding errors would be fitted.
_GROWS = 1e-3


@dataclass(frozen=True)
class LoadNote(Note):
    """Dry friction by the torque that the gear carries.

    Attributes:
        coefficient: [N·m/(N·m)].
        exponent: of the load; one where it is None.
        power_scale: what the power of the load is multiplied by to be a torque [(N·m)^(1 − exponent)].
        own_share: share of the motor's torque that is friction again; None where the link's load counts.
    """

    coefficient: float
    exponent: float | None = None
    power_scale: float | None = None
    own_share: float | None = None

    beyond = Absence.FRICTION

    @property
    def has_friction(self) -> bool:
        return True

    def joint_friction(self, level: Array, at: JointStep) -> tuple[Array, float]:
        load = at.carried()
        if self.own_share is not None:
            load = motor_torque(load, np.sign(at.v), level, self.own_share)
        if self.exponent is None or self.power_scale is None:
            return level + self.coefficient * np.abs(load), 0.0
        return level + self.coefficient * self.power_scale * np.abs(load) ** self.exponent, 0.0


class LoadDependentFriction(Effect):
    """``τ = α |τ_load| sign(v)`` with the predicted load (Hamon, Gautier, Garrec 2010, eq. 9)."""

    name = "load_dependent_friction"
    linear = (Parameter("coefficient", "N·m/(N·m)", 0.0),)
    confusable_with = ("coulomb_friction", "torque_gain", "time_delay")
    separating_motion = "the same motion with and without a known payload"
    mujoco = "none of its own: a control callback"
    friction = True
    by_load = True
    note = LoadNote

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (CurvedLoadFriction(), MotorLoadFriction())

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        j = context.row(location)
        return (np.abs(context.baseline.rigid[:, j]) * context.friction_sign(j))[:, None]

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.make_note(item),))


class CurvedLoadFriction(LoadDependentFriction):
    """``τ = α k |τ_load|^p sign(v)``: teeth that touch over more of their flanks, the more they carry.

    The scale k makes α the slope of the straight line that comes nearest, as that of friction in proportion is.
    """

    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("exponent", "1", 0.4, 1.6),)

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(0.8,), (1.2,)]

    def gear_load(self, context: Context, location: str, theta: Theta) -> Array:
        """The load that counts, ``(n_samples,)`` [N·m]."""
        return context.baseline.rigid[:, context.row(location)]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        load = self._power_scale(context, location, theta) * self._load_power(context, location, theta)
        return (load * context.friction_sign(context.row(location)))[:, None]

    def to_sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        scale = {"power_scale": self._power_scale(context, location, theta)}
        return super().to_sizes(context, location, theta, fit) | scale

    def _load_power(self, context: Context, location: str, theta: Theta) -> Array:
        return np.asarray(np.abs(self.gear_load(context, location, theta)) ** theta[0])

    def _power_scale(self, context: Context, location: str, theta: Theta) -> float:
        load = np.abs(context.baseline.rigid[:, context.row(location)])
        power = self._load_power(context, location, theta)
        along = load - load.mean()
        slope = float(along @ power) / max(float(along @ along), 1e-300)
        # What hardly grows with the load has no such line.
        return 1.0 / slope if slope * along.std() > _GROWS * power.std() else 0.0


class MotorLoadFriction(CurvedLoadFriction):
    """The same of the torque that the motor gives, friction and all: more while it drives than while it holds back.

    With ``τ = τ_load + (F + α τ_motor) sign(v)`` friction is a share of itself as well.
    """

    searched = (*CurvedLoadFriction.searched, Parameter("own_share", "1", 0.01, 0.6))

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(0.8, 0.1), (1.2, 0.1), (1.0, 0.2)]

    def gear_load(self, context: Context, location: str, theta: Theta) -> Array:
        j, base = context.row(location), context.baseline
        level = coulomb_level(base.modelled, base.fit.own_coefs[j])
        return motor_torque(base.rigid[:, j], context.friction_sign(j), level, theta[1])

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return theta[1] <= _OWN * beta[0] and super().is_admissible(context, location, theta, beta)


def motor_torque(load: Array, sign: Array, level: Array | float, share: float) -> Array:
    """Torque of a motor whose friction is a level and a share of that torque itself, like ``load`` [N·m]."""
    along = load * sign + np.maximum(level, 0.0)
    return np.asarray(np.abs(along) / np.where(along > 0.0, 1.0 - share, 1.0 + share))


# The sign of a joint's motion with presliding.

# No bristle is damped for longer [s]: where there is hardly any Coulomb friction, its damping tells nothing.
_LONGEST = 0.1


def hysteretic_sign(context: Context, joint: str, breakaway: float) -> Array:
    """The sign of a joint's motion with presliding, ``(n_samples,)`` (Dahl 1968; Canudas de Wit et al. 1995).

    Args:
        breakaway: deflection over which friction builds up [rad].
    """
    return bristle_bend(context.baseline.samples, context.signal_at(joint, "v"), SignChange(0.0, breakaway))


def bent_excess(context: Context, j: int, sign: SignChange, velocity: float, exponent: float) -> Array:
    """What static friction adds while bristles bend, ``(n_samples,)``, per unit of its excess.

    How far it bends them hardly shows in a motion: the difference between bristles of a typical ratio of static to
    Coulomb friction and those of none stands for any ratio. It is damped as they are.

    Args:
        j: row of the joint.
        sign: with bristles.
        velocity: Stribeck velocity [rad/s].
        exponent: of its decay.
    """
    base = context.baseline
    samples = base.samples
    v = samples.motor_signal("v")[:, j]
    steady, dt = np.ascontiguousarray(v), 1.0 / samples.rate_hz
    further = bend_further(steady, samples.is_start, dt, sign.breakaway, velocity, exponent, RATIO)
    excess = (further - bristle_bend(samples, v, sign)) / RATIO
    level = coulomb_level(base.modelled, base.fit.own_coefs[j])
    if level > 0.0 and base.signs[j].has_damping:
        seconds = min(base.bristle_damping(j) / level, _LONGEST)
        excess = excess + seconds * damped_rate(samples, v, excess, sign)
    return excess


# Coulomb friction: a torque against the velocity whatever its size.

# Rigid bodies' share of an axis' torque (root mean square) below which it carries no mass to speak of: less than 1e-5
# on a friction damper whose moving parts are not part of the record.
_MASSLESS = 0.02
# A sign that changes over more than this share of a joint's speed (root mean square) is a slope: viscous friction.
_SIGN = 0.25


class CoulombFriction(Effect):
    """``τ = f_c sign(v)``, the sign smoothed over a width that is searched (Armstrong-Hélouvry et al. 1994)."""

    name = "coulomb_friction"
    linear = (Parameter("level", "N·m", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("width", "rad/s", 5e-4, 0.1),)
    confusable_with = ("stribeck", "load_dependent_friction", "viscous_friction")
    separating_motion = "slow reversals at constant speed"
    mujoco = "joint frictionloss"
    term = COULOMB
    behind = True

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (CoulombBristles(), CoulombBehindPlay())

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return (CoulombBristles(),)

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return [(w,) for w in WIDTHS]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        own = location in context.joints
        straight = own and context.baseline.signs[context.row(location)].straight
        return of_velocity(context.signal_at(location, "v")[:, None], SignChange(theta[0], straight=straight))

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        speed = float(np.sqrt(np.mean(context.signal_at(location, "v") ** 2)))
        narrow = theta[0] <= max(_SIGN * speed, WIDTHS[0])
        return narrow and super().is_admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(coulomb=item.value_of("level"))


class CoulombBristles(CoulombFriction):
    """Coulomb friction that builds up over a deflection."""

    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("breakaway", "rad", 1e-4, 2e-2),)

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (CoulombBehindPlay(),)

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(5e-4,), (2e-3,), (5e-3,)]

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return self.search_starts(())

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return Effect.is_admissible(self, context, location, theta, beta)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return hysteretic_sign(context, location, theta[0])[:, None]

    def in_mujoco(self, item: Sizes) -> Form:
        bends = PreslidingNote(item.value_of("breakaway"))
        return Form(coulomb=item.value_of("level"), notes=(Noted(PRESLIDING, item.location, bends),))


class CoulombBehindPlay(CoulombBristles):
    """The same behind play, on an axis that carries no mass: after a reversal nothing resists until it is used up.

    A link that has mass flies through its play, which is a gear's law and not this one.
    """

    searched: ClassVar[tuple[Parameter, ...]] = (
        *CoulombBristles.searched,
        Parameter("width", "rad", 2e-4, 0.08),
    )
    along: ClassVar[dict[type[Effect], tuple[str, ...]]] = {Backlash: ("width",)}

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(d, w) for d in (5e-4, 1.5e-3) for w in (1.5e-3, 3e-3, 6e-3)]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        way = np.diff(context.signal_at(location, "q"), prepend=0.0)
        return behind_play(way, context.baseline.samples.is_start, theta[1], theta[0])[:, None]

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return _is_massless(context, location) and super().is_admissible(context, location, theta, beta)


def _is_massless(context: Context, joint: str) -> bool:
    """Whether a joint's rigid bodies ask for next to nothing of its torque."""
    if joint not in context.joints:
        return False
    base, j = context.baseline, context.row(joint)
    torque = base.samples.stack_trials("tau")[:, j]
    return bool(np.mean(base.rigid[:, j] ** 2) <= _MASSLESS**2 * np.mean(torque**2))


# Stribeck friction: more friction at low speed.

# A Stribeck velocity nearer to the width of the sign change says how friction changes sign, no more.
_APART = 2.5
# Nor does one that is over while bristles still bend, which takes joints to about this speed [rad/s].
_BENT = 0.03
# Share of the Coulomb level below which an excess says that bristles are not quite what the model has them be.
_TRIFLE = 0.05
# A search that ended within its last step, 1.3 per cent, of the slowest velocity that may be would go on to slower
# ones: of three simulated joints that stick (a UR3e's first, a Z1's fourth, the second of another arm) it ended at
# 1.000, 1.0006 and 1.010 of that.
_EDGE = 1.02
# Most of the Coulomb level that bristles may take over; the fit without them is off by a little.
_SHARE = 1.5
# Stribeck velocity that a search has to end below [rad/s], or below the joint's usual speed where that is faster. With
# 0.45 alone nothing is found of 20 N that a carriage of 0.7 m/s has more at rest, whose velocity is 0.45 or 0.6 m/s;
# with its usual speed 20.0 to 22.0 N are.
_SLOWER = 0.45
# Share of the excess by which Coulomb friction may be fitted below none.
_LEFT = 0.1


@dataclass(frozen=True)
class StribeckNote(Note):
    """More dry friction at low speed, on the bristles that the joint's friction has, or on some of its own.

    Attributes:
        excess: at rest, over the level [N·m].
        velocity: Stribeck velocity [rad/s].
        exponent: of the decay; 2 where it is not given.
        presliding: of the level, what bristles of its own hold [N·m].
        breakaway: of these [rad].
        bristle_damping: of these [N·m·s].
    """

    excess: float
    velocity: float
    exponent: float | None = None
    presliding: float | None = None
    breakaway: float | None = None
    bristle_damping: float | None = None

    beyond = Absence.FRICTION

    @property
    def has_friction(self) -> bool:
        return True

    @cached_property
    def static_friction(self) -> StaticFriction:
        """See :class:`Note`."""
        return StaticFriction(self.excess, self.velocity, 2.0 if self.exponent is None else self.exponent)

    def make_bristle(self) -> Bristle | None:
        if self.breakaway is None:
            return None
        return Bristle(self.breakaway, self.bristle_damping or 0.0, static=self.static_friction)

    def held_friction(self, level: Array) -> Array:
        # A fit may have bristles take less than none of a level, or more than all.
        return np.minimum(max(self.presliding or 0.0, 0.0), np.maximum(level, 0.0))

    def joint_friction(self, level: Array, at: JointStep) -> tuple[Array, float]:
        if self.breakaway is not None:
            return level - self.held_friction(level), 0.0
        if at.bends:
            return level, 0.0
        return level + self.static_friction.excess * self.static_friction.share_at_speed(at.v), 0.0


class Stribeck(Effect):
    """``τ = f_s exp(−(|v|/v_s)²) sign(v)`` (Armstrong-Hélouvry et al. 1994, eq. 3; exponent 2)."""

    name = "stribeck"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("excess", "N·m", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("velocity", "rad/s", 5e-3, 5.0),)
    confusable_with = ("coulomb_friction", "load_dependent_friction", "backlash")
    separating_motion = "constant speeds from below the Stribeck velocity to well above it"
    mujoco = "none of its own: a control callback"
    friction = True
    note = StribeckNote

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (StribeckExponential(), StribeckExponent(), StribeckBristles())

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        limit = _greatest_stribeck_velocity(context, location)
        return [(v,) for v in (0.015, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0) if v <= max(0.5 * limit, 0.25)]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return _excess_column(context, location, theta[0])

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        base, j = context.baseline, context.row(location)
        if theta[0] < _least_stribeck_velocity(base.signs[j]) or not super().is_admissible(
            context, location, theta, beta
        ):
            return False
        trifle = beta[0] < _TRIFLE * coulomb_level(base.modelled, base.fit.own_coefs[j])
        return not (base.signs[j].has_bristles and trifle)

    def is_within_scope(self, context: Context, location: str, theta: Theta, fit: Fit) -> bool:
        """Friction that falls with speed up to the joint's usual one is no matter of low speed.

        Nor is what leaves no dry friction above it: there drag sets in that grows faster than with the speed. At the
        slowest velocity that may be a search says how a joint sticks.
        """
        slowest = max(
            _least_stribeck_velocity(context.baseline.signs[context.row(location)]), self.searched[0].low
        )
        left = coulomb_level(context.baseline.modelled, fit.own_coefs[context.row(location)])
        within = _EDGE * slowest < theta[0] < _greatest_stribeck_velocity(context, location)
        return within and left > -_LEFT * float(fit.extra[0])

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.make_note(item),))


class StribeckExponential(Stribeck):
    """``τ = f_s exp(−|v|/v_s) sign(v)`` (Tustin 1947)."""

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [theta, (0.6 * theta[0],)]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return _excess_column(context, location, theta[0], exponent=1.0)

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        return super().to_estimates(context, location, theta, fit) | {"exponent": Estimate(1.0, None, "1")}


class StribeckExponent(Stribeck):
    """``τ = f_s exp(−(|v|/v_s)^δ) sign(v)`` with the exponent δ searched (Bo, Pavelescu 1982)."""

    searched = (*Stribeck.searched, Parameter("exponent", "1", 0.4, 2.5))

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(theta[0], 1.2), (0.7 * theta[0], 0.7)]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        return _excess_column(context, location, theta[0], exponent=theta[1])


class StribeckBristles(Stribeck):
    """Stribeck friction that builds up over a deflection, as Coulomb friction then does as well.

    The LuGre model (Canudas de Wit et al. 1995), for joints whose dry friction was not seen to have bristles, or others
    where static friction was not thought of.
    """

    linear = (
        *Stribeck.linear,
        Parameter("presliding", "N·m", 0.0, beside=True),
        Parameter("bristle_damping", "N·m·s", 0.0, beside=True),
    )
    searched = (*Stribeck.searched, Parameter("breakaway", "rad", 1e-4, 2e-2))

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(theta[0], 5e-4), (theta[0], 2e-3)]

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        """Bristles that bend nearly like the baseline's can have any share of the level: no more than there is."""
        base, j = context.baseline, context.row(location)
        level = coulomb_level(base.modelled, base.fit.own_coefs[j])
        too_much = COULOMB.is_modelled(base.modelled) and beta[1] > _SHARE * max(level, 0.0)
        return not too_much and super().is_admissible(context, location, theta, beta)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        j = context.row(location)
        velocity, breakaway = theta
        samples, bristles = context.baseline.samples, SignChange(0.0, breakaway, np.inf)
        sign = sign_of_motion(samples, j, bristles)
        excess = bent_excess(context, j, bristles, velocity, 2.0)
        damped = damping_of_bristles(samples, j, bristles)
        return np.column_stack([excess, sign - context.friction_sign(j), damped])


def _excess_column(context: Context, location: str, velocity: float, exponent: float = 2.0) -> Array:
    """More friction at low speed; while bristles bend, where the joint's friction has some."""
    j = context.row(location)
    sign = context.baseline.signs[j]
    if sign.has_bristles:
        return bent_excess(context, j, sign, velocity, exponent)[:, None]
    decay = np.exp(-((np.abs(context.v[:, j]) / velocity) ** exponent))
    return (context.friction_sign(j) * decay)[:, None]


def _least_stribeck_velocity(sign: SignChange) -> float:
    """Stribeck velocity below which friction's change of sign would be told [rad/s]."""
    return _BENT if sign.has_bristles else _APART * sign.width


def _greatest_stribeck_velocity(context: Context, location: str) -> float:
    """Stribeck velocity that is told from friction that falls with speed throughout [rad/s]."""
    v = context.v[:, context.row(location)]
    return max(_SLOWER, float(np.sqrt((v**2).mean())))
