"""The ground reaction of a person's trials, measured and by two models (Jovic et al., T-RO 2016, table III)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.errors import LogError
from excite.identification.judgement import ChannelFit, channel_fit
from excite.logs.log import Log
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.regressor.kernels import base_link_regressor
from excite.robot.robot import Robot
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
UNITS = ("N", "N", "N", "N·m", "N·m", "N·m")
_NAMES = {**{f"f{a}": f"GRF {a}" for a in "xyz"}, **{f"t{a}": f"GRFM {a}" for a in "xyz"}}


@dataclass(frozen=True, eq=False)
class GroundReaction:
    """One trial; forces [N] and moments [N·m] in the world's axes (z up), moments about ``point``.

    Attributes:
        trial: its name.
        role: identification or validation.
        time: ``(n,)`` [s].
        point: on the ground below the pelvis, at the mean of the trial ``(3,)`` [m].
        measured: ``(n, 6)``.
        nominal: by the nominal model, ``(n, 6)``.
        identified: by the identified model, ``(n, 6)``.
    """

    trial: str
    role: str
    time: Array
    point: Array
    measured: Array
    nominal: Array
    identified: Array


def ground_reactions(
    robot: Robot, log: Log, identified: Array, settings: ProblemSettings | None = None
) -> tuple[GroundReaction, ...]:
    """Ground reaction of every trial of a log, filtered as for identification, ends without the filter's transient.

    Args:
        robot: the person's model, whose own parameters are the nominal ones.
        log: trials on force plates.
        identified: identified parameters ``(10·n_segments,)``.
        settings: filters; defaults if None.

    Raises:
        LogError: a trial is too short for the filter.
    """
    settings = settings or ProblemSettings()
    filters = settings.filters(floating=True, lowpass_hz=log.header.lowpass_hz)
    inside = robot_in_log(robot, log.header, log.folder)
    places = {sensor.name: np.asarray(sensor.placement.translation) for sensor in inside.sensors}
    models = np.column_stack([inside.nominal_parameters, identified])
    found = []
    for trial in log.trials:
        k = trial_kinematics(inside, log.header, trial, settings, filters)
        point = np.append(k.q[:, :2].mean(axis=0), min(place[2] for place in places.values()))
        measured = np.zeros((len(k.time), 6))
        for name, values in trial.wrenches.items():
            wrench = forces_on_grid(trial.time, values, k.time)
            measured += wrench
            measured[:, 3:] += np.cross(places[name] - point, wrench[:, :3])
        at_base = base_link_regressor(inside.model, k.q, k.v, k.a) @ models
        curves = [measured, *(_in_world(at_base[:, :, i], k.q, point) for i in range(2))]
        edge = settling_samples(k.rate_hz, filters.cutoff_hz)
        use = k.valid.copy()
        use[:edge] = use[len(use) - edge :] = False
        if not use.any():
            raise LogError("is too short for the filter", source=trial.name, remedy="record longer")
        filtered = [lowpass(curve, k.rate_hz, filters.cutoff_hz, filters.order)[use] for curve in curves]
        found.append(GroundReaction(trial.name, str(trial.role), k.time[use], point, *filtered))
    return tuple(found)


def _in_world(wrench: Array, q: Array, point: Array) -> Array:
    """A wrench about the base in its axes, in the world's axes about ``point``."""
    turn = Rotation.from_quat(q[:, 3:7])
    force, moment = turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])
    return np.hstack([force, moment + np.cross(q[:, :3] - point, force)])


@dataclass(frozen=True)
class ReactionTable:
    """RMSE and Pearson's correlation of the ground reaction, nominal and identified, by role of the trials.

    Attributes:
        fits: by role, then by component.
    """

    fits: dict[str, dict[str, ChannelFit]]

    @classmethod
    def of(cls, reactions: Sequence[GroundReaction]) -> ReactionTable:
        """All trials of a role together."""
        fits: dict[str, dict[str, ChannelFit]] = {}
        for role in dict.fromkeys(reaction.role for reaction in reactions):
            own = [reaction for reaction in reactions if reaction.role == role]
            measured, nominal, identified = (
                np.vstack([getattr(reaction, name) for reaction in own])
                for name in ("measured", "nominal", "identified")
            )
            fits[role] = {
                axis: channel_fit(UNITS[i], measured[:, i], identified[:, i], nominal[:, i])
                for i, axis in enumerate(AXES)
            }
        return cls(fits)

    def summary(self) -> str:
        """The table in words, for a terminal."""
        lines = []
        for role, fits in self.fits.items():
            lines.append(f"ground reaction, {role} trials, RMSE (correlation), world axes:")
            lines.append(f"  {'':8}{'identified':>20}{'nominal':>20}")
            for axis, fit in fits.items():
                ours = f"{fit.rmse:.2f} {fit.unit} ({_correlation_text(fit.cc)})"
                theirs = f"{fit.reference_rmse:.2f} {fit.unit} ({_correlation_text(fit.reference_cc)})"
                lines.append(f"  {_NAMES[axis]:8}{ours:>20}{theirs:>20}")
        return "\n".join(lines)


def _correlation_text(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
