"""Table 5 of Golluccio et al. 2020 on the virtual Jaco²: five methods, five trajectories, three criteria."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.cones import com_ellipsoids
from excite.identification.constraints.linear import bounds_about_nominal
from excite.identification.estimators.registry import find_estimator
from excite.identification.estimators.settings import ParameterBoundsSettings
from excite.identification.inertia import central_inertia_matrices
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import prior_std
from excite.motion.generators.mixture import plan_candidates
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import com_boxes
from excite.rows.settings import ProblemSettings
from excite.safety.filter import filter_candidates
from excite.simulation.virtual_robot import VirtualRobot
from tests.identification.estimated import estimated
from tests.reproduction.jaco2 import TABLE_5_CONSISTENCY
from tests.reproduction.twins import virtual_twin
from tests.simulation.motions import simulate

METHODS = {"CAD": None, "ULS": "ls", "CLS-1": "cls1", "CLS-2": "cls2", "CLS-3": "cls3"}
# "Data Filtering": second-order Butterworth, 5 Hz; the model has no friction ("The Considered Robot Model").
SETTINGS = ProblemSettings(cutoff_hz=5.0, order=2, drive_terms=())
N_TRAJECTORIES, MOTIONS_EACH = 5, 2


@dataclass(frozen=True, eq=False)
class Trajectories:
    """What the virtual Jaco² logged.

    Attributes:
        robot: the nominal robot.
        twin: the virtual one.
        problems: one a trajectory.
    """

    robot: Robot
    twin: VirtualRobot
    problems: tuple[IdentificationProblem, ...]

    def estimate(self, method: str, trajectory: int) -> Array:
        """Parameters ``(70,)`` by one of ``METHODS`` from one trajectory."""
        problem, name = self.problems[trajectory], METHODS[method]
        if name is None:
            return problem.prior.copy()
        return estimated(find_estimator(name), problem, com_boxes=com_boxes(self.robot)).parameters

    def error(self, trajectory: int, parameters: Array) -> float:
        """``ς_r`` of eq. (9): norm of the residual over the norm of the torques."""
        problem = self.problems[trajectory]
        return float(np.linalg.norm(problem.y - problem.Y @ parameters) / np.linalg.norm(problem.y))

    def criteria(self, trajectory: int, parameters: Array) -> dict[str, bool]:
        """The three rows "Additional Criteria" of Table 5."""
        problem, mass = self.problems[trajectory], parameters[::10]
        settings = ParameterBoundsSettings()
        spread = prior_std(problem, settings.spreads(self.robot))
        bounds = bounds_about_nominal(problem, spread, settings.bound_width).reshape(2, -1, 10)[:, :, 1:4]
        first = parameters.reshape(-1, 10)[:, 1:4]
        room = 1e-6 * np.abs(bounds).max()
        placed = bool(((first >= bounds[0] - room) & (first <= bounds[1] + room)).all())
        feasible = consistent = False
        if (mass > 0.0).all():
            moments = np.linalg.eigvalsh(central_inertia_matrices(parameters))
            feasible = bool((moments[:, 0] > 0.0).all())
            consistent = feasible and bool((moments[:, 0] + moments[:, 1] > moments[:, 2]).all())
            points = np.column_stack([first / mass[:, None], np.ones(len(mass))])
            ellipsoids = com_ellipsoids(problem.prior, com_boxes(self.robot))
            placed |= bool((np.einsum("si,sij,sj->s", points, ellipsoids, points) >= -1e-6).all())
        return dict(zip(TABLE_5_CONSISTENCY, (feasible, consistent, placed), strict=True))


def run(n_trajectories: int = N_TRAJECTORIES, seed: int = 4) -> Trajectories:
    """Five random trajectories of some 45 s each, run by the virtual Jaco²."""
    robot = load_robot("jaco2")
    count = n_trajectories * MOTIONS_EACH
    candidates = plan_candidates(robot, count, np.random.SeedSequence(seed), mix={"random_joint": 1.0})
    motions = filter_candidates(robot, candidates).motions
    twin = virtual_twin(robot, np.random.default_rng(seed))
    problems = []
    for i in range(n_trajectories):
        log = simulate(twin, motions[MOTIONS_EACH * i :][:MOTIONS_EACH], seed=seed)
        problems.append(build_problem(robot, log, SETTINGS))
    return Trajectories(robot, twin, tuple(problems))
