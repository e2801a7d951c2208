"""The text of an augmented model: loaded by MuJoCo, and what stands in it of effects that XML cannot express."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from excite.errors import InputError

if TYPE_CHECKING:
    import mujoco

# First part of the names of the ``<custom>`` texts in which effects stand.
NOTE = "excite"
MODEL = "augmented.xml"
# By what an effect is made larger to see whether the model hears of it.
LOUDER = 1.5


@dataclass(frozen=True, eq=False)
class AugmentedModel:
    """A MuJoCo model of an arm, its actuators motors that take torques, or of a standing robot, its sensors sites.

    Attributes:
        xml: the model. What XML cannot express stands in it as ``<custom><text name="excite.EFFECT.PLACE"/>``,
            applied by :class:`excite.diagnosis.simulator.rollout.Simulator` or its twin for standing robots.
        warnings: what it could not take up, one sentence each.
    """

    xml: str
    warnings: tuple[str, ...]


def without(left: Sequence[str]) -> tuple[str, ...]:
    """What is said where a model lacks effects, each ``NAME at PLACE``, that bring roll-outs no nearer."""
    if not left:
        return ()
    reason = "roll-outs of the identification trials are no nearer with it"
    return (f"the model is without {', '.join(left)}: {reason}",)


def ignored(effect: str, location: str) -> str:
    """What is said of an effect that moves no roll-out of the model in which it stands."""
    return f"the simulator ignores {effect} at {location}"


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
