"""Hulls on disk: the bits that are computed, once, and computed again where the disk does not hold them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from excite.robot.shapes import link_shapes as kept_hulls
from excite.robot.shapes.link_shapes import Hull, convex_hull, kept_hull

POINTS = np.random.default_rng(3).normal(size=(500, 3))
SETTINGS = (40, 0.01)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("EXCITE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "hulls"


def same(one: Hull, other: Hull) -> bool:
    """Whether two hulls are the same to the bit."""
    return [part.tobytes() for part in one] == [part.tobytes() for part in other]


def nobody(*_: object) -> Hull:
    raise AssertionError("was kept already")


def test_what_is_read_is_what_is_computed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computed = convex_hull(POINTS, *SETTINGS)
    assert same(kept_hull(POINTS, *SETTINGS), computed)
    assert len(list(folder.iterdir())) == 1
    monkeypatch.setattr(kept_hulls, "convex_hull", nobody)
    assert same(kept_hull(POINTS.copy(), *SETTINGS), computed)
    assert same(kept_hull(np.asfortranarray(POINTS), *SETTINGS), computed)


@pytest.mark.parametrize(
    ("points", "settings"),
    [(POINTS * (1.0 + 1e-15), SETTINGS), (POINTS, (41, 0.01)), (POINTS, (40, 0.02)), (POINTS[:-1], SETTINGS)],
)
def test_other_points_or_numbers_are_another_hull(
    points: np.ndarray, settings: tuple[int, float], folder: Path
) -> None:
    kept_hull(POINTS, *SETTINGS)
    assert same(kept_hull(points, *settings), convex_hull(points, *settings))
    assert len(list(folder.iterdir())) == 2


def test_other_code_or_kernels_are_another_hull(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept_hull(POINTS, *SETTINGS)
    monkeypatch.setattr(kept_hulls, "_rounding_key", lambda: "another processor")
    kept_hull(POINTS, *SETTINGS)
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize(
    "spoil",
    [
        lambda content: b"",
        lambda content: content[:-1],
        lambda content: content[:10],
        lambda content: content[:200] + bytes([content[200] ^ 1]) + content[201:],
    ],
    ids=["empty", "cut", "begun", "a bit turned"],
)
def test_what_is_damaged_is_computed_again(spoil: Callable[[bytes], bytes], folder: Path) -> None:
    computed = kept_hull(POINTS, *SETTINGS)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(spoil(whole))
    assert same(kept_hull(POINTS, *SETTINGS), computed)
    assert file.read_bytes() == whole


@pytest.mark.parametrize("place", ["a file", "a folder in its place", "no absolute path", "nothing"])
def test_where_nothing_can_be_kept_it_is_computed(
    place: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = kept_hull(POINTS, *SETTINGS)
    if place == "a file":
        (tmp_path / "file").touch()
        monkeypatch.setenv("EXCITE_CACHE", str(tmp_path / "file"))
    elif place == "a folder in its place":
        (file,) = folder.iterdir()
        file.unlink()
        file.mkdir()
    elif place == "no absolute path":
        monkeypatch.setenv("EXCITE_CACHE", "cache")
        monkeypatch.chdir(tmp_path)
    else:
        monkeypatch.setattr(kept_hulls, "cached_file", lambda *_: None)
    before = sorted(tmp_path.rglob("*"))
    assert same(kept_hull(POINTS, *SETTINGS), computed)
    assert sorted(tmp_path.rglob("*")) == before


def test_what_breaks_off_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(Path, "replace", full)
    assert same(kept_hull(POINTS, *SETTINGS), convex_hull(POINTS, *SETTINGS))
    assert list(folder.iterdir()) == []


def test_many_may_keep_the_same_at_once(folder: Path) -> None:
    with ThreadPoolExecutor(8) as threads:
        found = list(threads.map(lambda _: kept_hull(POINTS, *SETTINGS), range(16)))
    assert all(same(hull, found[0]) for hull in found)
    assert len(list(folder.iterdir())) == 1


def test_the_users_folder_for_caches_holds_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("EXCITE_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept_hull(POINTS, *SETTINGS)
    assert len(list((tmp_path / "excite" / "hulls").iterdir())) == 1


def test_points_in_a_plane_are_refused_each_time(folder: Path) -> None:
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    for _ in range(2):
        with pytest.raises(ValueError, match="plane"):
            kept_hull(flat, *SETTINGS)
    assert not folder.exists()
