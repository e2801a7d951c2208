"""What Golluccio et al. 2020 (IEEE RAM 27(3)) print about the Jaco²: frames, combinations, values.

Frames are those of ``robots/jaco2``: axes of the article's frame i, origin on the axis of joint i.
"""

from __future__ import annotations

import numpy as np

from excite.arrays import Array

# Table 1: offsets along the joints' axes [m], d1 … d7.
D = dict(zip(range(1, 8), (0.2755, 0.0, -0.41, -0.0098, -0.3111, 0.0, 0.2638), strict=True))

# pinocchio's order of a segment's parameters, in the article's words.
_PARAMETERS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


def _masses(factor: float, *links: int) -> dict[tuple[str, int], float]:
    return {("m", link): factor for link in links}


def combinations(sign_of_d3_in_beta_2: float = 1.0) -> dict[str, dict[tuple[str, int], float]]:
    """The 20 combinations of Table 3: coefficients by parameter and link.

    Args:
        sign_of_d3_in_beta_2: -1 as printed. With +1 it agrees with β8, in which d3 carries the sign of Table 1,
            and with the value of β2 that Table 4 prints for the CAD model.
    """
    d3, d4, d5 = D[3], D[4], D[5]
    return {
        "β1": {("Iyy", 1): 1.0, ("Izz", 2): 1.0},
        "β2": {("mcy", 3): 1.0, ("mcz", 2): 1.0, **_masses(sign_of_d3_in_beta_2 * d3, 4, 5, 6, 7)},
        "β3": {("Ixx", 2): 1.0, ("Izz", 2): -1.0, ("Izz", 3): 1.0, **_masses(d3**2, 4, 5, 6, 7)},
        "β4": {("Iyy", 2): 1.0, ("Izz", 3): 1.0, **_masses(d3**2, 4, 5, 6, 7)},
        "β5": {("mcy", 4): 1.0, ("mcz", 3): 1.0, **_masses(d4, 5, 6, 7)},
        "β6": {("Ixx", 3): 1.0, ("Izz", 3): -1.0, ("Izz", 4): 1.0, **_masses(d4**2, 5, 6, 7)},
        "β7": {("Iyy", 3): 1.0, ("Izz", 4): 1.0, **_masses(d4**2, 5, 6, 7)},
        "β8": {("Iyz", 3): 1.0, ("mcy", 4): -d3, **_masses(-d3 * d4, 5, 6, 7)},
        "β9": {("mcy", 5): 1.0, ("mcz", 4): 1.0, **_masses(d5, 6, 7)},
        "β10": {("Ixx", 4): 1.0, ("Izz", 4): -1.0, ("Izz", 5): 1.0, **_masses(d5**2, 6, 7)},
        "β11": {("Iyy", 4): 1.0, ("Izz", 5): 1.0, **_masses(d5**2, 6, 7)},
        "β12": {("Iyz", 4): 1.0, ("mcy", 5): -d4, **_masses(-d4 * d5, 6, 7)},
        "β13": {("mcy", 6): 1.0, ("mcz", 5): 1.0},
        "β14": {("Ixx", 5): 1.0, ("Izz", 5): -1.0, ("Izz", 6): 1.0},
        "β15": {("Iyy", 5): 1.0, ("Izz", 6): 1.0},
        "β16": {("Iyz", 5): 1.0, ("mcy", 6): -d5},
        "β17": {("mcz", 6): 1.0, ("mcz", 7): 1.0},
        "β18": {("Ixx", 6): 1.0, ("Iyy", 7): 1.0, ("Izz", 6): -1.0},
        "β19": {("Iyy", 6): 1.0, ("Iyy", 7): 1.0},
        "β20": {("Ixx", 7): 1.0, ("Iyy", 7): -1.0},
    }


# Table 2, white cells: identifiable alone.
ALONE = tuple(
    (name, link)
    for link, names in {
        2: ("mcx", "Ixy", "Ixz", "Iyz"),
        3: ("mcx", "Ixy", "Ixz"),
        4: ("mcx", "Ixy", "Ixz"),
        5: ("mcx", "Ixy", "Ixz"),
        6: ("mcx", "Ixy", "Ixz", "Iyz"),
        7: ("mcx", "mcy", "Ixy", "Ixz", "Iyz", "Izz"),
    }.items()
    for name in names
)

# Table 4: of β1 … β20 the columns CAD, ULS and CLS-3 [kg, m].
TABLE_4 = {
    "β1": (0.003715, -0.027334, 0.000824),
    "β2": (-0.956111, -1.391333, -1.390848),
    "β3": (0.413706, 0.535243, 0.594658),
    "β4": (0.414086, 0.585506, 0.596306),
    "β5": (-0.016199, -0.035576, -0.03573),
    "β6": (0.000463, 0.031621, 0.004703),
    "β7": (0.000843, 0.024736, 0.006755),
    "β8": (-0.006642, -0.017786, -0.008831),
    "β9": (-0.370088, -0.572468, -0.572292),
    "β10": (0.116272, 0.165417, 0.173466),
    "β11": (0.116576, 0.188398, 0.177551),
    "β12": (-0.00357, -0.015456, -0.004862),
    "β13": (0.0, -0.002278, -0.002054),
    "β14": (0.002554, -0.002358, 0.000973),
    "β15": (0.002647, -0.006334, 0.001497),
    "β16": (0.0, 0.000519, -0.001571),
    "β17": (-0.042324, 0.142087, 0.142759),
    "β18": (0.003917, 0.036578, 0.017273),
    "β19": (0.00401, 0.021991, 0.017606),
    "β20": (0.0, -0.018514, 0.000107),
}

