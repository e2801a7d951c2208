"""Effects of bodies on a floating base: inertia, lengths, soft tissue, wobbling masses, elastic joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.fft import dct, idct

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effect import (
    POINT,
    FloatingEffect,
    Parameter,
    joint_of,
    link_names,
    segment_of,
    visible_joints,
)
from excite.diagnosis.floating.state import State, cross_rows, joint_turn
from excite.doctor.doubt import Doubt

# A link's inertial parameters are wrong, or it carries a body that the model lacks.

_NAMES = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_UNITS = ("kg", "kg·m", "kg·m", "kg·m") + ("kg·m²",) * 6


class LinkInertia(FloatingEffect):
    """True parameters = the model's + error; also what a payload does, which is a positive error."""

    name = "link_inertia"
    in_torques = True
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    reads_as = "constant sensor bias, and the neighbouring links where they move as one"
    changes = "phi"

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with mass, where the inertial parameters are not identified anyway."""
        return () if state.record.inertials_free else link_names(state)

    def parameters_at(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The ten parameters' errors about the joint's frame."""
        mass = 0.05 * state.record.tree.phi[::10].sum()
        own = state.record.tree.phi[10 * segment_of(state, location)]
        mass = min(mass, 1.0 + 0.3 * own)
        scales = (mass,) + (0.1 * mass,) * 3 + (0.01 * mass,) * 6
        return tuple(Parameter(n, u, s, 0.1 * s) for n, u, s in zip(_NAMES, _UNITS, scales, strict=True))

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Change the parameters."""
        first = 10 * segment_of(state, location)
        phi = state.phi.copy()
        phi[first : first + 10] += theta
        return state.replace(phi=phi)

    def residual_columns(self, state: State, location: str, theta: Array) -> Array:
        """Columns of the regressor."""
        first = 10 * segment_of(state, location)
        return np.asarray(state.regressor[:, :, first : first + 10])

    def report_parameters(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The ten errors, and the centre of mass of what is too much."""
        mass = float(theta[0])
        extra = {
            f"com_{axis}": Estimate(float(theta[1 + i]) / mass, float(std[1 + i]) / abs(mass), "m")
            for i, axis in enumerate("xyz")
            if mass
        }
        return super().report_parameters(state, location, theta, std) | extra

    def effect_name(self, theta: Array) -> str:
        """A payload is what adds mass."""
        return "payload" if theta[0] > 0.0 else self.name


# A joint bends under its load.

# A turn by which the torque's change is measured [rad], and the most that bending may add to itself: beyond one it
# would buckle.
_TURN, MOST_ADDED = 1e-3, 0.8


