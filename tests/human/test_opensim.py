"""Scaled OpenSim models: masses of segments, markers by segment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.errors import InputError
from excite.human.body import body_of
from excite.human.measure import read_osim
from excite.human.segments import NAMES, Subject

BODY = body_of(Subject(72.84, 1.80, "male"))


def written(folder: Path, bodies: str, markers: str = "") -> Path:
    file = folder / "anna.osim"
    file.write_text(f"<OpenSimDocument><Model>{bodies}{markers}</Model></OpenSimDocument>")
    return file


def test_a_body_for_each_segment_has_its_mass(tmp_path: Path) -> None:
    own = zip(NAMES, BODY.inertias, strict=True)
    bodies = "".join(f'<Body name="{name}"><mass>{body.mass}</mass></Body>' for name, body in own)
    found = read_osim(written(tmp_path, bodies)).segment_masses(BODY)
    np.testing.assert_allclose([found[name] for name in NAMES], [b.mass for b in BODY.inertias], rtol=1e-6)


def test_bodies_are_put_together_and_what_has_none_is_part_of_its_carrier(tmp_path: Path) -> None:
    masses = {
        "pelvis": 10,
        "torso": 30,
        "femur_r": 8,
        "femur_l": 9,
        "tibia_r": 3,
        "patella_r": 0.1,
        "tibia_l": 3,
    }
    masses |= {
        "calcn_r": 1,
        "toes_r": 0.2,
        "calcn_l": 1.2,
        "humerus_r": 2,
        "humerus_l": 2,
        "ulna_r": 1,
        "radius_r": 0.5,
    }
    bodies = "".join(f'<Body name="{name}"><mass>{mass}</mass></Body>' for name, mass in masses.items())
    markers = (
        '<Marker name="RASI"><socket_parent_frame>/bodyset/pelvis</socket_parent_frame></Marker>'
        '<Marker name="LTH1"><body>femur_l</body></Marker>'
        '<Marker name="LLEL"><body>tibia_l</body></Marker><Marker name="WALL"><body>ground</body></Marker>'
    )
    model = read_osim(written(tmp_path, bodies, markers))
    found, scale = model.segment_masses(BODY), 72.84 / sum(masses.values())
    assert sum(found.values()) == pytest.approx(72.84)
    assert found["right_shank"] == pytest.approx(3.1 * scale) and found["right_foot"] == pytest.approx(
        1.2 * scale
    )
    # The head is the torso's, as the tables share it out; the left arm, without a forearm, is the upper arm's body.
    own = dict(zip(NAMES, (b.mass for b in BODY.inertias), strict=True))
    assert found["head"] / found["torso"] == pytest.approx(own["head"] / own["torso"])
    assert sum(found[f"left_{part}"] for part in ("upper_arm", "forearm", "hand")) == pytest.approx(
        2.0 * scale
    )
    sites = model.markers.sites
    assert (sites["RASI"].segment, sites["RASI"].landmark) == ("pelvis", "right_asis")
    # Elsewhere than a known set has it, a label stands for no landmark.
    assert (sites["LLEL"].segment, sites["LLEL"].landmark) == ("left_shank", None)
    assert sites["LTH1"].segment == "left_thigh" and "WALL" not in sites


@pytest.mark.parametrize(
    ("bodies", "said"),
    [
        ('<Body name="pelvis"><mass>10</mass></Body><Body name="tail"><mass>2</mass></Body>', "tail"),
        ('<Body name="torso"><mass>10</mass></Body>', "no pelvis"),
        ('<Body name="pelvis"><mass>heavy</mass></Body>', "is no number"),
    ],
)
def test_a_model_that_is_none_is_one_line(bodies: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        read_osim(written(tmp_path, bodies))


def test_a_person_that_the_scale_tool_wrote(data_dir: Path) -> None:
    model = read_osim(data_dir / "human_running_rajagopal" / "subject_scaled_run.osim")
    found = model.segment_masses(BODY)
    assert found["right_thigh"] == pytest.approx(8.993 * 72.84 / 72.73, abs=0.2)
    assert found["left_forearm"] == pytest.approx(2 * 0.587, abs=0.05)
    assert model.markers.sites["RTB2"].segment == "right_shank" and len(model.markers.sites) == 64
    own = BODY.with_masses(found, "anna.osim")
    assert own.mass_origin == f"{BODY.table}, masses from anna.osim" and BODY.mass_origin == BODY.table
