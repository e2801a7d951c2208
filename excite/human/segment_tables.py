"""Published tables of body segments' inertial parameters: de Leva (1996) and Dumas et al. (2007)."""

from __future__ import annotations

from dataclasses import dataclass

from excite.human.segments import Sex

# Table 4 of de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomech. 29 (1996) 1223.
#
# Young adults measured by gamma-ray scanning (100 men, 15 women). Each row: mass in per cent of the body's;
# length [mm] between the end points for the mean subject; centre of mass in per cent of the length from the first
# end point; radii of gyration about the sagittal (fore-aft), transverse (left-right) and longitudinal axis through
# the centre of mass in per cent of the length.


@dataclass(frozen=True)
class DeLevaRow:
    """One segment of one sex.

    Attributes:
        ends: the two end points.
        mass: [% of body mass].
        length: of the mean subject [mm].
        center: centre of mass from the first end point [% of length].
        sagittal: radius of gyration about the fore-aft axis [% of length].
        transverse: about the left-right axis.
        longitudinal: about the long axis.
    """

    ends: tuple[str, str]
    mass: float
    length: float
    center: float
    sagittal: float
    transverse: float
    longitudinal: float


DE_LEVA_STATURE: dict[Sex, float] = {"male": 1.741, "female": 1.735}
"""Stature of the mean subject [m]."""
DE_LEVA_BODY_MASS: dict[Sex, float] = {"male": 73.0, "female": 61.9}
"""Mass of the mean subject [kg]."""

_VERT, _MIDG, _CERV, _SUPR = "vertex", "mid gonion", "cervicale", "suprasternale"
_XYPH, _OMPH, _MIDH, _MIDS = "xiphion", "omphalion", "mid hip", "mid shoulder"

DE_LEVA_TABLE: dict[Sex, dict[str, DeLevaRow]] = {
    "male": {
        "head": DeLevaRow((_VERT, _MIDG), 6.94, 203.3, 59.76, 36.2, 37.6, 31.2),
        "head to cervicale": DeLevaRow((_VERT, _CERV), 6.94, 242.9, 50.02, 30.3, 31.5, 26.1),
        "trunk": DeLevaRow((_SUPR, _MIDH), 43.46, 531.9, 44.86, 37.2, 34.7, 19.1),
        "trunk from cervicale": DeLevaRow((_CERV, _MIDH), 43.46, 603.3, 51.38, 32.8, 30.6, 16.9),
        "upper trunk": DeLevaRow((_SUPR, _XYPH), 15.96, 170.7, 29.99, 71.6, 45.4, 65.9),
        "mid trunk": DeLevaRow((_XYPH, _OMPH), 16.33, 215.5, 45.02, 48.2, 38.3, 46.8),
        "lower trunk": DeLevaRow((_OMPH, _MIDH), 11.17, 145.7, 61.15, 61.5, 55.1, 58.7),
        "upper_arm": DeLevaRow(("shoulder", "elbow"), 2.71, 281.7, 57.72, 28.5, 26.9, 15.8),
        "forearm": DeLevaRow(("elbow", "wrist"), 1.62, 268.9, 45.74, 27.6, 26.5, 12.1),
        "hand": DeLevaRow(("wrist", "third metacarpale"), 0.61, 86.2, 79.00, 62.8, 51.3, 40.1),
        "thigh": DeLevaRow(("hip", "knee"), 14.16, 422.2, 40.95, 32.9, 32.9, 14.9),
        "shank": DeLevaRow(("knee", "lateral malleolus"), 4.33, 434.0, 44.59, 25.5, 24.9, 10.3),
        "foot": DeLevaRow(("heel", "toe tip"), 1.37, 258.1, 44.15, 25.7, 24.5, 12.4),
    },
    "female": {
        "head": DeLevaRow((_VERT, _MIDG), 6.68, 200.2, 58.94, 33.0, 35.9, 31.8),
        "head to cervicale": DeLevaRow((_VERT, _CERV), 6.68, 243.7, 48.41, 27.1, 29.5, 26.1),
        "trunk": DeLevaRow((_SUPR, _MIDH), 42.57, 529.3, 41.51, 35.7, 33.9, 17.1),
        "trunk from cervicale": DeLevaRow((_CERV, _MIDH), 42.57, 614.8, 49.64, 30.7, 29.2, 14.7),
        "upper trunk": DeLevaRow((_SUPR, _XYPH), 15.45, 142.5, 20.77, 74.6, 50.2, 71.8),
        "mid trunk": DeLevaRow((_XYPH, _OMPH), 14.65, 205.3, 45.12, 43.3, 35.4, 41.5),
        "lower trunk": DeLevaRow((_OMPH, _MIDH), 12.47, 181.5, 49.20, 43.3, 40.2, 44.4),
        "upper_arm": DeLevaRow(("shoulder", "elbow"), 2.55, 275.1, 57.54, 27.8, 26.0, 14.8),
        "forearm": DeLevaRow(("elbow", "wrist"), 1.38, 264.3, 45.59, 26.1, 25.7, 9.4),
        "hand": DeLevaRow(("wrist", "third metacarpale"), 0.56, 78.0, 74.74, 53.1, 45.4, 33.5),
        "thigh": DeLevaRow(("hip", "knee"), 14.78, 368.5, 36.12, 36.9, 36.4, 16.2),
        "shank": DeLevaRow(("knee", "lateral malleolus"), 4.81, 432.3, 44.16, 27.1, 26.7, 9.3),
        "foot": DeLevaRow(("heel", "toe tip"), 1.29, 228.3, 40.14, 29.9, 27.9, 13.9),
    },
}
"""By sex and segment; ``head to cervicale`` and ``trunk from cervicale`` are the table's alternative end points."""


