"""What a plan is: motions that were found safe and chosen, and what they promise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import all_or_nothing
from excite.campaign.candidates.refusal import REFUSALS_FILE, Refusals
from excite.campaign.expected.forecast import TARGET_RSD, Forecast
from excite.campaign.expected.outlook import Outlook, is_predictable, outlook
from excite.campaign.on_disk import OnDisk
from excite.campaign.plan_document import conditioning_comparison, robot_file
from excite.campaign.pool import Pool
from excite.campaign.rehearsal import UNKNOWN_LOAD
from excite.documents.document import read_document
from excite.documents.plan import Plan as PlanDocument
from excite.errors import InputError
from excite.excitation.conditioning import Conditioning, MotionFactor
from excite.excitation.selection import Selection
from excite.json_document import write_json
from excite.motion.files import save_motion
from excite.motion.motion import Motion
from excite.report.data import ReportData, save_report_data
from excite.robot.robot import Robot
from excite.robot.shapes.stand_ins import shape_conditions
from excite.safety.verdict import Robustness, conditions, robustness_of_all
from excite.shown import Row, Tabled, count

SCHEMA = "excite.plan/1"


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Tabled):
    """Motions that were found safe and chosen because they excite the parameters.

    Attributes:
        robot: the robot.
        generated: number of candidates.
        rejected: by reason, how many candidates the filter refused.
        refusals: what refused them, where, and the change that would help most.
        pool: every accepted motion, in the order of the candidates.
        selection: which of them go on, and for which segments.
        validation: accepted motions that were not chosen and that judge the result, as indices.
        conditioning: of the chosen motions together.
        unchosen: conditioning of as many seconds of accepted motions taken as they come, for comparison.
        stages: seconds by stage.
        load: that the robot carried on its back in the rehearsal, of its mass; None of a robot that cannot fall.
        target_rsd: that is asked for of the essential parameters [percent].
        before: motions that were run already, which what is to be expected counts too.
        interrupted: whether the user broke off: chosen from what was accepted by then, and not rehearsed.
        robust: least margins of each chosen motion over the robots that it may be; none where the user broke off.
    """

    robot: Robot
    generated: int
    rejected: Mapping[str, int]
    refusals: Refusals
    pool: Pool
    selection: Selection
    validation: tuple[int, ...]
    conditioning: Conditioning
    unchosen: Conditioning
    stages: Mapping[str, float]
    load: float | None = None
    target_rsd: float = TARGET_RSD
    before: tuple[Motion, ...] = ()
    interrupted: bool = False
    robust: tuple[Robustness, ...] = ()

    tables = ("motions", "segments", "base_parameters", "rejected")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.shown.Tabled`.

        The chosen motions, condition numbers by segment, what is to be expected of each base parameter (none where the
        sensors' noise is not stated), or how many candidates were refused for what.
        """
        if table == "motions":
            return [
                {
                    "motion": item.motion,
                    "segments": item.segments,
                    "duration_s": self.pool.entries[item.index].duration_s,
                }
                for item in self.selection.selected
            ]
        if table == "segments":
            return [{"segment": s.segment, "condition": s.condition} for s in self.conditioning.segments]
        if table == "rejected":
            return [{"reason": reason, "candidates": n} for reason, n in sorted(self.rejected.items())]
        return [] if self.outlook is None else [one.to_json() for one in self.outlook.parameters]

    @property
    def accepted(self) -> OnDisk[Motion]:
        """The accepted motions, read from disk one by one."""
        return self.pool.motions

    @property
    def factors(self) -> OnDisk[MotionFactor]:
        """R factor of each accepted motion."""
        return self.pool.factors

    @property
    def motions(self) -> OnDisk[Motion]:
        """The chosen motions."""
        return self.accepted.only(self.selection.indices)

    @property
    def validation_motions(self) -> OnDisk[Motion]:
        """Motions for cross-validation, not among the chosen ones."""
        return self.accepted.only(self.validation)

    @cached_property
    def outlook(self) -> Outlook | None:
        """What all motions promise for each base parameter; None where the sensors' noise is not stated."""
        return outlook(self.robot, (*self.before, *self.motions)) if is_predictable(self.robot) else None

    @property
    def forecast(self) -> Forecast | None:
        """What that makes of the target; None without an outlook."""
        if self.outlook is None:
            return None
        seconds = self.duration_s + sum(motion.duration for motion in self.before)
        return Forecast.of(self.outlook.essential_rsd, self.target_rsd, seconds)

    @property
    def duration_s(self) -> float:
        """Duration of the chosen motions together [s]."""
        return float(sum(self.pool.durations[list(self.selection.indices)]))

    def to_json(self) -> dict[str, Any]:
        """The ``excite.plan/1`` document."""
        return {
            "schema": SCHEMA,
            "robot": self.robot.name,
            "candidates": {
                "generated": self.generated,
                "accepted": len(self.pool.entries),
                "rejected": dict(sorted(self.rejected.items())),
            },
            **self.refusals.to_json(),
            "selected": [
                {
                    "motion": f"motions/{item.motion}.parquet",
                    "segments": list(item.segments),
                    "duration_s": self.pool.entries[item.index].duration_s,
                }
                for item in self.selection.selected
            ],
            "robust": {
                item.motion: one.to_json()
                for item, one in zip(self.selection.selected, self.robust, strict=False)
            },
            "rehearsed_load": self.load,
            "interrupted": self.interrupted,
            "validation": [f"motions/{self.pool.names[i]}.parquet" for i in self.validation],
            "conditioning": dict(self.conditioning.to_json()),
            "base_parameters": []
            if self.outlook is None
            else [parameter.to_json() for parameter in self.outlook.parameters],
            "forecast": None if self.forecast is None else self.forecast.to_json(),
            "as_far_as": list(shape_conditions(self.robot)),
            "assumed": [one.model_dump() for one in self.robot.description.assumed],
            "stages": [{"stage": stage, "seconds": seconds} for stage, seconds in self.stages.items()],
        }

    def summary(self) -> str:
        """A few lines for a person."""
        refused = ", ".join(f"{n} {reason}" for reason, n in sorted(self.rejected.items())) or "none"
        judged = f"{len(self.pool.entries)} of {count(self.generated, 'candidate')} accepted"
        lines = [
            f"{self.robot.name}: {judged} (refused: {refused})",
            f"{count(len(self.selection.indices), 'motion')} chosen, {self.duration_s:.0f} s in total"
            + (f"; safe{conditions(shapes)}" if (shapes := shape_conditions(self.robot)) else ""),
        ]
        if len(self.selection.indices) < len(self.pool.entries):
            lines += [f"chosen: {self.conditioning.summary()}", f"gained: {self._gain_of_choice()}"]
        else:
            lines += [f"all that were accepted: {self.conditioning.summary()}"]
            lines += ["none is left to validate on: plan more candidates"]
        if self.interrupted:
            rehearsed = ", and nobody has rehearsed them in simulation" if self.robot.floating else ""
            lines.append(f"interrupted: the best of those accepted by then{rehearsed}")
        if self.validation:
            names = ", ".join(f"{self.pool.names[i]}.parquet" for i in self.validation)
            lines.append(f"written too, to validate on and not to identify from: motions/{names}")
        if self.robust:
            lines.append(robustness_of_all(self.robust))
        if self.load is not None and self.load < UNKNOWN_LOAD:
            lines.append(
                f"rehearsed with {self.load:.0%} of the robot's mass on its back: with {UNKNOWN_LOAD:.0%} every motion "
                "falls or slips, so its model must know its mass"
            )
        if self.refusals.few:
            lines.append(self.refusals.summary())
        if self.outlook is not None:
            lines.append(self.outlook.summary())
        if self.forecast is not None and self.forecast.needed_s:
            lines.append(self.forecast.summary())
        if self.selection.unserved:
            lines.append("excited by no single motion: " + ", ".join(self.selection.unserved))
        lines += [f"assumed: {one}" for one in self.robot.description.assumed]
        return "\n".join(lines)

    def _gain_of_choice(self) -> str:
        """What choosing gains over as many seconds of accepted motions taken as they come.

        The mean is the geometric one over the axes of the confidence ellipsoid: its volume goes with the root of the
        information's determinant.
        """
        chosen, unchosen = self.conditioning, self.unchosen
        if unchosen.rank < chosen.rank:
            return f"rank {chosen.rank}, as many seconds unchosen have {unchosen.rank}"
        if not np.isfinite(chosen.log_det):
            return "no rank: as many seconds unchosen excite as many base parameters"
        ratio = np.exp((unchosen.log_det - chosen.log_det) / (2.0 * chosen.rank))
        change = f"{abs(1.0 - ratio):.1%} {'smaller' if ratio <= 1.0 else 'larger'}"
        return (
            f"standard deviations {change} in the mean than of as many seconds unchosen "
            f"(log-determinant {unchosen.log_det:.4g})"
        )

    def report_data(self) -> ReportData:
        """What the report shows beside the JSON."""
        all_chosen = len(self.selection.indices) == len(self.pool.entries)
        before = "all that were accepted" if all_chosen else "as many seconds, unchosen"
        return ReportData(
            conditioning=conditioning_comparison(self.unchosen, self.conditioning, before, "chosen motions")
        )

    def save(self, folder: Path) -> Path:
        """Write chosen and validation motions to ``motions/``, the report's arrays and ``plan.json``: all or none.

        Motions that a plan before this one wrote into the folder are removed; other files there stay.
        """
        folder = Path(folder)
        before = _written_before(folder / "plan.json")
        with all_or_nothing():
            for motion in (*self.motions, *self.validation_motions):
                save_motion(motion, folder / "motions" / f"{motion.name}.parquet")
            save_report_data(self.report_data(), folder / "report_data.npz")
            write_json({**self.to_json(), **robot_file(self.robot, folder)}, folder / "plan.json")
        # Motions of a plan before this one are of another robot, or were chosen beside others.
        for name in before - {motion.name for motion in (*self.motions, *self.validation_motions)}:
            (folder / "motions" / f"{name}.parquet").unlink(missing_ok=True)
        # Of a plan before this one, in which nothing was safe.
        (folder / REFUSALS_FILE).unlink(missing_ok=True)
        return folder


def _written_before(file: Path) -> set[str]:
    """Names of the motions that a plan says it wrote; none where there is no plan, or none that can be read."""
    if not file.is_file():
        return set()
    try:
        plan = read_document(file, PlanDocument)
    except InputError:
        return set()
    return {Path(name).stem for name in (*(item.motion for item in plan.selected), *plan.validation)}
