"""A log under examination: what the rules of the doctor find in it, and the log as far as it is repaired."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from excite.arrays import Flags
from excite.data_tables import read_rows
from excite.doctor.doubt import Doubt
from excite.doctor.thresholds import THRESHOLD
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.finding import Finding
from excite.logs.log import Log, Trial
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot

KINDS: dict[str, dict[str, Any]] = {
    row["kind"]: {
        "severity": row["severity"],
        "sure": float(row["sure"]),
        "repaired": row["repaired"] == "yes",
        "remedy": row["remedy"],
    }
    for row in read_rows(__file__, "findings.csv")
}
"""Of each kind of finding its severity, how sure it is, whether it is repaired, and the remedy, as a rule."""


@dataclass(eq=False)
class Case:
    """What every rule reads and changes.

    Attributes:
        robot: the nominal model.
        log: as the rules before have left it.
        findings: what was found so far.
        doubts: what the log tells only about, as far as it could not be repaired to the last.
        latest_s: torques that are less late than this are left so [s].
        differing: whether mistakes were found that some trials have and others do not.
        set_aside: joints that are taken as without a torque while mistakes are looked for.
    """

    robot: Robot
    log: Log
    findings: list[Finding] = field(default_factory=list)
    doubts: set[Doubt] = field(default_factory=set)
    latest_s: float = THRESHOLD.late_s
    differing: bool = False
    set_aside: tuple[str, ...] = ()
    _sampled: tuple[Log, TorqueSamples | None] | None = None
    _of_trials: tuple[Log, dict[str, TorqueSamples]] | None = None

    def add(
        self,
        kind: str,
        text: str,
        figures: Mapping[str, float] | None = None,
        places: tuple[str, ...] = (),
        **more: Any,
    ) -> None:
        """Note a finding; what is not given stands in the table of kinds."""
        self.findings.append(Finding(kind, text, figures or {}, places, **{**KINDS.get(kind, {}), **more}))

    def change_header(self, **update: Any) -> None:
        """Replace fields of the header."""
        self.log = replace(self.log, header=self.log.header.model_copy(update=update))

    def change_trials(self, change: Callable[[Trial], Trial]) -> None:
        """Replace every trial by what is made of it."""
        self.log = replace(self.log, trials=tuple(map(change, self.log.trials)))

    def ignore_torques(self, joints: tuple[str, ...] | list[str]) -> None:
        """Take joints as such without a torque."""
        self.change_header(no_torque=tuple(dict.fromkeys((*self.log.header.no_torque, *joints))))

    def joints(self, chosen: Flags) -> tuple[str, ...]:
        """Names of some of the log's joints."""
        return tuple(np.array(self.log.header.joints)[chosen])

    @property
    def is_strange(self) -> bool:
        """Whether the size of torques, or the model's bodies, are in doubt: nothing is told by either then."""
        return Doubt.SIZE in self.doubts or any(found.kind == "other_model" for found in self.findings)

    @property
    def columns(self) -> list[int]:
        """Indices of the log's joints among those of the robot."""
        return [self.robot.joint_index(name) for name in self.log.header.joints]

    @property
    def turning(self) -> Flags:
        """Which of the log's joints turn; the others slide."""
        model, first = self.robot.model, self.robot.n_base_v
        return np.array([not is_prismatic(model, first + k) for k in self.columns])

    @property
    def samples(self) -> TorqueSamples | None:
        """Torques beside the nominal model's; None of a free base, and where no trial can be used."""
        header = self.log.header
        if header.free_base or header.torque in {None, "none"} or not header.torque_joints:
            return None
        if self._sampled is None or self._sampled[0] is not self.log:
            self._sampled = (self.log, torque_samples(self.robot, self.log))
        return self._sampled[1]

    @property
    def trial_samples(self) -> Mapping[str, TorqueSamples]:
        """The same of each trial that can be used, whatever its role, by name."""
        trials = self.log.trials if self.samples is not None else ()
        if self._of_trials is None or self._of_trials[0] is not self.log:
            made = {t.name: replace(self.log, trials=(replace(t, role="identification"),)) for t in trials}
            found = {name: torque_samples(self.robot, log) for name, log in made.items()}
            self._of_trials = (self.log, {name: one for name, one in found.items() if one is not None})
        return self._of_trials[1]
