"""How a log is turned into an identification problem."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from excite.errors import InputError, UnknownNameError
from excite.rows.drive_terms import DRIVE_TERMS

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

LONGEST_GAP_S = 0.1
"""What is interpolated over longer gaps is left out [s]."""

# How a setting is declared: once, with default, unit, bounds and meaning, and checked by what was declared.

SOURCE = "settings"


def number(
    default: float | None, unit: str, low: float, high: float, what: str, *, optional: bool = False
) -> Any:
    """A number within bounds, which are allowed themselves; ``optional`` ones may be None, for "none"."""
    declared = {"unit": unit, "low": low, "high": high, "what": what, "optional": optional or default is None}
    return field(default=default, metadata=declared)


def word(default: str, options: tuple[str, ...], what: str) -> Any:
    """One of some words."""
    return field(default=default, metadata={"options": options, "what": what})


def check_settings(settings: DataclassInstance) -> None:
    """Raise InputError, which names the setting, for a value that its declaration does not allow."""
    for item in fields(settings):
        value, said = getattr(settings, item.name), item.metadata
        remedy = ""
        if "options" in said and value not in said["options"]:
            remedy = " or ".join(said["options"])
        elif "low" in said and not (value is None and said["optional"]):
            known = isinstance(value, int | float) and not isinstance(value, bool)
            if not known or not said["low"] <= value <= said["high"]:
                unit = "" if said["unit"] == "1" else f" {said['unit']}"
                remedy = f"{said['low']:g} … {said['high']:g}{unit}"
        if remedy:
            raise InputError(f"is {value!r}", source=SOURCE, field=item.name, remedy=f"choose {remedy}")


@dataclass(frozen=True)
class Filters:
    """Filters of a problem, nothing left open.

    Attributes:
        cutoff_hz: cut-off of the filter on both sides of the regression [Hz].
        kinematics_cutoff_hz: cut-off before differentiation [Hz].
        order: order of the single pass of both.
        rate_hz: rate of the rows after decimation [Hz].
    """

    cutoff_hz: float
    kinematics_cutoff_hz: float
    order: int
    rate_hz: float


@dataclass(frozen=True)
class ProblemSettings:
    """Settings of :func:`~excite.identification.problem.build_problem`; unit, bounds and meaning are in each
    field's metadata.

    Kinematics are filtered once before they are differentiated; regressor columns and measurement are then
    filtered alike and decimated, which keeps the equation exact whatever the second filter does.

    Attributes:
        cutoff_hz: None takes 5 Hz, some ten times what excitation motions are made of.
        kinematics_cutoff_hz: None takes ``cutoff_hz`` for a floating base, twice that for joint torques.
        order: order of the single pass of both Butterworth filters.
        rate_hz: None takes twice ``cutoff_hz``, at which rows are about independent.
        coulomb_width: 0 takes the plain sign; joints that slide take a tenth of it [m/s].
        standstill_velocity: trials are cut to the span in which some joint is faster.
        longest_gap_s: samples interpolated over longer gaps are left out.
        drive_terms: names among ``DRIVE_TERMS``; None takes those that ``modelled`` in the log names, else
            viscous and Coulomb friction and offset, and armature where torques are on the motor's side.
        drive_gains: torque per ampere by joint [N·m/A], for logs of currents.
        torque_delay_s: how much later than positions torques (currents, wrenches) were logged.
    """

    cutoff_hz: float | None = number(
        None, "Hz", 0.05, 1e4, "cut-off of the filter on both sides of the regression"
    )
    kinematics_cutoff_hz: float | None = number(None, "Hz", 0.05, 1e4, "cut-off before differentiation")
    order: int = number(4, "1", 1, 12, "order of the Butterworth filters")
    rate_hz: float | None = number(None, "Hz", 0.1, 1e5, "rate of the rows after decimation")
    coulomb_width: float = number(
        0.01, "rad/s", 0.0, 10.0, "velocity over which Coulomb friction changes sign"
    )
    standstill_velocity: float = number(0.01, "rad/s", 0.0, 10.0, "speed below which a joint stands")
    longest_gap_s: float = number(LONGEST_GAP_S, "s", 0.0, 1e3, "longest gap that is interpolated")
    drive_terms: tuple[str, ...] | None = None
    drive_gains: Mapping[str, float] = field(default_factory=dict)
    torque_delay_s: float = number(0.0, "s", -10.0, 10.0, "delay of torques behind positions")

    def filters(self, *, floating: bool, lowpass_hz: float | None = None) -> Filters:
        """The filters, with every None that depends on the robot or on others filled in.

        Args:
            floating: whether rows are those of a floating base.
            lowpass_hz: cut-off that all channels of the log went through alike, as those of people do.
                Positions filtered once more than forces would lose accelerations, so they are not; rows keep
                up to 6 Hz of it and are twice as dense, as such recordings are short.
        """
        cutoff = self.cutoff_hz or min(lowpass_hz or 5.0, 6.0)
        kinematics = cutoff if floating else 2.0 * cutoff
        return Filters(
            cutoff_hz=cutoff,
            kinematics_cutoff_hz=self.kinematics_cutoff_hz or (math.inf if lowpass_hz else kinematics),
            order=self.order,
            rate_hz=self.rate_hz or (4.0 if lowpass_hz else 2.0) * cutoff,
        )

    def check_rate(self, sampling_hz: float) -> None:
        """Raise InputError where the cut-off that was asked for is not below half a log's rate [Hz]."""
        nyquist = 0.5 * sampling_hz
        if self.cutoff_hz is not None and self.cutoff_hz >= nyquist:
            raise InputError(
                f"is {self.cutoff_hz:g} Hz, and rows at {sampling_hz:g} Hz hold nothing beyond {nyquist:g} Hz",
                source=SOURCE,
                field="cutoff_hz",
                remedy=f"choose one below {nyquist:g} Hz, or leave it out",
            )

    def __post_init__(self) -> None:
        """Check every bound.

        Raises:
            InputError: a number out of bounds; names the setting.
            UnknownNameError: an unknown drive term.
        """
        check_settings(self)
        for name in self.drive_terms or ():
            if name not in DRIVE_TERMS:
                raise UnknownNameError("drive term", name, list(DRIVE_TERMS))
        for joint, gain in self.drive_gains.items():
            if not (math.isfinite(gain) and gain != 0.0):
                raise InputError(
                    f"is {gain!r}", source=SOURCE, field=f"drive_gains.{joint}", remedy="give N·m/A"
                )
