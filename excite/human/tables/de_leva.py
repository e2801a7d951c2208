"""Table 4 of de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomech. 29 (1996) 1223.

Young adults measured by gamma-ray scanning (100 men, 15 women). Each row: mass in per cent of the body's;
length [mm] between the end points for the mean subject; centre of mass in per cent of the length from the first
end point; radii of gyration about the sagittal (fore-aft), transverse (left-right) and longitudinal axis through
the centre of mass in per cent of the length.
"""

from __future__ import annotations

from dataclasses import dataclass

from excite.human.segments import Sex

SOURCE = "de Leva 1996, J. Biomech. 29(9):1223-1230, table 4"


@dataclass(frozen=True)
class Row:
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


STATURE: dict[Sex, float] = {"male": 1.741, "female": 1.735}
"""Stature of the mean subject [m]."""
BODY_MASS: dict[Sex, float] = {"male": 73.0, "female": 61.9}
"""Mass of the mean subject [kg]."""

_VERT, _MIDG, _CERV, _SUPR = "vertex", "mid gonion", "cervicale", "suprasternale"
_XYPH, _OMPH, _MIDH, _MIDS = "xiphion", "omphalion", "mid hip", "mid shoulder"

TABLE: dict[Sex, dict[str, Row]] = {
    "male": {
        "head": Row((_VERT, _MIDG), 6.94, 203.3, 59.76, 36.2, 37.6, 31.2),
        "head to cervicale": Row((_VERT, _CERV), 6.94, 242.9, 50.02, 30.3, 31.5, 26.1),
        "trunk": Row((_SUPR, _MIDH), 43.46, 531.9, 44.86, 37.2, 34.7, 19.1),
        "trunk from cervicale": Row((_CERV, _MIDH), 43.46, 603.3, 51.38, 32.8, 30.6, 16.9),
        "upper trunk": Row((_SUPR, _XYPH), 15.96, 170.7, 29.99, 71.6, 45.4, 65.9),
        "mid trunk": Row((_XYPH, _OMPH), 16.33, 215.5, 45.02, 48.2, 38.3, 46.8),
        "lower trunk": Row((_OMPH, _MIDH), 11.17, 145.7, 61.15, 61.5, 55.1, 58.7),
        "upper_arm": Row(("shoulder", "elbow"), 2.71, 281.7, 57.72, 28.5, 26.9, 15.8),
        "forearm": Row(("elbow", "wrist"), 1.62, 268.9, 45.74, 27.6, 26.5, 12.1),
        "hand": Row(("wrist", "third metacarpale"), 0.61, 86.2, 79.00, 62.8, 51.3, 40.1),
        "thigh": Row(("hip", "knee"), 14.16, 422.2, 40.95, 32.9, 32.9, 14.9),
        "shank": Row(("knee", "lateral malleolus"), 4.33, 434.0, 44.59, 25.5, 24.9, 10.3),
        "foot": Row(("heel", "toe tip"), 1.37, 258.1, 44.15, 25.7, 24.5, 12.4),
    },
    "female": {
        "head": Row((_VERT, _MIDG), 6.68, 200.2, 58.94, 33.0, 35.9, 31.8),
        "head to cervicale": Row((_VERT, _CERV), 6.68, 243.7, 48.41, 27.1, 29.5, 26.1),
        "trunk": Row((_SUPR, _MIDH), 42.57, 529.3, 41.51, 35.7, 33.9, 17.1),
        "trunk from cervicale": Row((_CERV, _MIDH), 42.57, 614.8, 49.64, 30.7, 29.2, 14.7),
        "upper trunk": Row((_SUPR, _XYPH), 15.45, 142.5, 20.77, 74.6, 50.2, 71.8),
        "mid trunk": Row((_XYPH, _OMPH), 14.65, 205.3, 45.12, 43.3, 35.4, 41.5),
        "lower trunk": Row((_OMPH, _MIDH), 12.47, 181.5, 49.20, 43.3, 40.2, 44.4),
        "upper_arm": Row(("shoulder", "elbow"), 2.55, 275.1, 57.54, 27.8, 26.0, 14.8),
        "forearm": Row(("elbow", "wrist"), 1.38, 264.3, 45.59, 26.1, 25.7, 9.4),
        "hand": Row(("wrist", "third metacarpale"), 0.56, 78.0, 74.74, 53.1, 45.4, 33.5),
        "thigh": Row(("hip", "knee"), 14.78, 368.5, 36.12, 36.9, 36.4, 16.2),
        "shank": Row(("knee", "lateral malleolus"), 4.81, 432.3, 44.16, 27.1, 26.7, 9.3),
        "foot": Row(("heel", "toe tip"), 1.29, 228.3, 40.14, 29.9, 27.9, 13.9),
    },
}
"""By sex and segment; ``head to cervicale`` and ``trunk from cervicale`` are the table's alternative end points."""
