"""Plans for minutes at the robot beside the best three motions of every joint: seconds for targets, D-efficiency."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from excite.campaign.plan import Plan, plan
from excite.errors import InputError
from excite.excitation.design_rows import ArmRows
from excite.excitation.state_bound import bound_log_det, d_efficiency
from excite.excitation.targets import NEGLIGIBLE
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

# Seconds at the robot that are asked for: bars of UR10, G1, Go2 and Solo12, of others what meets most targets.
SECONDS = {"ur10": 22.0, "panda": 26.0, "iiwa14": 53.0, "g1": 80.0, "go2": 120.0, "solo12": 120.0}


@dataclass(frozen=True)
class Measured:
    """What a plan promises.

    Attributes:
        robot: its name.
        seed: of the plan.
        motions: ``minutes``, or ``best_three`` of every joint.
        seconds: of the chosen motions [s].
        targets: base parameters whose value in the model counts.
        met: of them those that are predicted within 15 %.
        seconds_for_all: of motion like this until all are [s]; infinite where it says nothing of one.
        seconds_for_half: until half of them are [s].
        d_efficiency: against the bound over states; None of robots without one.
        wall_s: time that planning took [s].
        processor_s: processor time of this process [s].
    """

    robot: str
    seed: int
    motions: str
    seconds: float
    targets: int
    met: int
    seconds_for_all: float
    seconds_for_half: float
    d_efficiency: float | None
    wall_s: float
    processor_s: float

    def row(self) -> dict[str, Any]:
        """For a table."""
        return asdict(self)


def measure(name: str, seed: int, jobs: int) -> Iterator[Measured]:
    """Rows of one robot and seed."""
    robot = load_robot(name)
    bound = _bound(robot)
    for kind in ("minutes", "best_three"):
        began, worked = time.perf_counter(), time.process_time()
        made = plan(robot, minutes=SECONDS[name] / 60.0 if kind == "minutes" else None, seed=seed, jobs=jobs)
        took = time.perf_counter() - began, time.process_time() - worked
        needed = np.sort(_needed_seconds(made))
        yield Measured(
            robot=name,
            seed=seed,
            motions=kind,
            seconds=made.duration_s,
            targets=len(needed),
            met=int((needed <= made.duration_s).sum()),
            seconds_for_all=float(needed[-1]),
            seconds_for_half=float(needed[(len(needed) - 1) // 2]),
            d_efficiency=None if bound is None else d_efficiency(ArmRows(robot), list(made.motions), bound),
            wall_s=took[0],
            processor_s=took[1],
        )


def _needed_seconds(made: Plan) -> np.ndarray:
    """Seconds of motion like this for each target, ``(n,)``."""
    if made.outlook is None:
        return np.full(1, np.inf)
    rsd = [
        np.inf if one.rsd_percent is None else one.rsd_percent
        for one in made.outlook.parameters
        if abs(one.value) > NEGLIGIBLE
    ]
    return made.duration_s * (np.array(rsd) / made.target_rsd) ** 2


def _bound(robot: Robot) -> float | None:
    try:
        return bound_log_det(ArmRows(robot))
    except InputError:
        return None
