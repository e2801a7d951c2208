"""What is to be expected of an experiment before anything is measured: of a target, and of each base parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from excite.display import span
from excite.identification.judgement.judgement import PATIENCE
from excite.results import Positive, Seconds, Stated, Unbounded, named, stated


@dataclass(frozen=True)
class Forecast(Stated):
    """What is to be expected of a target before anything is measured.

    Standard deviations fall with the square root of the amount of motion, so that ``(rsd / target)²`` times the
    motion at hand is needed where it is more of the same kind. Motion that aims at single joints takes less.

    Attributes:
        target_rsd: relative standard deviation to reach [percent].
        seconds: motion at hand [s].
        needed_s: motion with which each essential parameter reaches the target, by its name [s].
    """

    target_rsd: Positive = field(metadata=named("target_rsd_percent"))
    seconds: Seconds
    needed_s: Mapping[str, Positive]

    @classmethod
    def of(cls, rsd_percent: Mapping[str, float], target_rsd: float, seconds: float) -> Forecast:
        """The forecast of predicted relative standard deviations [percent], by essential parameter."""
        needed = {name: seconds * (rsd / target_rsd) ** 2 for name, rsd in rsd_percent.items()}
        return cls(target_rsd, seconds, needed)

    @property
    @stated
    def within(self) -> int:
        """Number of parameters that are expected to reach the target with the motion at hand."""
        return sum(needed <= self.seconds for needed in self.needed_s.values())

    @property
    @stated
    def essential(self) -> int:
        """Number of parameters expected to be essential."""
        return len(self.needed_s)

    def summary(self) -> str:
        """One line for a person."""
        within = f"{self.within} of {self.essential} essential parameters within {self.target_rsd:g} %"
        return f"to be expected of {self.seconds:.0f} s: {within}{self.longer()}"

    def longer(self) -> str:
        """How much motion the others take, to follow a sentence; as far as anybody would have the patience for it."""
        later = [needed for needed in self.needed_s.values() if needed > self.seconds]
        near = [needed for needed in later if needed <= PATIENCE * self.seconds]
        said = ""
        if near:
            least, most = f"{min(near):.0f} s", f"{max(near):.0f} s"
            said += f"; {len(near)} more would take motion like this for {span(least, most, ' to ')} in all"
        if len(later) > len(near):
            said += f"; {len(later) - len(near)} would take more than {PATIENCE:g} times as much"
        return said


@dataclass(frozen=True)
class ParameterOutlook(Stated):
    """What is to be expected of one base parameter.

    Attributes:
        name: of its own column.
        expression: the whole combination.
        excitable: whether any motion can show it, within joint limits and with a foot on the ground.
        excited: whether the motions at hand do.
        value: in the model [SI].
        rsd_percent: predicted relative standard deviation; None where it is not excited, or is zero.
        essential: whether identification is expected to keep it.
    """

    name: str
    expression: str
    excitable: bool
    excited: bool
    value: Unbounded
    rsd_percent: Positive | None = field(metadata=named("predicted_rsd_percent"))
    essential: bool