# Table 2 of Dumas, Cheze and Verriest, "Adjustments to McConville et al. and Young et al. body segment inertial
# parameters", J. Biomech. 40 (2007) 543, with the corrigendum, J. Biomech. 40 (2007) 1651.
#
# Adults measured by stereophotogrammetry (31 men, mean 1.77 m and 80.5 kg; 46 women, 1.61 m and 63.9 kg). Axes are
# those of the International Society of Biomechanics: X forward, Y up, Z to the right; right segments. Origins: the
# pelvis at the lumbar joint, torso and head at the cervical joint, limbs at their proximal joints.


@dataclass(frozen=True)
class DumasRow:
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


DUMAS_STATURE: dict[Sex, float] = {"male": 1.77, "female": 1.61}
"""Stature of the mean subject [m]."""
DUMAS_BODY_MASS: dict[Sex, float] = {"male": 80.5, "female": 63.9}
"""Mass of the mean subject [kg]."""

DUMAS_TABLE: dict[Sex, dict[str, DumasRow]] = {
    "male": {
        "head": DumasRow(244, 6.7, (-6.2, 55.5, 0.1), (31, 25, 33), (-9, -2, 3)),
        "torso": DumasRow(477, 33.3, (-3.6, -42.0, -0.2), (27, 25, 28), (18, 2, -4)),
        "upper_arm": DumasRow(271, 2.4, (1.7, -45.2, -2.6), (31, 14, 32), (6, 5, 2)),
        "forearm": DumasRow(283, 1.7, (1.0, -41.7, 1.4), (28, 11, 27), (3, 2, -8)),
        "hand": DumasRow(80, 0.6, (8.2, -83.9, 7.4), (61, 38, 56), (22, 15, -20)),
        "pelvis": DumasRow(94, 14.2, (2.8, -28.0, -0.6), (101, 106, 95), (-25, -12, -8)),
        "thigh": DumasRow(432, 12.3, (-4.1, -42.9, 3.3), (29, 15, 30), (7, -2, -7)),
        "shank": DumasRow(433, 4.8, (-4.8, -41.0, 0.7), (28, 10, 28), (-4, -2, 5)),
        "foot": DumasRow(183, 1.2, (38.2, -15.1, 2.6), (17, 37, 36), (13, -8, 0)),
    },
    "female": {
        "head": DumasRow(221, 6.7, (-7.0, 59.7, 0.0), (32, 27, 34), (-6, 1, -1)),
        "torso": DumasRow(429, 30.4, (-1.6, -43.6, -0.6), (29, 27, 29), (22, 5, -5)),
        # The corrigendum's; codes that took the table before it have 7.3 for the centre and 14 for the product YZ.
        "upper_arm": DumasRow(243, 2.2, (-7.3, -45.4, -2.8), (33, 17, 33), (3, -5, -14)),
        "forearm": DumasRow(247, 1.3, (2.1, -41.1, 1.9), (26, 14, 25), (10, 4, -13)),
        "hand": DumasRow(71, 0.5, (7.7, -76.8, 4.8), (63, 43, 58), (29, 23, -28)),
        "pelvis": DumasRow(107, 14.6, (-0.9, -23.2, 0.2), (91, 100, 79), (-34, -1, -1)),
        "thigh": DumasRow(379, 14.6, (-7.7, -37.7, 0.9), (31, 19, 32), (7, -2, -7)),
        "shank": DumasRow(388, 4.5, (-4.9, -40.4, 3.1), (28, 10, 28), (2, 1, 6)),
        "foot": DumasRow(165, 1.0, (27.0, -21.8, 3.9), (17, 36, 35), (-10, 6, -4)),
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


DUMAS_PELVIS: dict[Sex, PelvisLandmarks] = {
    "male": PelvisLandmarks(224, (-33.5, -3.2), (-9.5, -37.0, 36.1)),
    "female": PelvisLandmarks(238, (-34.0, 4.9), (-13.9, -33.6, 37.2)),
}
"""Appendix of the paper (after Reed et al. 1999)."""
