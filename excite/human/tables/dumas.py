"""Table 2 of Dumas, Cheze and Verriest, "Adjustments to McConville et al. and Young et al. body segment inertial
parameters", J. Biomech. 40 (2007) 543, with the corrigendum, J. Biomech. 40 (2007) 1651.

Adults measured by stereophotogrammetry (31 men, mean 1.77 m and 80.5 kg; 46 women, 1.61 m and 63.9 kg). Axes are
those of the International Society of Biomechanics: X forward, Y up, Z to the right; right segments. Origins: the
pelvis at the lumbar joint, torso and head at the cervical joint, limbs at their proximal joints.
"""

from __future__ import annotations

from dataclasses import dataclass

from excite.human.segments import Sex

SOURCE = "Dumas et al. 2007, J. Biomech. 40(3):543-553, table 2, with corrigendum 40(7):1651-1652"


@dataclass(frozen=True)
class Row:
    """One segment of one sex.

    Attributes:
        length: of the mean subject [mm].
        mass: [% of body mass].
        center: centre of mass, X Y Z [% of length].
        diagonal: radii of gyration about X, Y, Z through the centre of mass [% of length].
        products: signed square roots of the products of inertia XY, XZ, YZ over mass [% of length]; a negative
            number stands for the table's imaginary one, whose square is a negative element of the tensor.
    """

    length: float
    mass: float
    center: tuple[float, float, float]
    diagonal: tuple[float, float, float]
    products: tuple[float, float, float]


STATURE: dict[Sex, float] = {"male": 1.77, "female": 1.61}
"""Stature of the mean subject [m]."""
BODY_MASS: dict[Sex, float] = {"male": 80.5, "female": 63.9}
"""Mass of the mean subject [kg]."""

TABLE: dict[Sex, dict[str, Row]] = {
    "male": {
        "head": Row(244, 6.7, (-6.2, 55.5, 0.1), (31, 25, 33), (-9, -2, 3)),
        "torso": Row(477, 33.3, (-3.6, -42.0, -0.2), (27, 25, 28), (18, 2, -4)),
        "upper_arm": Row(271, 2.4, (1.7, -45.2, -2.6), (31, 14, 32), (6, 5, 2)),
        "forearm": Row(283, 1.7, (1.0, -41.7, 1.4), (28, 11, 27), (3, 2, -8)),
        "hand": Row(80, 0.6, (8.2, -83.9, 7.4), (61, 38, 56), (22, 15, -20)),
        "pelvis": Row(94, 14.2, (2.8, -28.0, -0.6), (101, 106, 95), (-25, -12, -8)),
        "thigh": Row(432, 12.3, (-4.1, -42.9, 3.3), (29, 15, 30), (7, -2, -7)),
        "shank": Row(433, 4.8, (-4.8, -41.0, 0.7), (28, 10, 28), (-4, -2, 5)),
        "foot": Row(183, 1.2, (38.2, -15.1, 2.6), (17, 37, 36), (13, -8, 0)),
    },
    "female": {
        "head": Row(221, 6.7, (-7.0, 59.7, 0.0), (32, 27, 34), (-6, 1, -1)),
        "torso": Row(429, 30.4, (-1.6, -43.6, -0.6), (29, 27, 29), (22, 5, -5)),
        # The corrigendum's; codes that took the table before it have 7.3 for the centre and 14 for the product YZ.
        "upper_arm": Row(243, 2.2, (-7.3, -45.4, -2.8), (33, 17, 33), (3, -5, -14)),
        "forearm": Row(247, 1.3, (2.1, -41.1, 1.9), (26, 14, 25), (10, 4, -13)),
        "hand": Row(71, 0.5, (7.7, -76.8, 4.8), (63, 43, 58), (29, 23, -28)),
        "pelvis": Row(107, 14.6, (-0.9, -23.2, 0.2), (91, 100, 79), (-34, -1, -1)),
        "thigh": Row(379, 14.6, (-7.7, -37.7, 0.9), (31, 19, 32), (7, -2, -7)),
        "shank": Row(388, 4.5, (-4.9, -40.4, 3.1), (28, 10, 28), (2, 1, 6)),
        "foot": Row(165, 1.0, (27.0, -21.8, 3.9), (17, 36, 35), (-10, 6, -4)),
    },
}
"""By sex and segment."""


@dataclass(frozen=True)
class PelvisLandmarks:
    """Joint centres in the pelvis from the midpoint of the two anterior superior iliac spines.

    Attributes:
        width: distance of the two spines in the mean subject [mm].
        lumbar: X, Y of the lumbar joint [% of width].
        hip: X, Y, Z of the right hip joint [% of width].
    """

    width: float
    lumbar: tuple[float, float]
    hip: tuple[float, float, float]


PELVIS: dict[Sex, PelvisLandmarks] = {
    "male": PelvisLandmarks(224, (-33.5, -3.2), (-9.5, -37.0, 36.1)),
    "female": PelvisLandmarks(238, (-34.0, 4.9), (-13.9, -33.6, 37.2)),
}
"""Appendix of the paper (after Reed et al. 1999)."""
