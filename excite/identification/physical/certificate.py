"""What is proven about a retrieval's objective."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from excite.shown import percent


@dataclass(frozen=True)
class Certificate:
    """How far an objective can be from the best one that the constraints allow.

    Attributes:
        objective: ``f`` of eq. (15) of Xu et al. 2020 at the answer [N·m, or the rows' unit].
        lower_bound: no parameters within the constraints have a smaller one, by convex relaxation.
        gap: ``(objective − lower_bound) / objective``.
        relaxations: convex relaxations solved to prove it.
        optima: objective of each local optimum found, in the order of the starts: the relaxation's own, then
            random ones.
    """

    objective: float
    lower_bound: float
    gap: float
    relaxations: int
    optima: tuple[float, ...]

    def to_json(self) -> dict[str, Any]:
        """The block ``certificate`` of the document."""
        return {**asdict(self), "optima": list(self.optima)}

    def summary(self) -> str:
        """One line."""
        return (
            f"objective {self.objective:.4g}, proven not to go below {self.lower_bound:.4g} "
            f"(gap {percent(100.0 * self.gap)}, {self.relaxations} relaxations, {len(self.optima)} starts)"
        )
