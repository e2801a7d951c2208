"""The experiments of Jovic et al. 2015 and 2016 on a virtual humanoid with HRP-2's arrangement and changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.campaign.experiment import Experiment
from excite.excitation.conditioning import MotionFactor, motion_factor, stack_factors
from excite.identification.estimators.registry import find_estimator
from excite.identification.identify import identify
from excite.identification.judgement import ChannelFit, channel_fits, check_consistency
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.result import Identification
from excite.logs.log import Log
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import com_boxes
from excite.rows.settings import ProblemSettings
from excite.simulation.simulate import run_experiment
from excite.simulation.virtual_robot import VirtualRobot
from tests.identification.estimated import estimated
from tests.reproduction.hrp2 import MODIFIED
from tests.reproduction.twins import virtual_twin

# T-RO 2016, section VI: third-order Butterworth, 20 Hz.
SETTINGS = ProblemSettings(cutoff_hz=20.0, order=3)


@dataclass(frozen=True, eq=False)
class Humanoid:
    """What the virtual humanoid logged.

    Attributes:
        robot: the nominal robot.
        twin: the virtual one.
        motions: what it ran for identification.
        log: of all motions in which it stood.
        direct: rows of these motions.
        cross: rows of others.
    """

    robot: Robot
    twin: VirtualRobot
    motions: tuple[Motion, ...]
    log: Log
    direct: IdentificationProblem
    cross: IdentificationProblem

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The papers' number of each segment, ``(31,)``."""
        return np.array([int(segment.name[:2]) for segment in self.robot.segments])

    def by_number(self, values: Array) -> dict[int, float]:
        """One value a segment, ``(31,)``, by the papers' number."""
        return {int(number): float(value) for number, value in zip(self.numbers, values, strict=True)}

    def settings(self) -> dict[str, Any]:
        """The papers' constants: ε = 0.01, α = 0.1, β = 0.35 for modified segments and 0.05 for others."""
        ranges = {
            s.link: 0.35 if n in MODIFIED else 0.05
            for s, n in zip(self.robot.segments, self.numbers, strict=True)
        }
        return {
            "com_boxes": com_boxes(self.robot),
            "segment_mass_range": ranges,
            "mirror": 0.1,
            "sphere_epsilon": 0.01,
        }

    def estimate(self, method: str) -> Array:
        """Inertial parameters ``(310,)`` by an estimator."""
        return estimated(find_estimator(method), self.direct, **self.settings()).parameters

    @cached_property
    def own(self) -> Identification:
        """What ``excite identify --method cls3`` says, its own filter and spreads in place of the papers'."""
        return identify(self.robot, self.log, "cls3")

    def left_by_truth(self, settings: ProblemSettings) -> dict[str, float]:
        """RMS that the true parameters leave on each axis [N, N·m]: noise of the sensors and of derivatives."""
        problem = build_problem(self.robot, self.log, settings)
        rest = problem.residual(self.twin.truth.phi)
        return {
            name: float(np.sqrt(np.mean(rest[problem.rows_of(name)] ** 2))) for name in problem.channel_names
        }

    def fits(self, parameters: Array) -> dict[tuple[str, str], ChannelFit]:
        """Fit of every axis by validation (direct, cross) and channel, CAD as reference."""
        return {
            (kind, channel): fit
            for kind, problem in (("direct", self.direct), ("cross", self.cross))
            for channel, fit in channel_fits(problem, parameters, problem.prior).items()
        }

    def inconsistent(self, parameters: Array) -> tuple[str, ...]:
        """Segments, of those that the sensors see, that cannot exist."""
        names = tuple(segment.name for segment in self.robot.segments)
        found = check_consistency(parameters, names).inconsistent
        return tuple(
            name for k, name in enumerate(names) if name in found and k not in self.direct.unmeasured
        )

    @cached_property
    def factor(self) -> MotionFactor:
        """R factor of the identification motions together."""
        return stack_factors([motion_factor(self.robot, motion) for motion in self.motions])

    def sub_regressor_conditions(self) -> dict[int, float | None]:
        """Condition number of each segment's ten columns, None beyond the ankle sensors, by number."""
        found: dict[int, float | None] = {}
        for k, number in enumerate(self.numbers):
            columns = self.factor.columns.of_segment(k)
            block = self.factor.matrix[:, columns]
            found[int(number)] = float(np.linalg.cond(block)) if len(columns) else None
        return found


def run(motions: tuple[Motion, ...], validation: tuple[Motion, ...], *, seed: int = 2) -> Humanoid:
    """Run motions on the virtual humanoid; those in which it falls are left out."""
    robot = load_robot("hrp2like")
    twin = virtual_twin(robot, np.random.default_rng(seed))
    runs = run_experiment(
        twin, [*motions, *validation], seed=seed, roles={motion.name: "validation" for motion in validation}
    )
    log = Experiment(robot, runs.log, twin.truth, runs.replays).without_falls().log
    stood = {trial.name for trial in log.trials}
    kept = tuple(motion for motion in motions if motion.name in stood)
    direct, cross = (
        build_problem(robot, log, SETTINGS, role=role) for role in ("identification", "validation")
    )
    return Humanoid(robot, twin, kept, log, direct, cross)
