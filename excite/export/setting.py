"""What can be said of a controller format beside the motion: gains, names, orders."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from excite.errors import InputError
from excite.reading.number import check_number, shorten_value


@dataclass(frozen=True)
class Setting:
    """A setting of a format, declared once for command line, validation and help.

    Attributes:
        name: after ``excite export --set``.
        default: used where nothing is said; its type is the setting's.
        summary: one line for help texts.
        low: smallest number.
        high: largest number.
        unit: of numbers.
        choices: words that it may be; empty for any.
        example: a value to try, of a setting that has to be given since nothing is right for every machine.
    """

    name: str
    default: float | str
    summary: str
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    choices: tuple[str, ...] = ()
    example: str = ""

    def read(self, value: object, source: str) -> float | str:
        """The value, a number or its text; raises InputError that names the setting."""
        if isinstance(self.default, str):
            return self._word(value, source)
        number = value
        if isinstance(value, str):
            try:
                number = float(value)
            except ValueError:
                number = value[:40]
        return check_number(number, self.name, self.low, self.high, self.unit, source=source)

    def _word(self, value: object, source: str) -> str:
        text = str(value).strip()
        if self.choices and text not in self.choices:
            remedy = f"choose one of {', '.join(self.choices)}"
            raise InputError(f"is {shorten_value(text)}", source=source, field=self.name, remedy=remedy)
        if not text.isprintable():
            raise InputError(
                f"is {shorten_value(text)}", source=source, field=self.name, remedy="write it in one line"
            )
        return text


def settle_settings(
    declared: Iterable[Setting], given: Mapping[str, object], source: str
) -> dict[str, float | str]:
    """Values of all declared settings; raises InputError for one that is not declared or not allowed.

    Args:
        declared: of the format.
        given: by name, numbers or texts.
        source: name of the format, for errors.
    """
    known = {setting.name: setting for setting in declared}
    for name in given:
        if name not in known:
            remedy = f"choose one of {', '.join(known)}" if known else "leave it out: the format has none"
            raise InputError("is no setting", source=source, field=str(name)[:60], remedy=remedy)
    return {
        name: setting.read(given[name], source) if name in given else setting.default
        for name, setting in known.items()
    }
