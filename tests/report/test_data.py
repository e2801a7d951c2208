"""The arrays beside the JSON files: what is saved comes back, and what is malformed is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from excite.errors import InputError
from excite.report.comparisons import ReportData, load_report_data, save_report_data
from tests.report.sample import sample_data


def test_round_trip(g1, tmp_path):
    data = sample_data(g1)
    again = load_report_data(save_report_data(data, tmp_path / "report_data.npz"))
    for part in dataclasses.fields(ReportData):
        before, after = getattr(data, part.name), getattr(again, part.name)
        for field in dataclasses.fields(before):
            np.testing.assert_array_equal(getattr(after, field.name), getattr(before, field.name))


def test_what_is_not_known_stays_unknown(g1, tmp_path):
    masses = dataclasses.replace(sample_data(g1).masses, true=None, changed=None)
    again = load_report_data(save_report_data(ReportData(masses=masses), tmp_path / "report_data.npz"))
    assert again.forces is None and again.conditioning is None
    assert again.masses.true is None and again.masses.changed is None


@pytest.mark.parametrize(
    ("part", "change", "field"),
    [
        ("forces", {"nominal": np.zeros((3, 6))}, "forces/nominal"),
        ("masses", {"true": np.zeros(2)}, "masses/true"),
        ("conditioning", {"after": np.zeros(1)}, "conditioning/after"),
    ],
)
def test_lengths_that_disagree_are_named(part, change, field, g1, tmp_path):
    data = sample_data(g1)
    broken = dataclasses.replace(data, **{part: dataclasses.replace(getattr(data, part), **change)})
    path = save_report_data(broken, tmp_path / "report_data.npz")
    with pytest.raises(InputError) as caught:
        load_report_data(path)
    assert caught.value.field == field and caught.value.source == path


def test_a_missing_field_is_named(tmp_path):
    path = tmp_path / "report_data.npz"
    np.savez(path, **{"masses/names": np.array(["torso"]), "masses/nominal": np.ones(1)})
    with pytest.raises(InputError, match="masses/identified: is missing"):
        load_report_data(path)


def test_a_torn_file_is_refused(g1, tmp_path):
    path = save_report_data(sample_data(g1), tmp_path / "report_data.npz")
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InputError, match="cannot be read"):
        load_report_data(path)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ["f2", "f4", "i8", "f16"])
def test_numbers_of_any_precision_are_read_as_double(kind, tmp_path):
    arrays = {f"masses/{name}": np.ones(1, kind) for name in ("nominal", "identified")}
    path = tmp_path / "report_data.npz"
    np.savez(path, **{"masses/names": np.array(["torso"]), **arrays})
    assert load_report_data(path).masses.nominal.dtype == float
    if kind == "f16":
        arrays["masses/nominal"] = np.array([np.longdouble("1e4000")])
        np.savez(path, **{"masses/names": np.array(["torso"]), **arrays})
        with pytest.raises(InputError, match="masses/nominal: holds NaN or infinity"):
            load_report_data(path)
