"""What a MuJoCo model says in its ``<custom>`` texts of effects that XML cannot express."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

# First part of the names of these texts.
NOTE = "excite"


def model_notes(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """What follows ``excite.`` in the name of each such text, and the text."""
    import mujoco

    found = []
    for k in range(model.ntext):
        head, _, rest = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, k).partition(".")
        if head == NOTE and rest:
            first, size = int(model.text_adr[k]), int(model.text_size[k])
            found.append((rest, bytes(model.text_data[first : first + size]).decode().rstrip("\0")))
    return found
