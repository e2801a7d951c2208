"""What a model file is written from: the parameters of a robot's bodies and drives, however they were found."""

from __future__ import annotations

from dataclasses import dataclass

from excite.arrays import Array
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.result import Identification


@dataclass(frozen=True, eq=False)
class ModelParameters:
    """Parameters of a robot, without what an identification says of their worth.

    Attributes:
        robot: name of the robot.
        identified: its bodies and drives.
    """

    robot: str
    identified: IdentifiedParameters

    @property
    def links(self) -> tuple[str, ...]:
        """Links of the segments, in model order."""
        return self.identified.links

    @property
    def parameters(self) -> Array:
        """Inertial parameters, ``(10·n_segments,)``, pinocchio's order, joint frames [SI]."""
        return self.identified.inertial


Found = Identification | ModelParameters
"""What has ``robot``, ``links``, ``parameters`` and ``identified``."""
