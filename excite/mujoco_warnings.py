"""What MuJoCo does when a simulation goes wrong, and how a caller learns of it.

MuJoCo starts such a run again from its first posture, keeps a count, and appends a line to ``MUJOCO_LOG.TXT`` in the
working folder. A run that started again is no run of the motion."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco


@contextmanager
def without_log_file() -> Iterator[None]:
    """No ``MUJOCO_LOG.TXT`` in the folder of whoever compiles or runs a model inside, and no warning on stderr."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def has_diverged(data: mujoco.MjData) -> bool:
    """Whether a position, velocity or acceleration of the run has become absurd since its data were reset."""
    import mujoco

    kinds = mujoco.mjtWarning
    bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
    return any(data.warning[int(kind)].number > 0 for kind in bad)
