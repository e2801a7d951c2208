"""What identification on virtual robots makes of designed motions, beside what their plan promised."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.minutes.measured import SECONDS
from excite.campaign.plan import plan
from excite.excitation.precision import nominal_values
from excite.excitation.targets import NEGLIGIBLE
from excite.identification.identify import identify
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS, measured_columns
from excite.robot.loading import load_robot
from excite.simulation.simulate import run_experiment
from excite.simulation.virtual_robot import changed_robot

# Seeds of the virtual robots.
ROBOTS = (3, 11)


@dataclass(frozen=True)
class Identified:
    """One identification.

    Attributes:
        robot: its name.
        seed: of the plan.
        truth: seed of the virtual robot.
        motions: ``minutes``, or ``best_three`` of every joint.
        seconds: of the chosen motions [s].
        targets: base parameters whose value in the model counts.
        promised: of them those that the plan predicts within 15 %.
        found: of them those that the identification finds within 15 %.
        kept: share of the promised ones that are found so.
        ratio: found standard deviation over predicted, median of the targets.
        off: targets whose true value lies more than two standard deviations from the found one.
    """

    robot: str
    seed: int
    truth: int
    motions: str
    seconds: float
    targets: int
    promised: int
    found: int
    kept: float
    ratio: float
    off: int

    def row(self) -> dict[str, Any]:
        """For a table."""
        return asdict(self)


def identify_designs(name: str, seed: int) -> Iterator[Identified]:
    """Rows of one robot and seed of the plan."""
    robot = load_robot(name)
    base = structural_base_parameters(robot, DRIVE_TERMS)
    nominal = dict(zip(base.labels, nominal_values(robot, base), strict=True))
    targets = [label for label in base.labels if abs(nominal[label]) > NEGLIGIBLE]
    for kind in ("minutes", "best_three"):
        made = plan(robot, minutes=SECONDS[name] / 60.0 if kind == "minutes" else None, seed=seed)
        if made.outlook is None:
            continue
        expected = {one.name: one for one in made.outlook.parameters}
        rsd = {label: expected[label].rsd_percent for label in targets}
        promised = {label for label, one in rsd.items() if one is not None and one <= made.target_rsd}
        for truth in ROBOTS:
            virtual = changed_robot(robot, np.random.default_rng(truth))
            log = run_experiment(virtual, made.motions, seed=truth).log
            found = {one.name: one for one in identify(robot, log).base}
            drives = virtual.drives
            inertial = virtual.truth.phi[measured_columns(robot, DRIVE_TERMS).inertial]
            blocks = {
                "viscous": drives.viscous + drives.bearing_viscous,
                "coulomb": drives.coulomb + drives.bearing_coulomb,
                "offset": np.zeros(robot.n_joints),
                "armature": drives.armature,
            }
            values = base.values(np.concatenate([inertial, *(blocks[term] for term in DRIVE_TERMS)]))
            true = dict(zip(base.labels, values, strict=True))
            there = [label for label in targets if label in found]
            met = {label for label in there if (found[label].rsd_percent or np.inf) <= made.target_rsd}
            ratios = [
                found[label].rsd_percent * abs(found[label].value) / (one * abs(nominal[label]))
                for label in there
                if (one := rsd[label])
            ]
            yield Identified(
                robot=name,
                seed=seed,
                truth=truth,
                motions=kind,
                seconds=made.duration_s,
                targets=len(targets),
                promised=len(promised),
                found=len(met),
                kept=len(met & promised) / max(len(promised), 1),
                ratio=float(np.median(ratios)),
                off=sum(
                    bool(abs(found[label].value - true[label]) > 2.0 * found[label].std) for label in there
                ),
            )
