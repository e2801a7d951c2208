"""What every controller format has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from excite.errors import InputError
from excite.export.setting import Setting, settle_settings
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.verdict import Violation


class Exporter(ABC):
    """Writes motions of one robot, each as one file (or one folder) that a controller reads.

    Attributes:
        name: name in ``EXPORTERS`` and after ``excite export --format``.
        suffix: what the file's name ends with; empty for a folder.
        summary: one line for help texts.
        settings: what can be said of the format beside the motion.
        rates_hz: rates that the controller runs at, the usual one first; empty where it takes any.
        readable: whether ``excite check`` reads what is written; not so of formats that hold no motion any more.
        exact: whether it reads the very numbers, of all of q, v and a.
        whole: whether joints that no motor drives are written, too, as a simulator needs them.
        holds_base: whether pose, twist and acceleration of a free base, and contacts, are written too.
        robot: the robot whose motions are written.
        values: values of the settings.

    Args:
        robot: the robot.
        given: settings by name, others have their defaults.

    Raises:
        InputError: no such setting, or not such a value.
    """

    name: ClassVar[str]
    suffix: ClassVar[str]
    summary: ClassVar[str]
    settings: ClassVar[tuple[Setting, ...]] = ()
    rates_hz: ClassVar[tuple[float, ...]] = ()
    readable: ClassVar[bool] = True
    exact: ClassVar[bool] = True
    holds_base: ClassVar[bool] = True
    whole: ClassVar[bool] = False

    def __init__(self, robot: Robot, given: Mapping[str, object] | None = None) -> None:
        self.robot = robot
        self.values = settle_settings(self.settings, given or {}, self.name)

    def number(self, name: str) -> float:
        """Value of a setting that is a number."""
        return float(self.values[name])

    def word(self, name: str) -> str:
        """Value of a setting that is a word."""
        return str(self.values[name])

    def rate(self, motion: Motion, asked_hz: float | None) -> float | None:
        """Rate of the file [Hz], None for the motion's own samples; raises InputError for one that is never run."""
        if asked_hz is None:
            return self.rates_hz[0] if self.rates_hz else None
        if self.rates_hz and asked_hz not in self.rates_hz:
            known = " or ".join(f"{rate:g}" for rate in self.rates_hz)
            raise InputError(
                f"is {asked_hz:g} Hz, and the controller runs at {known} Hz",
                source=self.name,
                field="rate_hz",
                remedy=f"give {known}, or leave it out",
            )
        return asked_hz

    def refuse(self, motion: Motion) -> None:
        """Raise InputError in one line where no controller of this format runs motions of the robot."""
        return None

    def violations(self, motion: Motion) -> tuple[Violation, ...]:
        """What the controller would refuse of a motion as it is written, beyond the robot's own limits."""
        return ()

    def destination(self, path: Path) -> Path:
        """Where a motion is written that shall be called ``path``: with the format's suffix."""
        return (
            path if not self.suffix or path.suffix == self.suffix else path.with_name(path.name + self.suffix)
        )

    @abstractmethod
    def write(self, motion: Motion, path: Path) -> None:
        """Write ``motion``, every sample of it, to ``path``, which appears only when it is complete.

        Args:
            motion: the motion, already on the grid that the controller wants.
            path: the file or folder to write; an older one is replaced.
        """
