"""All generators by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.registry import Registry

if TYPE_CHECKING:
    from excite.motion.generators.generator import Generator

# Seeds of a plan follow the places in this table: new ones go to its end.
GENERATORS: Registry[Generator] = Registry(
    "generator",
    {
        "random_joint": "excite.motion.generators.joint_motions:RandomJoint",
        "fourier": "excite.motion.generators.joint_motions:Fourier",
        "leg_swing": "excite.motion.generators.leg_swing:LegSwing",
        "squat": "excite.motion.generators.stances:Squat",
        "reach": "excite.motion.generators.joint_motions:Reach",
        "aimed": "excite.motion.generators.aimed:Aimed",
        "sway": "excite.motion.generators.stances:Sway",
        "foot_swing": "excite.motion.generators.stances:FootSwing",
    },
)


def make_generator(name: str) -> Generator:
    """The generator of that name; raises UnknownNameError."""
    return GENERATORS.make(name)
