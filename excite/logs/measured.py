"""Whether anything was measured of the torques that a log promises."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from excite.errors import LogError
from excite.logs.log import LogHeader, Trial

# No sensor resolves less [N·m, N or A].
_RESOLVED = 1e-9


def check_measured(trials: Sequence[Trial], header: LogHeader, path: Path) -> None:
    """Refuse a log from whose torques, or currents, nothing can be identified as all stay as they are.

    Single channels that are dead are found later, and the others used.

    Args:
        trials: read and repaired; those of role ``identification`` count, where there are any.
        header: of the log.
        path: its ``log.yaml``, for errors.

    Raises:
        LogError: names the channels.
    """
    trials = [trial for trial in trials if trial.role == "identification"] or trials
    measured = [header.joints.index(joint) for joint in header.torque_joints]
    for attribute, prefix in (("tau", "tau"), ("current", "i")):
        values = [getattr(trial, attribute) for trial in trials]
        wanted = header.torque != "none" and all(value is not None for value in values)
        if wanted and not any((np.ptp(value[:, measured], axis=0) > _RESOLVED).any() for value in values):
            raise LogError(
                "never changes, of no joint and in no identification trial",
                source=path,
                field=f"{prefix}.*",
                remedy="log what was measured, or write torque: none and leave the columns out",
            )
