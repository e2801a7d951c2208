"""Feetech STS3250 with a pendulum: commands and positions alone, and a published friction model of this servo type.

Recordings and model M6 of Rhoban's servo identification (Duclusaud, Passault, Padois, Ly, ICRA 2025). The servo drops
its load in one of three motions, with its torque switched off.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import excite
from excite.arrays import Array
from excite.logs.log import Log
from tests.reproduction.pendulum import pendulum_urdf

FOLDER = "feetech_sts3250_pendulum"
JUDGED = "2024-10-26_12h27m27"
MASS, LENGTH, GRAVITY = 1.13, 0.12, 9.80665
_LARGEST_TORQUE = 4.9
URDF = pendulum_urdf("sts3250_pendulum", "servo", MASS, LENGTH, effort=_LARGEST_TORQUE, velocity=8.0)


def sts3250_log(data_dir: Path, folder: Path) -> Log:
    """As anybody would make it of the three files: no map, the last of them judges."""
    robot = folder / "pendulum.urdf"
    robot.write_text(URDF)
    return excite.convert(sorted((data_dir / FOLDER).glob("2024*.json")), robot, folder / "sts3250").log


def published_error(data_dir: Path) -> float:
    """What the published model M6 leaves of the judged motion, replayed from its first row [rad]."""
    model = json.loads((data_dir / FOLDER / "published_m6.json").read_text())
    entries = json.loads((data_dir / FOLDER / f"{JUDGED}.json").read_text())["entries"]
    time, goal, measured = (
        np.array([entry[key] for entry in entries]) for key in ("timestamp", "goal_position", "position")
    )
    replayed = _replay(model, time, goal, float(measured[0]))
    return float(np.sqrt(np.mean((measured - replayed) ** 2)))


def _replay(model: dict[str, float], time: Array, goal: Array, start: float, dt: float = 5e-4) -> Array:
    """Positions at ``time (n,)`` of a position-controlled pendulum with friction that stops it within a step."""
    fine = np.arange(time[0], time[-1] + dt, dt)
    wanted = np.interp(fine, time, goal)
    inertia = MASS * LENGTH**2 + model["inertia"]
    q, v = start, 0.0
    found = np.empty(len(fine))
    for k, aim in enumerate(wanted):
        found[k] = q
        drive = np.clip(
            model["stiffness"] * (aim - q) - model["damping"] * v, -_LARGEST_TORQUE, _LARGEST_TORQUE
        )
        weight = -MASS * GRAVITY * LENGTH * np.sin(q)
        stopping = inertia / dt * v + drive + weight
        friction = min(abs(stopping), _friction(model, drive, weight, v) + model["friction_viscous"] * abs(v))
        v += (drive + weight - np.sign(stopping) * friction) / inertia * dt
        q += v * dt
    return np.interp(time, fine, found)


def _friction(model: dict[str, float], drive: float, weight: float, v: float) -> float:
    """Dry friction of the model M6 [N·m]."""
    slow = np.exp(-(abs(v / model["dtheta_stribeck"]) ** model["alpha"]))

    def of_load(kind: str) -> float:
        return float(
            abs(weight * model[f"load_friction_external{kind}"] - drive * model[f"load_friction_motor{kind}"])
        )

    found = model["friction_base"] + of_load("") + slow * (model["friction_stribeck"] + of_load("_stribeck"))
    if weight * drive < 0.0:
        driven = abs(weight) < abs(drive)
        share, torque = ("external", weight) if driven else ("motor", drive)
        found += slow * model[f"load_friction_{share}_quad"] * torque**2
    return float(found)
