"""Laws that act on hidden robots alone: what no user injects, and what a diagnosis has to tell from effects."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from excite.simulation.effects.laws import Step
from excite.simulation.virtual_robot import Plant


@dataclass(frozen=True)
class PulseLaw:
    """Half waves of torque at regular times, as of a machine beside the arm that knocks at it."""

    joint: int
    size: float  # peak [N·m]
    period: float  # from one pulse to the next [s]
    width: float  # of a pulse [s]

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        i = int(plant.joint_dof[self.joint])

        def step() -> None:
            since = (plant.session_s + plant.data.time) % self.period
            if since < self.width:
                plant.torque[i] += self.size * float(np.sin(np.pi * since / self.width))

        return step


@dataclass(frozen=True)
class HoseLaw:
    """A hose between two joints that pulls at one of them as the other one turns: ``size · sin(rate q + phase)``."""

    joint: int  # index of the joint that is pulled
    other: int  # index of the joint that decides how much
    size: float  # largest pull [N·m]
    rate: float  # [rad/rad]
    phase: float  # [rad]

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        i, at = int(plant.joint_dof[self.joint]), int(plant.qpos[plant.robot.n_base_q + self.other])

        def step() -> None:
            angle = self.rate * float(plant.data.qpos[at]) + self.phase
            plant.torque[i] += self.size * float(np.sin(angle))

        return step


@dataclass(frozen=True)
class GripLaw:
    """A worn brake that grips and lets go at random: dry friction steps up and down."""

    joint: int
    level: float  # friction while it grips [N·m]
    dwell: float  # mean time in either state [s]
    seed: int  # of the times; others in every run

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        rng = np.random.default_rng([self.seed, int(1000.0 * plant.session_s)])
        grips, until = False, float(rng.exponential(self.dwell))

        def step() -> None:
            nonlocal grips, until
            while plant.data.time > until:
                grips, until = not grips, until + float(rng.exponential(self.dwell))
            if grips:
                plant.friction[self.joint] += self.level

        return step


@dataclass(frozen=True)
class PokeLaw:
    """Smooth random torque on a joint, as of somebody who leans on the arm."""

    joint: int
    size: float  # standard deviation [N·m]
    seed: int  # of the numbers; another in every run

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        rng = np.random.default_rng([self.seed, int(1000.0 * plant.session_s)])
        i, hz = int(plant.joint_dof[self.joint]), rng.uniform(0.3, 3.0, 8)
        phase = rng.uniform(0.0, 2.0 * np.pi, 8)

        def step() -> None:
            waves = np.sin(2.0 * np.pi * hz * plant.data.time + phase)
            plant.torque[i] += self.size * 0.5 * float(waves.sum())

        return step


@dataclass(frozen=True)
class StopLaw:
    """A soft stop that a joint runs into: one-sided, ``−stiffness (q − edge)`` beyond an edge."""

    joint: int
    edge: float  # where it begins [rad]
    stiffness: float  # [N·m/rad]

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        at = int(plant.qpos[plant.robot.n_base_q + self.joint])
        i = int(plant.joint_dof[self.joint])

        def step() -> None:
            depth = float(plant.data.qpos[at]) - self.edge
            if depth > 0.0:
                plant.torque[i] -= self.stiffness * depth

        return step


@dataclass(frozen=True)
class BristleLaw:
    """The LuGre model in place of a joint's dry friction (Canudas de Wit et al. 1995, eqs. 1 to 5)."""

    joint: int
    level: float  # Coulomb friction [N·m]; the drive's own is replaced
    excess: float = 0.0  # static less Coulomb friction [N·m]
    velocity: float = 0.1  # Stribeck velocity [rad/s]
    breakaway: float = 2e-3  # deflection of the bristles at which they slip [rad]

    def start(self, plant: Plant) -> Step:
        """The law on a plant: what is called before every step of the physics."""
        j, i = self.joint, int(plant.joint_dof[self.joint])
        h = float(plant.model.opt.timestep)
        inertia = max(float(plant.drives.armature[j]), 1e-3)
        stiffness = min(self.level / self.breakaway, 0.1 * inertia / h**2)
        damping = math.sqrt(stiffness * inertia)
        z = 0.0

        def step() -> None:
            nonlocal z
            v = float(plant.data.qvel[i])
            slip = self.level + self.excess * math.exp(-((v / self.velocity) ** 2))
            new = (z + h * v) / (1.0 + h * stiffness * abs(v) / slip)
            rate, z = (new - z) / h, new
            # Damping of the bristles dies out with speed, or sliding would be viscous.
            force = stiffness * z + damping * rate * math.exp(-((v / 0.05) ** 2))
            plant.friction[j] -= float(plant.drives.total_coulomb[j])
            plant.torque[i] -= force

        return step
