"""What Jovic et al. print about HRP-2: IROS 2015 (excitation, QP) and IEEE T-RO 32(3), 2016 (HQP)."""

from __future__ import annotations

# IROS 2015, Table I: condition numbers of the sub-regressors of segments 1 … 31 of HRP-2.
CONDITION_NUMBERS = (
    *(463, 598, 98),
    *(79, 33, 7, 7, 9, 12),
    *(80, 33, 7, 7, 9, 11),
    *(432, 68),
    *(344, 11, 9, 7, 7, 7, 7),
    *(331, 11, 8, 8, 7, 6, 6),
)

# IROS 2015, Table II, HRP-2: by validation and axis of force and moment: RMSE and CC identified, RMSE and CC CAD.
IROS_TABLE_2 = {
    ("direct", "fx"): (7.3, 0.65, 7.4, 0.58),
    ("direct", "fy"): (7.4, 0.32, 7.9, 0.30),
    ("direct", "fz"): (6.8, 0.95, 45.6, 0.94),
    ("direct", "tx"): (4.8, 0.92, 6.5, 0.90),
    ("direct", "ty"): (6.2, 0.96, 7.4, 0.96),
    ("direct", "tz"): (2.7, 0.81, 2.7, 0.80),
    ("cross", "fx"): (8.0, 1.00, 9.3, 1.00),
    ("cross", "fy"): (12.4, 0.14, 13.8, 0.14),
    ("cross", "fz"): (9.8, 0.98, 32.8, 0.98),
    ("cross", "tx"): (5.0, 0.93, 6.3, 0.87),
    ("cross", "ty"): (6.7, 0.92, 12.4, 0.92),
    ("cross", "tz"): (5.3, 0.31, 5.5, 0.28),
}

# IROS 2015, Table III: identified centre of mass [m] and diagonal of the inertia about the segment's frame
# [kg·m²] of the trunk (1-3) and the right leg (4-9).
COM = (
    (-0.095, 0.013, 0.108),
    (0.007, 0.005, -0.016),
    (0.187, -0.015, 0.500),
    (-0.010, 0.003, 0.074),
    (0.0, -0.027, 0.057),
    (0.013, -0.078, -0.123),
    (-0.014, -0.058, -0.083),
    (0.013, 0.006, 0.114),
    (0.0, -0.006, -0.07),
)
MOMENTS = (
    (0.1910, 0.0068, 0.1054),
    (0.0050, 0.0050, 0.0050),
    (5.5495, 5.3242, 0.0050),
    (0.0083, 0.0089, 0.0050),
    (0.0050, 0.0050, 0.0050),
    (0.0594, 0.0561, 0.0164),
    (0.0369, 0.0292, 0.0103),
    (0.0050, 0.0087, 0.0050),
    (0.0155, 0.0207, 0.0051),
)

# T-RO 2016, Table I: RMSE and CC identified, RMSE and CC CAD.
TRO_TABLE_1 = {
    "fz": (37.20, 0.65, 52.50, 0.63),
    "fy": (13.40, 0.88, 17.90, 0.77),
    "fx": (14.60, 0.75, 15.80, 0.65),
    "tz": (1.70, 0.75, 2.10, 0.69),
    "ty": (5.00, 0.95, 9.40, 0.87),
    "tx": (7.00, 0.85, 11.40, 0.71),
}

# T-RO 2016, Table II: identified masses of segments 1 … 31 in percent of CAD.
MASS_PERCENT = (
    *(111.03, 135.00, 135.00),
    *(102.94, 151.23, 77.42, 95.00, 95.00, 84.99),
    *(102.94, 151.23, 77.42, 95.00, 95.00, 84.99),
    *(135.00, 135.00),
    *(95.00, 95.00, 95.00, 104.99, 135.00, 134.99, 135.00),
    *(95.00, 95.00, 95.00, 104.99, 135.00, 134.99, 135.00),
)

# Segments to which β = 0.35 is given, the others have 0.05: those that Table II shows at 135 %, and the trunk.
MODIFIED = (1, 2, 3, 16, 17, 22, 23, 24, 29, 30, 31)

# Parts of the body by segment number.
PARTS = {
    "trunk": (1, 2, 3),
    "right leg": tuple(range(4, 9)),
    "left leg": tuple(range(10, 15)),
    "head": (16, 17),
    "right upper arm and forearm": tuple(range(18, 22)),
    "right hand": (22, 23, 24),
    "left upper arm and forearm": tuple(range(25, 29)),
    "left hand": (29, 30, 31),
}
