"""The text of an augmented model: loaded by MuJoCo, and what stands in it of effects that XML cannot express."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.errors import InputError

if TYPE_CHECKING:
    import mujoco

# First part of the names of the ``<custom>`` texts in which effects stand.
NOTE = "excite"


def load_model(xml: str) -> mujoco.MjModel:
    """The model; InputError where MuJoCo refuses it."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise refused(error) from error


def refused(error: ValueError) -> InputError:
    """What is said of a model that MuJoCo refuses."""
    said = " ".join(str(error).split())
    return InputError(f"MuJoCo refuses the model ({said})", remedy="judge by the torques or wrenches")


def model_notes(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """What follows ``excite.`` in the name of each text of an effect, and the text."""
    import mujoco

    found = []
    for k in range(model.ntext):
        head, _, rest = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, k).partition(".")
        if head == NOTE and rest:
            first, size = int(model.text_adr[k]), int(model.text_size[k])
            found.append((rest, bytes(model.text_data[first : first + size]).decode().rstrip("\0")))
    return found
