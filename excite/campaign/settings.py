"""What a campaign is asked for."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from excite.errors import InputError
from excite.identification.estimators.registry import find_estimator


@dataclass(frozen=True)
class CampaignSettings:
    """Settings of a campaign; a resumed one has to have the same.

    Attributes:
        n_candidates: candidate motions in the first iteration; later ones, which aim at few joints, get a quarter.
        target_rsd: relative standard deviation that essential base parameters have to reach [percent].
        max_iterations: iterations at most.
        method: registry name of the estimator.
        seed: of all random numbers.
        on_robot: stop after each plan, so that the motions are recorded on a real robot.
    """

    n_candidates: int = 140
    target_rsd: float = 15.0
    max_iterations: int = 3
    method: str = "qp"
    seed: int = 0
    on_robot: bool = False

    def __post_init__(self) -> None:
        """Check the bounds and the method; raises InputError naming the setting, or UnknownNameError."""
        for name in ("n_candidates", "max_iterations"):
            if getattr(self, name) < 1:
                raise InputError(f"is {getattr(self, name)}", field=name, remedy="give at least 1")
        find_estimator(self.method)
        if not (math.isfinite(self.target_rsd) and self.target_rsd > 0.0):
            raise InputError(f"is {self.target_rsd}", field="target_rsd", remedy="give a positive percentage")

    def to_json(self) -> dict[str, Any]:
        """All settings by name."""
        return asdict(self)
