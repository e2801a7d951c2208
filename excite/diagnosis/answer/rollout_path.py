"""A trial as its joints moved, and as the simulators move them."""

from __future__ import annotations

from dataclasses import dataclass

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class RolloutPath:
    """A trial beside its roll-outs; where nothing was simulated these are the record.

    Attributes:
        trial: its name.
        joints: of the columns.
        time: ``(n,)`` [s].
        recorded: positions, ``(n, n_joints)`` [rad or m].
        before: of the nominal simulator, likewise.
        after: of the simulator with the effects that help, likewise.
    """

    trial: str
    joints: tuple[str, ...]
    time: Array
    recorded: Array
    before: Array
    after: Array
