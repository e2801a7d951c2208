"""Files of motion laboratories: what is written comes back, and broken ones say where."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.virtual_person import write_mot, write_trc
from excite.errors import InputError, LogError
from excite.human.markers.marker_set import MarkerSite, find_marker_set, read_marker_set
from excite.human.plates import pressure_center
from excite.human.recording_files import read_recording
from tests.human.c3d_file import DEC, Style, plate_of, write
from tests.human.recordings import write_c3d

pytestmark = pytest.mark.usefixtures("readers_here")

FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def test_trc(session, tmp_path):
    trial = session.trial
    trial.markers["C7"][10] = np.nan
    read = read_recording(write_trc(trial, tmp_path / "a.trc"))
    trial.markers["C7"][10] = 0.5 * (trial.markers["C7"][9] + trial.markers["C7"][11])
    assert np.isnan(read.markers["C7"][10]).all()
    assert read.turn_axes(FROM_Y_UP).markers["RHND"] == pytest.approx(trial.markers["RHND"], abs=1e-6)
    assert read.rate_hz == pytest.approx(100.0)


def test_mot(session, tmp_path):
    trial = session.trial
    read = read_recording(write_mot(trial, tmp_path / "a.mot")).turn_axes(FROM_Y_UP)
    for plate, was, foot in zip(read.plates, trial.plates, ("right", "left"), strict=True):
        assert plate.foot == foot
        assert plate.force == pytest.approx(was.force, abs=1e-5)
        loaded = was.force[:, 2] > 20.0
        assert plate.moment[loaded] == pytest.approx(was.moment[loaded], abs=5e-3)


def test_c3d(session, tmp_path):
    trial = session.trial
    read = read_recording(write_c3d(trial, tmp_path / "a.c3d"))
    assert read.markers["LHEEL"] == pytest.approx(trial.markers["LHEEL"], abs=1e-6)
    for plate, was in zip(read.plates, trial.plates, strict=True):
        n = len(was.force)
        assert plate.corners == pytest.approx(was.corners, abs=1e-6)
        assert plate.force[:n] == pytest.approx(was.force, abs=1e-3)
        assert plate.moment[:n] == pytest.approx(was.moment, abs=1e-3)


def test_csv(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(
        "time,A.x,A.y,A.z,plate.p.fx,plate.p.fy,plate.p.fz,plate.p.tx,plate.p.ty,plate.p.tz\n"
        "0,1,2,3,0,0,700,140,-70,0\n0.01,,,,0,0,700,140,-70,0\n"
    )
    read = read_recording(file)
    assert read.markers["A"][0].tolist() == [1, 2, 3] and np.isnan(read.markers["A"][1]).all()
    plate = read.plates[0]
    assert pressure_center(plate.force, plate.moment, 0.0)[0] == pytest.approx([0.1, 0.2, 0.0])


def test_a_centre_of_pressure_is_where_the_force_has_the_moment_on_a_plane_of_any_height():
    at, force = np.array([0.1, -0.2, 0.3]), np.array([40.0, -25.0, 600.0])
    moment = np.cross(at, force)
    assert pressure_center(force[None], moment[None], at[2])[0] == pytest.approx(at)


ODD = (
    (
        "Time [ms];A X (mm);A Y (mm);A Z (mm);FP1_Fx [N];FP1_Fy [N];FP1_Fz [N];FP1_Mx [Nmm];FP1_My [Nmm];FP1_Mz [Nmm]",
        "0;1000;2000;3000;0;0;700,0;140000;-70000;0",
        ";",
    ),
    ("t,A_X,A_Y,A_Z,Fx1,Fy1,Fz1,COPx1,COPy1,Tz1", "0,1,2,3,0,0,700,0.1,0.2,0", ","),
    (
        "frame\ttime\tA:x\tA:y\tA:z\tleft - Fx\tleft - Fy\tleft - Fz\tleft - Mx\tleft - My\tleft - Mz",
        "7\t0\t1\t2\t3\t0\t0\t700\t140\t-70\t0",
        "\t",
    ),
)


@pytest.mark.parametrize(("names", "row", "separator"), ODD)
def test_tables_with_other_names_units_and_separators(tmp_path, names, row, separator):
    file = tmp_path / "a.csv"
    later = row.split(separator)
    later[1 if "frame" in names else 0] = "10" if "ms" in names else "0.01"
    file.write_text("\n".join([names, row, separator.join(later)]) + "\n")
    read = read_recording(file)
    assert list(read.markers) == ["A"] and read.markers["A"][0].tolist() == [1, 2, 3]
    (plate,) = read.plates
    assert pressure_center(plate.force, plate.moment, 0.0)[0] == pytest.approx([0.1, 0.2, 0.0])
    assert read.findings == ()


def test_labels_of_ones_own_are_named_with_the_file_that_maps_them():
    with pytest.raises(InputError, match="Crown, Hip, Knee") as raised:
        find_marker_set(["Knee", "Crown", "Hip"])
    assert "schema: excite.markers/1" in raised.value.remedy


def test_a_plate_without_moments_is_asked_for_and_one_without_free_torque_is_named(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("time,A.x,A.y,A.z,Fx,Fy,Fz\n0,1,2,3,0,0,700\n0.01,1,2,3,0,0,700\n")
    with pytest.raises(LogError, match="neither moments nor a centre of pressure"):
        read_recording(file)
    file.write_text("time,A.x,A.y,A.z,Fx,Fy,Fz,COPx,COPy\n0,1,2,3,0,0,700,0.1,0\n0.01,1,2,3,0,0,700,,\n")
    read = read_recording(file)
    assert [found.kind for found in read.findings] == ["free_torque"]
    assert read.plates[0].moment.tolist() == [[0, -70, 0], [0, 0, 0]]


_STORED = " ".join(f"{{0}}{kind}{axis}" for kind in "vp" for axis in "xyz")


@pytest.mark.parametrize(
    ("stem", "torque", "name"),
    [
        ("ground_force_", "ground_torque_", "plate_1"),
        ("1_ground_force_", "1_ground_torque_", "plate_1"),
        ("ground_force_r_", "ground_torque_r_", "plate_right"),
        ("l_ground_force_", "l_ground_torque_", "plate_left"),
        ("FP1_", "FP1_t", "plate_1"),
        ("ground_force_calcn_r_", "ground_force_calcn_r_m", "plate_right"),
    ],
)
def test_forces_of_a_storage_file_by_any_of_the_usual_names(tmp_path, stem, torque, name):
    """Where the plate is not loaded its point of application may be missing."""
    file = tmp_path / "a.mot"
    names = f"time {_STORED.format(stem)} " + " ".join(f"{torque}{axis}" for axis in "xyz")
    file.write_text(f"a\nendheader\n{names}\n0 0 0 0 nan nan nan 0 0 0\n0.01 0 700 0 0.1 0 0.2 1 2 3\n")
    (plate,) = read_recording(file).plates
    assert plate.name == name and plate.force.tolist() == [[0, 0, 0], [0, 700, 0]]
    assert plate.moment == pytest.approx(np.array([[0, 0, 0], [1 - 140, 2, 3 + 70]]))


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.trc", "nothing", "is no TRC file"),
        ("a.mot", "a\nendheader\ntime x\n1 2\n2 2\n", "ground reaction force"),
        ("a.mot", "a\nendheader\ntime ground_force_vx\n1 2 3\n1 2\n", "line 4 has 3 fields for 2"),
        ("a.csv", "time,A.x\n0,1\n0,2\n", "does not rise"),
        ("a.csv", "time,A.x\n0,1\n1,2\n", "A.y"),
        ("a.c3d", "nothing", "is no C3D file"),
        ("a.xyz", "nothing", "no reader"),
    ],
)
def test_broken_files_are_named(tmp_path, name, text, says):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(LogError, match=says) as error:
        read_recording(file)
    assert str(file) in str(error.value) and "\n" not in str(error.value)


def test_mapping_file(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "schema: excite.markers/1\nmarkers:\n  K: {landmark: right_lateral_knee}\n  T: {segment: head}\n"
    )
    sites = read_marker_set(file).sites
    assert sites["K"] == MarkerSite("right_thigh", "right_lateral_knee") and sites["T"] == MarkerSite("head")
    file.write_text("schema: excite.markers/1\nmarkers:\n  K: {landmark: nose}\n")
    with pytest.raises(InputError, match=r"markers.K: no landmark 'nose'"):
        read_marker_set(file)


def test_the_set_is_found_by_its_labels(session):
    assert len(read_marker_set("jovic").sites) == 35
    assert find_marker_set([f"Anna:{label}" for label in session.trial.markers]).name == "jovic"
    with pytest.raises(InputError, match="mapping file"):
        find_marker_set(["M1", "M2", "M3"])


@pytest.fixture(scope="module")
def laboratory():
    """Two markers, one with a gap, and the wrench of one plate, at 100 Hz and 1000 Hz."""
    rng = np.random.default_rng(4)
    time = np.arange(40) / 100.0
    markers = {"LASI": np.column_stack([0.1 + time, -0.2 * time, 0.9 + 0 * time]), "RASI": np.zeros((40, 3))}
    markers["RASI"][:] = markers["LASI"] + [0.0, -0.25, 0.01]
    markers["RASI"][7:11] = np.nan
    force = np.column_stack([rng.normal(0, 20, (400, 2)), 700 + rng.normal(0, 30, 400)])
    point = np.array([0.52, 0.23, 0.0]) + np.append(rng.normal(0, 0.05, (400, 2)), np.zeros((400, 1)), axis=1)
    moment = np.cross(point, force) + np.outer(rng.normal(0, 3, 400), [0.0, 0.0, 1.0])
    # x of the plate across the laboratory, its z down.
    corners = np.array([[0.7, 0.5, 0], [0.7, -0.1, 0], [0.3, -0.1, 0], [0.3, 0.5, 0]])
    return markers, force, moment, corners


@pytest.mark.parametrize("kind", [2, 3, 4])
@pytest.mark.parametrize(
    "style",
    [
        Style(),
        Style(processor=DEC),
        Style(integers=True),
        Style(processor=DEC, integers=True, first_frame=351),
        Style(unit=("m", 1.0), moment_unit="Nm"),
        Style(unit=("m", 1.0), moment_unit=None),
        Style(moment_unit=None),
        Style(prefix="S01:", extra=300),
    ],
    ids=["intel", "dec", "integers", "dec integers", "metres", "metres, no units", "no units", "labels2"],
)
def test_c3d_of_the_field(laboratory, tmp_path, style, kind):
    """Whatever the processor, number format, units, plate and count of labels: positions, gaps, wrenches come back."""
    markers, force, moment, corners = laboratory
    length = style.unit[1]
    plate = plate_of(kind, corners * length, 0.045 * length, force, moment * length)
    read = read_recording(write(tmp_path / "field.c3d", markers, 100.0, [plate], style))
    for label, true in markers.items():
        assert read.markers[style.prefix + label] == pytest.approx(true, abs=1e-4, nan_ok=True), label
    assert len(read.time) == 40 and read.rate_hz == pytest.approx(100.0)
    (found,) = read.plates
    assert len(found.force) == 400 and found.time[10] == pytest.approx(0.01)
    assert found.force == pytest.approx(force, abs=0.1)
    assert found.moment == pytest.approx(moment, abs=0.1)
    assert found.corners == pytest.approx(corners, abs=1e-4)
