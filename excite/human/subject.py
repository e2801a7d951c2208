"""Who is measured: mass, height, sex."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Literal

from excite.errors import InputError

Sex = Literal["male", "female"]
_SEXES = ("male", "female")
_MASS, _HEIGHT = (5.0, 400.0), (0.5, 2.6)


@dataclass(frozen=True)
class Subject:
    """A person.

    Attributes:
        mass: body mass with all that is worn [kg].
        height: stature [m].
        sex: which column of the tables is taken.
    """

    mass: float
    height: float
    sex: Sex

    def __post_init__(self) -> None:
        """Refuse numbers that no person has.

        Raises:
            InputError: names the number, and the unit that it looks like.
        """
        if not (isfinite(self.mass) and _MASS[0] <= self.mass <= _MASS[1]):
            raise InputError(
                f"is {self.mass} kg", source="subject", field="mass", remedy="give it in kilograms"
            )
        if not (isfinite(self.height) and _HEIGHT[0] <= self.height <= _HEIGHT[1]):
            centimetres = isfinite(self.height) and _HEIGHT[0] <= self.height / 100.0 <= _HEIGHT[1]
            remedy = "these look like centimetres, give metres" if centimetres else "give it in metres"
            raise InputError(f"is {self.height} m", source="subject", field="height", remedy=remedy)
        if self.sex not in _SEXES:
            raise InputError(f"is {self.sex!r}", source="subject", field="sex", remedy="give male or female")
