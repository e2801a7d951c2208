"""Values that wait on disk."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np
import pytest

from excite.campaign.pool import OnDisk, write_value
from excite.errors import InputError
from excite.temporary_folder import TemporaryFolder


@pytest.fixture
def values() -> list[np.ndarray]:
    random = np.random.default_rng(0)
    return [random.normal(size=(3, i + 1)) for i in range(5)]


@pytest.fixture
def kept(values: list[np.ndarray]) -> OnDisk[np.ndarray]:
    folder = TemporaryFolder()
    files = tuple(write_value(value, folder.path / f"{i}.value") for i, value in enumerate(values))
    return OnDisk(files, folder)


def test_values_come_back_bit_for_bit(kept: OnDisk[np.ndarray], values: list[np.ndarray]) -> None:
    assert len(kept) == 5
    for found, value in zip(kept, values, strict=True):
        assert found.tobytes() == value.tobytes()
    assert [value.shape[1] for value in kept.only([3, 0])] == [4, 1]
    assert [value.shape[1] for value in kept[1:3]] == [2, 3]
    with pytest.raises(IndexError):
        kept[5]


def test_each_access_reads_anew_so_that_nothing_stays_in_memory(kept: OnDisk[np.ndarray]) -> None:
    assert kept[0] is not kept[0]


def test_the_folder_goes_with_the_last_that_refers_to_it(kept: OnDisk[np.ndarray]) -> None:
    folder = TemporaryFolder()
    path, part = folder.path, OnDisk((write_value(1, folder.path / "one"),), folder).only([0])
    del folder
    gc.collect()
    assert part[0] == 1
    del part
    gc.collect()
    assert not path.exists()


def test_a_folder_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone.*TMPDIR"):
        write_value(1, tmp_path / "gone" / "value")
