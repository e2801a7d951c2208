"""The published numbers: sums, their own redundancy, and the masses that the literature prints."""

from __future__ import annotations

import numpy as np
import pytest

from excite.human.body import ANTHROPOMETRY, DE_LEVA_TABLE, DUMAS_TABLE, body_of
from excite.human.segments import NAMES, Subject


def paired_sum(rows, trunk) -> float:
    limbs = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
    return sum(rows[name].mass for name in trunk) + 2 * sum(rows[name].mass for name in limbs)


@pytest.mark.parametrize("sex", ["male", "female"])
def test_mass_fractions_add_up(sex):
    rows = DE_LEVA_TABLE[sex]
    assert paired_sum(rows, ("head", "trunk")) == pytest.approx(100.0, abs=0.02)
    thirds = sum(rows[f"{part} trunk"].mass for part in ("upper", "mid", "lower"))
    assert thirds == pytest.approx(rows["trunk"].mass, abs=0.011)
    assert paired_sum(DUMAS_TABLE[sex], ("head", "torso", "pelvis")) == pytest.approx(100.0, abs=0.21)


@pytest.mark.parametrize("sex", ["male", "female"])
@pytest.mark.parametrize(
    ("part", "again"), [("head", "head to cervicale"), ("trunk", "trunk from cervicale")]
)
def test_de_levas_two_end_points_mean_the_same_body(sex, part, again):
    """Radii of gyration in millimetres do not depend on the end points that a segment's length is taken from."""
    one, two = DE_LEVA_TABLE[sex][part], DE_LEVA_TABLE[sex][again]
    for axis in ("sagittal", "transverse", "longitudinal"):
        a, b = getattr(one, axis) * one.length, getattr(two, axis) * two.length
        assert a == pytest.approx(b, rel=0.005)


def test_masses_of_the_paper_are_de_levas():
    """Table IV of Jovic et al., T-RO 2016, column "Dumas", no extra weight, prints these for 70 kg."""
    printed = {
        "pelvis": 7.8,
        "torso": 22.6,
        "right_thigh": 9.9,
        "right_shank": 3.0,
        "right_foot": 0.95,
        "right_upper_arm": 1.9,
        "right_forearm": 1.1,
        "right_hand": 0.43,
    }
    body = body_of(Subject(70.0, 1.82, "male"))
    masses = {name: inertia.mass for name, inertia in zip(NAMES, body.inertias, strict=True)}
    for name, mass in printed.items():
        assert masses[name] == pytest.approx(mass, abs=0.05), name


def test_dumas_masses_of_the_mean_man():
    """Dumas et al. 2007, table 2: thigh 12.3 % and pelvis 14.2 % of 80.5 kg (they add up to 100.2 %)."""
    body = body_of(Subject(80.5, 1.77, "male"), table="dumas")
    masses = dict(zip(NAMES, (inertia.mass for inertia in body.inertias), strict=True))
    assert masses["right_thigh"] == pytest.approx(0.123 * 80.5 / 1.002)
    assert masses["pelvis"] == pytest.approx(0.142 * 80.5 / 1.002)
    assert body.dimensions["right_thigh"] == pytest.approx(0.432)
    thigh = body.inertias[NAMES.index("right_thigh")]
    # X forward, Y up, Z right: (-4.1, -42.9, 3.3) % of 432 mm; outwards is to the right, y counts to the left.
    assert thigh.lever == pytest.approx(0.432 * np.array([-0.041, -0.033, -0.429]))
    assert thigh.inertia[2, 2] == pytest.approx(thigh.mass * (0.15 * 0.432) ** 2)
    assert thigh.inertia[1, 2] == pytest.approx(thigh.mass * (0.07 * 0.432) ** 2)


@pytest.mark.parametrize("table", ANTHROPOMETRY)
@pytest.mark.parametrize("sex", ["male", "female"])
def test_every_segment_can_exist_and_both_sides_mirror(table, sex):
    body = body_of(Subject(65.0, 1.70, sex), table=table)
    assert sum(inertia.mass for inertia in body.inertias) == pytest.approx(65.0)
    for name, inertia in zip(NAMES, body.inertias, strict=True):
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert moments[0] > 0.0 and moments[0] + moments[1] > moments[2], name
    right, left = (body.inertias[NAMES.index(f"{side}_thigh")] for side in ("right", "left"))
    assert left.lever == pytest.approx(right.lever * [1, -1, 1])
    assert left.inertia[0, 1] == pytest.approx(-right.inertia[0, 1])
