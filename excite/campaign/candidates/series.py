"""What optimised series are to be: their criterion and their period."""

from __future__ import annotations

from dataclasses import dataclass

from excite.excitation.optimisation.criterion import make_criterion
from excite.reading.number import check_number
from excite.robot.robot import Robot

HARMONICS = 5


# What no robot's rate allows [s].
_ANY_PERIOD = (1e-6, 1e6)


# Numbers of a motion, positions, velocities and accelerations at the robot's rate: 16 MB. Each start samples,
# differentiates and checks all of it some hundred times; an arm at 1 kHz gets a minute and a half.
_MOST_NUMBERS = 2_000_000


@dataclass(frozen=True)
class SeriesSettings:
    """What a plan's optimised series are to be.

    Attributes:
        criterion: ``condition``, ``log_det`` or ``largest_rsd``.
        period_s: of the series [s]; what the slowest joint needs for its range, from 6 to 20 s, if None.
    """

    criterion: str = "condition"
    period_s: float | None = None

    def __post_init__(self) -> None:
        """Check the bounds; raises UnknownNameError or InputError."""
        make_criterion(self.criterion)
        if self.period_s is not None:
            check_number(self.period_s, "period", *_ANY_PERIOD, "s")

    def fit(self, robot: Robot) -> None:
        """Raise InputError where the robot's rate makes too few samples of a period, or more than memory holds."""
        if self.period_s is None:
            return
        rate = robot.description.sensors.rate_hz
        shortest, longest = (
            2.0 * HARMONICS / rate,
            _MOST_NUMBERS / (rate * (robot.model.nq + 2 * robot.model.nv)),
        )
        check_number(self.period_s, "period", shortest, longest, "s", source=robot.name)
