"""What a campaign is asked for."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from excite.campaign.expected.forecast import TARGET_RSD, check_target
from excite.campaign.plan import MAX_CANDIDATES
from excite.identification.estimators.registry import DEFAULT_METHOD, find_estimator
from excite.reading.number import check_count, check_seed

# Each iteration is a day of recording.
_MOST_ITERATIONS = 1000


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
    target_rsd: float = TARGET_RSD
    max_iterations: int = 3
    method: str = DEFAULT_METHOD
    seed: int = 0
    on_robot: bool = False

    def __post_init__(self) -> None:
        """Check the bounds and the method; raises InputError naming the setting, or UnknownNameError."""
        check_count(self.n_candidates, "n_candidates", 1, MAX_CANDIDATES)
        check_count(self.max_iterations, "max_iterations", 1, _MOST_ITERATIONS)
        check_seed(self.seed)
        find_estimator(self.method)
        check_target(self.target_rsd)

    def to_json(self) -> dict[str, Any]:
        """All settings by name."""
        return asdict(self)
