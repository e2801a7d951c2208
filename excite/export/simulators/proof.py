"""Proof that what is read of the files hears every parameter: each is changed, and its torques have to follow.

Torques are linear in the parameters, so a change is known beforehand: of ten parameters by the regressor, of a joint's
friction and rotor inertia by its velocity and acceleration. What a servo is told (gains, limits, a delay) shows in no
torque of the bodies: it is read back by itself. All bodies get a small body more, and that body another
mass, first moment or inertia in turn, so that what is written is always a body; its size is such that each part of it
moves the torques well above their rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.export.models.verification import States, random_states
from excite.export.simulators.friction import with_friction
from excite.export.simulators.model_format import ModelFormat
from excite.export.simulators.subject import JOINT_TERMS, Subject
from excite.regressor.columns import PARAMETERS
from excite.regressor.kernels import joint_torque_regressor

_SEED = 11
# Torque of the added bodies, as share of the largest: large enough to be seen above rounding of single precision, and
# small enough that nothing of the model is lost in it.
_SHARE = 0.2
# Share of a parameter's own torque by which its change may be missed.
_MISSED = 0.01
# A parameter whose whole torque is below this many times the format's rounding is not seen, in any format.
_ABOVE_ROUNDING = 200.0
# Single precision, which some formats have, as share of a number.
_ROUNDED = 1e-6
# Length of a body that has none of its own [m].
_LENGTH = 0.1


@dataclass(frozen=True)
class Proof:
    """What was changed, and what the files made of it.

    Attributes:
        error: largest difference of torques from those that were found, relative to the largest.
        felt: number of parameters whose change the torques, or a servo's settings, followed.
        unseen: names of those that no torque depends on, such as the mass of a link that turns about a vertical axis.
        deaf: names of those that the files hold and that torques do not follow: there are none in what is written.
        not_held: names of those that change nothing, as the format says.
    """

    error: float
    felt: int
    unseen: tuple[str, ...]
    deaf: tuple[str, ...]
    not_held: tuple[str, ...]


def prove_taken(model_format: ModelFormat, subject: Subject) -> Proof:
    """Render, read again and change every parameter in turn.

    Args:
        model_format: the format.
        subject: what is to be written.

    Raises:
        InputError: the format takes no such robot.
        NoSolutionError: the torques are not those that were found, or do not follow a change (a bug here).
    """
    trial = _Trial(model_format, subject)
    error = trial.error()
    if not error <= model_format.tolerance and model_format.exact(subject):
        raise NoSolutionError(
            f"{model_format.name} was not written: read again, its torques are {error:.1e} off",
            remedy="report this with the robot",
        )
    felt, unseen, deaf = trial.bodies()
    not_held: list[str] = []
    for term in JOINT_TERMS:
        names = [f"{term}.{joint}" for joint in subject.robot.joint_names]
        followed = trial.joints(term)
        if term not in model_format.terms:
            not_held += names
            followed = ~followed
        felt += [name for name, good in zip(names, followed, strict=True) if good and name not in not_held]
        deaf += [name for name, good in zip(names, followed, strict=True) if not good]
    for term in model_format.servo(subject):
        heard, unheard = trial.servos(term)
        felt, deaf = felt + heard, deaf + unheard
    if deaf:
        shown = ", ".join(deaf[:6]) + (f" and {len(deaf) - 6} more" if len(deaf) > 6 else "")
        raise NoSolutionError(
            f"{model_format.name} was not written: its torques do not follow {shown}",
            remedy="report this with the robot",
        )
    return Proof(error, len(felt), tuple(unseen), tuple(deaf), tuple(not_held))


class _Followed(NamedTuple):
    """Names of inertial parameters that are followed, that nothing depends on, and that are not followed."""

    felt: list[str]
    unseen: list[str]
    deaf: list[str]


class _Trial:
    """A subject in a format, its states, and the torques that are read of it."""

    def __init__(self, model_format: ModelFormat, subject: Subject) -> None:
        self.format, self.robot = model_format, subject.robot
        self.states: States = random_states(self.robot, subject.parameters)
        states = self.states
        self.regressor = joint_torque_regressor(self.robot.model, states.q, states.v, states.a)
        self.base, self.drives = self._torques(subject)
        # What is written as a whole was read once; changes are of what torques depend on.
        self.subject = replace(subject, shapes=False)
        if subject.template is not None:
            self.subject.__dict__["mjcf"] = subject.mjcf
        self.largest = max(float(np.abs(self.base).max()), 1e-9)
        self.floor = _ABOVE_ROUNDING * model_format.tolerance * self.largest

    def _torques(self, subject: Subject) -> tuple[Array, dict[str, Array]]:
        loaded = self.format.load(subject, self.format.render(subject))
        return loaded.torques(self.states), dict(loaded.drives)

    def error(self) -> float:
        """Relative error of the torques as read, against the found parameters; what was not found is the file's."""
        drives = {}
        for term, own in self.drives.items():
            found = self.subject.term(term)
            drives[term] = np.where(np.isfinite(found), found, own)
        wanted = with_friction(self.robot, self.states.torque, self.states, drives)
        return float(np.abs(self.base - wanted).max() / max(float(np.abs(wanted).max()), 1e-9))

    def bodies(self) -> _Followed:
        """Which inertial parameters are followed."""
        added, steps = self._added()
        parameters = self.subject.parameters
        plain, _ = self._torques(self.subject.but(parameters + added.ravel(), {}))
        felt: list[str] = []
        unseen: list[str] = []
        deaf: list[str] = []
        columns = self.regressor.reshape(*self.regressor.shape[:2], -1, 10)
        for k, name in enumerate(PARAMETERS):
            more = added.copy()
            more[:, k] += steps[:, k]
            changed, _ = self._torques(self.subject.but(parameters + more.ravel(), {}))
            parts = columns[..., k] * steps[:, k]
            missed = float(np.abs(changed - plain - parts.sum(axis=2)).max())
            for segment, own in zip(self.robot.segments, np.abs(parts).max(axis=(0, 1)), strict=True):
                here = f"{segment.link}.{name}"
                if own <= self.floor:
                    unseen.append(here)
                else:
                    (felt if missed <= _MISSED * own + self.floor / 10.0 else deaf).append(here)
        return _Followed(felt, unseen, deaf)

    def _added(self) -> tuple[Array, Array]:
        """A body for each segment, ``(n, 10)``, and how far each of its parameters is changed, ``(n, 10)``."""
        n = len(self.robot.segments)
        ten = self.subject.parameters.reshape(n, 10)
        heavy = ten[:, 0] > 0.0
        length = np.full(n, _LENGTH)
        spread = np.abs(ten[:, [4, 6, 9]]).max(axis=1)
        length[heavy] = np.clip(np.sqrt(spread[heavy] / ten[heavy, 0]), 1e-3, 1.0)
        body = np.zeros((n, 10))
        body[:, 0] = 1.0
        body[:, [4, 6, 9]] = 2.0 * (length**2)[:, None]
        # Half of what would leave its pseudo-inertia, diag(l², l², l², 1), singular.
        step = 0.5 * np.column_stack([np.ones(n), *[length] * 3, *[length**2] * 6])
        columns = self.regressor.reshape(*self.regressor.shape[:2], n, 10)
        effect = np.abs(np.einsum("srnk,nk->srn", columns, body)).max(axis=(0, 1))
        size = _SHARE * self.largest / np.maximum(effect, 1e-3 * max(float(effect.max()), 1e-12))
        return body * size[:, None], step * size[:, None]

    def joints(self, term: str) -> NDArray[np.bool_]:
        """Whether the torques follow a change of a term, ``(n_joints,)``."""
        n = self.robot.n_joints
        own = self.subject.written(term)
        step = _SHARE * self.largest * np.random.default_rng(_SEED).uniform(0.5, 1.0, n)
        names = [f"{term}.{joint}" for joint in self.robot.joint_names]
        before, _ = self._torques(
            self.subject.but(self.subject.parameters, dict(zip(names, own, strict=True)))
        )
        after, _ = self._torques(
            self.subject.but(self.subject.parameters, dict(zip(names, own + step, strict=True)))
        )
        states = self.states
        zero = np.zeros_like(states.torque)
        wanted = with_friction(self.robot, zero, states, {term: step})[:, self.robot.n_base_v :]
        seen = (after - before)[:, self.robot.n_base_v :]
        missed = np.abs(seen - wanted).max(axis=0)
        return np.asarray(missed <= _MISSED * np.abs(wanted).max(axis=0))

    def servos(self, term: str) -> tuple[list[str], list[str]]:
        """Names of a term of servos that are read as written and follow a change, and of those that are not."""
        own = self.subject.servo(term)
        known = np.isfinite(own)
        more = np.random.default_rng(_SEED).uniform(1.2, 1.5, self.robot.n_joints)
        # All joints have one delay, and a change of it is several steps.
        changed = own + 10.0 * max(self.format.delay_step_s, 1e-3) if term == "delay" else own * more
        off = np.zeros(self.robot.n_joints)
        for values in (own, changed):
            other = self.subject.with_servo(term, values)
            seen = self.format.load(other, self.format.render(other)).servos[term]
            room = 0.5 * self.format.delay_step_s if term == "delay" else 0.0
            off = np.maximum(
                off, np.abs(seen - values) - room - _MISSED * np.abs(values - own) - _ROUNDED * np.abs(values)
            )
        names = [f"{term}.{joint}" for joint in self.robot.joint_names]
        heard = [name for name, there, far in zip(names, known, off, strict=True) if there and far <= 0.0]
        return heard, [
            name for name, there, far in zip(names, known, off, strict=True) if there and not far <= 0.0
        ]