# Table 5, the consistency rows: CAD, ULS, CLS-1, CLS-2, CLS-3.
TABLE_5_METHODS = ("CAD", "ULS", "CLS-1", "CLS-2", "CLS-3")
TABLE_5_CONSISTENCY = {
    "physical feasibility (3)": (True, False, False, True, True),
    "triangle inequality (4)": (True, False, False, False, True),
    "first moment (5) or (6)": (True, False, True, True, True),
}
# Table 5: relative errors ς_r by identification and validation trajectory, in the methods' order.
TABLE_5_ERRORS = {
    (1, 1): (0.39842, 0.07097, 0.34454, 0.17023, 0.07297),
    (1, 2): (0.39431, 0.10872, 0.34224, 0.13477, 0.10647),
    (1, 3): (0.43991, 0.13407, 0.40725, 0.1874, 0.12791),
    (1, 4): (0.42289, 0.12647, 0.38421, 0.20172, 0.1206),
    (1, 5): (0.41734, 0.10735, 0.37147, 0.15957, 0.1071),
    (2, 2): (0.39431, 0.05909, 0.34222, 0.11841, 0.0621),
    (2, 1): (0.39842, 0.11017, 0.3443, 0.18741, 0.09599),
    (2, 3): (0.43991, 0.10448, 0.40728, 0.18031, 0.09691),
    (2, 4): (0.42289, 0.11404, 0.3842, 0.19432, 0.09794),
    (2, 5): (0.41734, 0.09305, 0.37148, 0.16051, 0.08475),
    (3, 3): (0.43991, 0.08963, 0.40677, 0.17403, 0.0903),
    (3, 1): (0.39842, 0.08884, 0.3439, 0.18363, 0.08928),
    (3, 2): (0.39431, 0.06651, 0.34183, 0.12555, 0.06609),
    (3, 4): (0.42289, 0.09381, 0.38369, 0.19269, 0.09225),
    (3, 5): (0.41734, 0.07827, 0.07827, 0.15934, 0.07852),
    (4, 4): (0.42289, 0.08982, 0.38382, 0.19105, 0.09044),
    (4, 1): (0.39842, 0.08842, 0.34425, 0.18409, 0.08766),
    (4, 2): (0.39431, 0.06663, 0.34195, 0.12303, 0.06678),
    (4, 3): (0.43991, 0.09291, 0.40691, 0.17648, 0.09193),
    (4, 5): (0.41734, 0.07911, 0.37138, 0.16069, 0.07902),
    (5, 5): (0.41734, 0.07412, 0.37152, 0.1582, 0.07676),
    (5, 1): (0.39842, 0.12469, 0.34457, 0.17503, 0.08743),
    (5, 2): (0.39431, 0.08688, 0.34238, 0.12886, 0.0655),
    (5, 3): (0.43991, 0.12472, 0.4074, 0.18003, 0.09326),
    (5, 4): (0.42289, 0.13693, 0.38436, 0.19691, 0.09333),
}


def coefficients(terms: dict[tuple[str, int], float]) -> Array:
    """A combination as a row over all 70 parameters, ``(70,)``."""
    row = np.zeros(70)
    for (name, link), factor in terms.items():
        row[10 * (link - 1) + _PARAMETERS.index(name)] = factor
    return row


def published_rows(sign_of_d3_in_beta_2: float = 1.0) -> Array:
    """The 43 base parameters of Tables 2 and 3 over all 70 parameters, ``(43, 70)``; β1 … β20 first."""
    grouped = [coefficients(terms) for terms in combinations(sign_of_d3_in_beta_2).values()]
    return np.array(grouped + [coefficients({term: 1.0}) for term in ALONE])


def denavit_hartenberg(q: Array) -> tuple[Array, Array]:
    """Rotations ``(7, 3, 3)`` of the article's frames 1 … 7 and the origins ``(7, 3)`` of frames 0 … 6, from
    Table 1 alone."""
    rotation, origin = np.eye(3), np.zeros(3)
    rotations, origins = [], []
    for joint in range(1, 8):
        origins.append(origin.copy())
        origin = origin + D[joint] * rotation[:, 2]
        c, s, right = np.cos(q[joint - 1]), np.sin(q[joint - 1]), joint < 7
        about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        about_x = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]) if right else np.eye(3)
        rotation = rotation @ about_z @ about_x
        rotations.append(rotation)
    return np.array(rotations), np.array(origins)