class JointElasticity(FloatingEffect):
    """True angle = logged − (compliance + stiffening · |τ|/τ₀) · τ, the bent joint's τ with what the feet carry.

    τ₀ is the largest torque of the record. Gears with flexsplines and rubber stiffen under load
    (Tuttle and Seering 1996); a straight line is the case without it.
    """

    name = "joint_elasticity"
    in_torques = True
    reads_as = "encoder offset, where the joint's load hardly changes"
    leaves = ("encoder_offset",)
    changes = "q"
    least_shrink = 0.15

    places = staticmethod(visible_joints)
    # Compliance of the unloaded joint, one over its stiffness, and how that changes with load.
    own = (
        Parameter("compliance", "rad/(N·m)", 3e-3, 1e-4),
        Parameter("stiffening", "rad/(N·m)", 1e-3, 1e-4),
    )

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Bend the joint, with the rates that this brings."""
        if not theta.any():
            return state
        joint = joint_of(state, location)
        bend = self.joint_bend(state, joint, theta)[0]
        rate = state.record.differentiate_signal(bend)
        return state.move_joint(joint, q=bend, v=rate, a=state.record.differentiate_signal(rate))

    def residual_columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's columns along what each parameter lets it yield."""
        joint = joint_of(state, location)
        yields = self.joint_bend(state, joint, theta)[1]
        rates = state.record.differentiate_signal(yields)
        bent = self.apply_to(state, location, theta)
        return joint_turn(bent, joint).residual_columns(
            state.readings, yields, rates, state.record.differentiate_signal(rates)
        )

    def report_parameters(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Stiffness of the unloaded joint, and the parameters."""
        if not theta[0]:
            return super().report_parameters(state, location, theta, std)
        stiffness = 1.0 / float(theta[0])
        spread = abs(stiffness * float(std[0] / theta[0]))
        return {
            "stiffness": Estimate(stiffness, spread, "N·m/rad"),
            **super().report_parameters(state, location, theta, std),
        }

    def joint_bend(self, state: State, joint: int, theta: Array) -> tuple[Array, Array]:
        """What a joint yields, ``(n,)`` [rad], and its derivative by each parameter, ``(n, 2)``.

        A bent joint leans further, which changes its torque: to first order by what a turn of the joint alone makes
        of it. Rates are left out, since they would bring noise of accelerations into the torque a second time.
        """
        at = loads_of(state, joint)
        torque, loads, softer = at.torque, at.by_parameter, at.per_torque
        if not theta.any():
            return np.zeros(len(torque)), -loads
        adds = -leaning_of(state, joint)[:, None] * softer
        more = 1.0 / (1.0 - np.minimum(adds @ theta, MOST_ADDED))
        bend = more * (-loads @ theta)
        return bend, more[:, None] * (bend[:, None] * adds - loads)


@dataclass(frozen=True, eq=False)
class Loads:
    """What makes a joint yield.

    Attributes:
        torque: that it carries, ``(n,)`` [N·m].
        by_parameter: what each parameter makes it yield by, ``(n, 2)``.
        per_torque: the change of that with the torque, ``(n, 2)``.
    """

    torque: Array
    by_parameter: Array
    per_torque: Array


def loads_of(state: State, joint: int) -> Loads:
    """The loads of a joint, by its index in the tree."""
    torque = state.smooth_torques[:, state.tree.idx_v[joint]]
    ratio = np.abs(torque) / max(float(np.abs(torque).max()), 1e-9)
    return Loads(
        torque,
        np.column_stack([torque, ratio * torque]),
        np.column_stack([np.ones_like(ratio), 2.0 * ratio]),
    )


def leaning_of(state: State, joint: int) -> Array:
    """``(n,)`` change of a joint's torque by its own turn [N·m/rad]."""
    iv = state.tree.idx_v[joint]
    return (state.move_joint(joint, q=_TURN).smooth_torque(iv) - state.smooth_torques[:, iv]) / _TURN


# A joint does not sit where the model says.


class LinkLengthError(FloatingEffect):
    """True placement of the joint = the model's + error, in the parent's frame."""

    name = "link_length_error"
    in_torques = True
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    reads_as = "sensor frame at the leg's end; inertia of what the joint carries"
    changes = "tree"
    places = staticmethod(visible_joints)
    # Displacement of the joint's origin; the contract counts the model's placement less the true one.
    own = Parameter.of_names("xyz", "m", 0.015, 1e-3)
    counts = -1.0

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Move the joint."""
        translations = state.tree.translations.copy()
        translations[joint_of(state, location)] += theta
        return state.replace(tree=replace(state.tree, translations=translations))


# Markers or straps on soft tissue: a segment seems to turn when the body shakes.

_CUTOFF_HZ = 3.0


class SoftTissue(FloatingEffect):
    """The true angles of a segment's joints differ from those logged by what its acceleration does to the tissue.

    Tissue on a spring and a damper follows the acceleration of the joint's origin as an oscillator does:
    ``inertia·φ'' + lag·φ' + φ = by·acceleration`` (Leardini et al. 2005 review what such artefacts look like).
    """

    name = "soft_tissue"
    observed_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    reads_as = "elasticity, where the joint's load is the segment's own inertia"
    changes = "q"
    least_shrink = 0.3

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with mass; joints through massless links belong to the next link with mass."""
        return tuple(dict.fromkeys(self._next_massive_link(state, name) for name in visible_joints(state)))

    def parameters_at(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Each joint's angle by acceleration in the world's axes; the tissue's damper and inertia."""
        names = [f"{name}_by_{axis}" for name in self._joints_of_link(state, location) for axis in "xyz"]
        tissue = (Parameter("lag", "s", 0.015, 1e-3), Parameter("inertia", "s²", 1e-3, 1e-4))
        return Parameter.of_names(names, "rad·s²/m", 0.03, 1e-3) + tissue

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Turn the joints, with the rates that this brings."""
        turned = [joint_of(state, name) for name in self._joints_of_link(state, location)]
        turns = self._tissue_motion(state, turned[0], theta[-2:])
        for joint, by in zip(turned, theta[:-2].reshape(-1, 3), strict=True):
            turn, rate, again = turns @ by
            state = state.move_joint(joint, q=turn, v=rate, a=again)
        return state

    def residual_columns(self, state: State, location: str, theta: Array) -> Array:
        """The joints' columns along what each parameter makes them do."""
        turned = [joint_of(state, name) for name in self._joints_of_link(state, location)]
        there = self.apply_to(state, location, theta) if theta.any() else state
        here, each, tissue = self._tissue_motion(state, turned[0], theta[-2:]), theta[:-2].reshape(-1, 3), []
        for i, parameter in enumerate(self.parameters_at(state, location)[-2:]):
            ahead = theta[-2:].copy()
            ahead[i] += parameter.step
            moved = self._tissue_motion(state, turned[0], ahead) - here if each.any() else np.zeros_like(here)
            tissue.append(moved / parameter.step)
        own, shared = [], np.zeros((len(state.q), 6, len(tissue)))
        for joint, by in zip(turned, each, strict=True):
            changes = np.concatenate([here, *((moved @ by)[..., None] for moved in tissue)], axis=2)
            columns = joint_turn(there, joint).residual_columns(state.readings, *changes)
            own.append(columns[:, :, :3])
            shared = shared + columns[:, :, 3:]
        return np.concatenate([*own, shared], axis=2)

    def _tissue_motion(self, state: State, joint: int, tissue: Array) -> Array:
        """``(3, n, 3)`` angle, velocity and acceleration for each axis' unit of angle by acceleration.

        Args:
            joint: index in the tree.
            tissue: ``lag`` and ``inertia``.
        """
        out = np.empty((3, len(state.q), 3))
        point = state.poses.translation[:, joint]
        for span in state.record.spans:
            n = span.stop - span.start
            omega = 2.0 * np.pi * np.fft.rfftfreq(n, 1.0 / state.record.rate_hz)
            # Noise of accelerations is left out as a low-pass without phase does.
            follows = -(omega**2) / (1.0 + (omega / (2.0 * np.pi * _CUTOFF_HZ)) ** 8)
            follows = follows / (1.0 + 1j * omega * tissue[0] - omega**2 * tissue[1])
            line = np.linspace(0.0, 1.0, n)[:, None] * (point[span][-1] - point[span][0])
            turn = np.fft.rfft(point[span] - line, axis=0) * follows[:, None]
            for order in range(3):
                out[order, span] = np.fft.irfft(turn * (1j * omega[:, None]) ** order, n, axis=0)
        return out

    def _joints_of_link(self, state: State, link: str) -> tuple[str, ...]:
        """The joints that belong to a link."""
        return tuple(name for name in visible_joints(state) if self._next_massive_link(state, name) == link)

    def _next_massive_link(self, state: State, joint: str) -> str:
        """The next link with mass at or after a joint, along single children."""
        record, index = state.record, joint_of(state, joint)
        while record.tree.phi[10 * (index - 1)] == 0.0:
            children = np.flatnonzero(record.tree.parents == index)
            if len(children) != 1:
                break
            index = int(children[0])
        return record.robot.segments[index - 1].link


# A joint that bends under its load and is soft enough for what it carries to swing on it.

# Steps of the parameters [rad/(N·m)]; a turn's acceleration by which inertia is measured [rad/s²].
_STEPS, _ACCELERATION = (1e-6, 1e-6), 1.0
# How near to what the spring holds back the inertia may come: noise is all that there is of a motion at resonance.
_NEAR_RESONANCE = 0.15


class SwingingJoint(JointElasticity):
    """True angle = logged − bend, with what the bend's own acceleration adds to the torque that bends the joint.

    Parameters as of :class:`JointElasticity`. The encoder sits before the spring (Spong 1987): what is behind it moves
    as the bend says, and resists with its inertia. Near the frequency at which it would swing on the joint a small
    motion of the encoder is a large one of it.
    """

    form = "swinging_joint"

    def joint_bend(self, state: State, joint: int, theta: Array) -> tuple[Array, Array]:
        """What a joint yields, ``(n,)`` [rad], and its derivative by each parameter, ``(n, 2)``."""
        at = loads_of(state, joint)
        torque, loads, softer = at.torque, at.by_parameter, at.per_torque
        if not theta.any():
            return np.zeros(len(torque)), -loads
        leaning, faster = leaning_of(state, joint), state.move_joint(joint, a=_ACCELERATION)
        inertia = float((faster.smooth_torque(state.tree.idx_v[joint]) - torque).mean()) / _ACCELERATION

        def bend_at(theta: Array) -> Array:
            compliance = softer @ theta
            held = 1.0 + np.maximum(compliance * leaning, -MOST_ADDED)
            ratio = inertia * float(compliance.mean()) / float(held.mean())
            return _bend_with_inertia(state, -(loads @ theta) / held, ratio)

        here = bend_at(theta)
        steps = np.diag(_STEPS)
        return here, np.column_stack([(bend_at(theta + step) - here) / step.sum() for step in steps])


def _bend_with_inertia(state: State, static: Array, ratio: float) -> Array:
    """``(n,)`` bend with inertia, ``b + ratio b'' = static``, smooth as motion is: no free oscillation is in it.

    Args:
        state: for its trials and rate.
        static: the bend without.
        ratio: of inertia to stiffness [s²].
    """
    out = np.empty_like(static)
    for span in state.record.spans:
        n = span.stop - span.start
        omega = np.pi * np.arange(n) * state.record.rate_hz / n
        left = 1.0 - ratio * omega**2
        follows = left * (1.0 + _NEAR_RESONANCE**2) / (left**2 + _NEAR_RESONANCE**2)
        # Cosines meet the ends of a trial without a jump.
        out[span] = idct(dct(static[span]) * follows)
    return out


# Part of a segment's mass wobbles on it: viscera, fat, a load on foam.

# A mass that sags further under its weight hangs, and is no tissue [m].
_MOST_SAG = 0.12
# A segment of less than this share of the whole mass moves no sensor by what wobbles on it.
_LEAST_SHARE = 0.02
# Frequencies at which it is looked for [Hz], and the share of critical damping there.
_BEGINNINGS_HZ, _DAMPING = (1.6, 2.1, 3.0), 0.2
_MASS_STEP = 0.05


@dataclass(frozen=True)
class WobblingMass(FloatingEffect):
    """A point-like part m of a segment's mass on a spring and damper alike in all directions (Gruber et al. 1998).

    The model holds it where it rests. From there it is displaced by Δ, in the world's axes:
    ``Δ'' + 2ζω Δ' + ω² Δ = −(a − g) − R ḡ``, with a the acceleration of its place, R the segment's rotation and ḡ the
    mean gravity in the segment's frame, under which it rests. It pulls at the segment by −m Δ'' more than the model
    says, and its weight and inertia act at Δ from where the model has them.

    Attributes:
        level: whether it moves in the horizontal alone, as liquid in a tank or a pendulum does: no tissue.
    """

    level: bool = False

    name = "soft_tissue"
    form = "wobbling_mass"
    reads_as = "an external force, and elasticity of the joints that carry the segment"
    changes = "extra"
    least_shrink = 0.3

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with a good part of the whole mass."""
        whole = state.record.tree.phi[::10].sum()
        return tuple(link for link in link_names(state) if self._own_mass(state, link) > _LEAST_SHARE * whole)

    def parameters_at(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Mass, where it rests, and how it wobbles: logarithms, so that neither can be negative."""
        return (
            Parameter("mass", "kg", 0.5 * self._own_mass(state, location), _MASS_STEP, low=0.0),
            *POINT,
            Parameter("log_frequency", "", 1.0, 1e-2),
            Parameter("log_damping", "", 0.7, 1e-2),
        )

    def fit_starts(self, state: State, location: str) -> tuple[Array, ...]:
        """No mass, at several frequencies: a resonance is found from near it alone."""
        slowest = _slowest_hz(state)
        logs = (float(np.log(hertz / slowest - 1.0)) for hertz in _BEGINNINGS_HZ if hertz > slowest)
        return tuple(np.array([0.0, 0.0, 0.0, 0.0, log, 0.0]) for log in logs)

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Let it wobble; it is a part of the segment's mass, and nothing below zero."""
        mass = self._bounded_mass(state, location, theta)
        if not mass:
            return state
        segment = segment_of(state, location)
        held = state.on_unit_mass(segment, theta[1:4])
        displaced, further = self._mass_motion(state, segment + 1, theta, held)
        wrench = state.at_base(-mass * further, state.poses.point(segment + 1, theta[1:4]))
        moment = cross_rows(displaced, -mass * (held + further))
        wrench[:, 3:] += np.einsum("nji,nj->ni", state.poses.rotation[:, 1], moment)
        return state.replace(extra=state.extra + wrench)

    def residual_columns(self, state: State, location: str, theta: Array) -> Array:
        """Where there is no mass, how it would wobble does not matter."""
        if theta[0] > 0.0:
            return super().residual_columns(state, location, theta)
        ahead = theta.copy()
        ahead[0] = _MASS_STEP
        columns = np.zeros((len(state.q), 6, len(theta)))
        columns[:, :, 0] = (state.residual - self.apply_to(state, location, ahead).residual) / _MASS_STEP
        return columns

    def report_parameters(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Mass and place as they are; frequency and damping ratio for their logarithms."""
        hertz, ratio = _natural_frequency(state, theta), _damping_ratio(theta)
        spread = (hertz - _slowest_hz(state)) * float(std[4])
        theta = np.array([self._bounded_mass(state, location, theta), *theta[1:]])
        straight = list(super().report_parameters(state, location, theta, std).items())[:4]
        return dict(straight) | {
            "frequency": Estimate(hertz, spread, "Hz"),
            "damping_ratio": Estimate(ratio, ratio * float(std[5]), ""),
        }

    def _mass_motion(self, state: State, joint: int, theta: Array, held: Array) -> tuple[Array, Array]:
        """Displacement from where it rests and the acceleration of that, each ``(n, 3)``, world.

        A trial begins with the mass where its load holds it.
        """
        omega, ratio = 2.0 * np.pi * _natural_frequency(state, theta), _damping_ratio(theta)
        rotation = state.poses.rotation[:, joint]
        upright = np.einsum("nji,j->i", rotation, -state.tree.gravity)
        upright *= np.linalg.norm(state.tree.gravity) / np.linalg.norm(upright)
        load = rotation @ upright - held
        if self.level:
            up = -state.tree.gravity / np.linalg.norm(state.tree.gravity)
            load = load - (load @ up)[:, None] * up
        # scipy.signal takes 0.4 s to load, and an arm's diagnosis, which loads this module too, needs none of it.
        from scipy.signal import lfilter

        filters = _mass_filters(omega, ratio, 1.0 / state.record.rate_hz)
        displaced, further = np.empty_like(load), np.empty_like(load)
        for span in state.record.spans:
            change = load[span] - load[span][0]
            for out, (top, bottom) in zip((displaced, further), filters, strict=True):
                out[span] = lfilter(top, bottom, change, axis=0)
            displaced[span] += load[span][0] / omega**2
        return displaced, further

    def _bounded_mass(self, state: State, location: str, theta: Array) -> float:
        return float(np.clip(theta[0], 0.0, self._own_mass(state, location)))

    def _own_mass(self, state: State, link: str) -> float:
        return float(state.record.tree.phi[10 * segment_of(state, link)])


def _slowest_hz(state: State) -> float:
    """Frequency at which a mass sags by the most that tissue does [Hz]."""
    return float(np.sqrt(np.linalg.norm(state.tree.gravity) / _MOST_SAG) / (2.0 * np.pi))


def _natural_frequency(state: State, theta: Array) -> float:
    """Natural frequency [Hz], above the slowest one whatever the parameter."""
    return _slowest_hz(state) * float(1.0 + np.exp(np.clip(theta[4], -20.0, 5.0)))


def _damping_ratio(theta: Array) -> float:
    """Share of critical damping, within what filters can express."""
    return _DAMPING * float(np.exp(np.clip(theta[5], -6.0, 6.0)))


@lru_cache(maxsize=32)
def _mass_filters(omega: float, ratio: float, step: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Numerator and denominator of the displacement and of its acceleration, the load changing linearly in a step."""
    # As lfilter above.
    from scipy.signal import cont2discrete

    spring = [1.0, 2.0 * ratio * omega, omega**2]
    (top, bottom, _), (again, same, _) = (
        cont2discrete((top, spring), step, "foh") for top in ([1.0], [1.0, 0.0, 0.0])
    )
    return (top.ravel(), bottom), (again.ravel(), same)
