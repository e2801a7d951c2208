"""A record of an arm with three joints, without noise, and what an effect makes of its torques."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.simulator.augmented_plant import FoundEffect
from excite.diagnosis.simulator.rollout import Drive, Plan
from excite.diagnosis.simulator.rollout_compare import rollout_errors
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot
from tests.made_log import made_log

RATE_HZ, SECONDS = 200, 6.0
VISCOUS, COULOMB, ARMATURE = np.array([[2.0, 1.5, 1.0], [0.4, 0.3, 0.2], [0.4, 0.3, 0.2]])
_LINK = """<link name="{name}"><inertial><origin xyz="{x} 0.01 0.02"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{x} 0 0"/><axis xyz="{axis}"/><limit lower="-3" upper="3" effort="90" velocity="9"/></joint>"""
URDF = f"""<robot name="three"><link name="base"/>
{_LINK.format(name="turret", x=0.05, mass=3.0)}{_LINK.format(name="upper", x=0.15, mass=2.5)}
{_LINK.format(name="lower", x=0.15, mass=1.5)}
{_JOINT.format(name="yaw", parent="base", child="turret", x=0, axis="0 0 1")}
{_JOINT.format(name="shoulder", parent="turret", child="upper", x=0.1, axis="0 1 0")}
{_JOINT.format(name="elbow", parent="upper", child="lower", x=0.35, axis="0 1 0")}</robot>"""
FULL = ("rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature")


@cache
def baseline(*, drives: bool) -> Baseline:
    """The baseline fitted to the record, with friction and rotors in both, or in neither."""
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    trials = []
    for k, role in enumerate(("identification", "validation")):
        q, v, a = np.zeros((3, len(time), 3))
        for j in range(3):
            for turns, size in ((0.31, 0.5), (0.83, 0.25)):
                w, phase = 2.0 * math.pi * turns * (1.0 + 0.13 * j), 1.3 * j + 2.1 * k + 4.0 * turns
                q[:, j] += size * np.sin(w * time + phase)
                v[:, j] += size * w * np.cos(w * time + phase)
                a[:, j] -= size * w**2 * np.sin(w * time + phase)
        model = pin.buildModelFromXML(URDF)
        data = model.createData()
        tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
        if drives:
            tau = tau + VISCOUS * v + COULOMB * np.sign(v) + ARMATURE * a
        trials.append(Trial(name=f"trial_{k}", role=role, time=time, q=q, tau=tau, start_s=40.0 * k))
    log = made_log(
        trials, ["yaw", "shoulder", "elbow"], RATE_HZ, URDF, modelled=list(FULL if drives else FULL[:1])
    )
    with TemporaryDirectory() as folder:
        read = load_log(save_log(log, Path(folder) / "log"))
        samples = arm_samples(nominal_robot(read), read, read.trials)
    return fit_baseline(samples, log.header.modelled, np.maximum(spectral_floor(samples), 1e-3))


@dataclass(frozen=True, eq=False)
class Case:
    """An effect at a place of the record, with parameters.

    Attributes:
        effect: the effect.
        location: its place.
        theta: its non-linear parameters.
        beta: its linear ones, ``(n_linear,)``.
    """

    effect: Effect
    location: str
    theta: Theta
    beta: Array

    @property
    def context(self) -> Context:
        return Context(baseline(drives=self.effect.term is None))

    @property
    def torques(self) -> Array:
        """What its columns say that it adds, ``(n_samples, n_joints)`` [N·m]."""
        shape = self.effect.shape(self.context, self.location, self.theta)
        out = np.zeros_like(self.context.baseline.total)
        for j, columns in shape.columns.items():
            out[:, j] += columns @ self.beta
        for j, offset in shape.offset.items():
            out[:, j] += offset
        return out

    @property
    def fit(self) -> Fit:
        """The baseline's fit with the parameters in it."""
        return replace(self.context.baseline.fit, extra=self.beta, extra_std=np.full(len(self.beta), 1e-3))

    @property
    def found(self) -> FoundEffect:
        """It as a simulator takes it up."""
        values = self.effect.to_sizes(self.context, self.location, self.theta, self.fit)
        return FoundEffect(self.effect, self.location, values)

    def errors(self, xml: str, *, extra: Array | None = None) -> Array:
        """RMS by which roll-outs of a model are off the record, driven by the torques that it then needs [rad]."""
        base = self.context.baseline
        samples, torque = base.samples, base.total + (self.torques if extra is None else extra)
        drives = {
            trial.name: Drive(trial.time, part)
            for trial, part in zip(samples.trials, samples.by_trial(torque), strict=True)
        }
        told = self.effect.initial_state(self.context, self.location, self.theta)
        plan = Plan(
            0.4,
            drives,
            "",
            total_s=2.0,
            growth={} if told.growth is None else {self.location: told.growth},
            deflections={} if told.deflection is None else {self.location: told.deflection},
        )
        off = rollout_errors(xml, samples, base.rigid, plan)
        return np.sqrt((off**2).mean(axis=(0, 1)))


def forms() -> dict[str, Effect]:
    """All effects of the library and all their forms, by name and class."""
    found: dict[str, Effect] = {}
    for effect in EFFECTS.values():
        for form in (effect, *effect.extended_forms, *effect.variant_forms):
            found.setdefault(f"{form.name}-{type(form).__name__}", form)
    return found


def place(effect: Effect) -> str:
    """Somewhere that the record shows well."""
    known = effect.locations(Context(baseline(drives=effect.term is None)))
    return known[len(known) // 2]
