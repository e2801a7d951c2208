"""Libraries that share C++ code by exact version: looked at once, before the first of them is loaded.

Another version of one of them, which a later ``pip install`` may bring, ends in a missing symbol or a crash far from
its cause. Names of installed distributions are those of folders, so that the look costs a millisecond."""

from __future__ import annotations

import importlib.machinery
import re
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from importlib.abc import MetaPathFinder
from pathlib import Path
from types import ModuleType

from excite.errors import InputError

FAMILY = {
    "placo": "0.10.2",
    "pin": "3.8.0",
    "libpinocchio": "3.8.0",
    "coal": "3.0.2",
    "libcoal": "3.0.2",
    "eigenpy": "3.12.0",
    "cmeel-boost": "1.89.0",
    "cmeel-urdfdom": "4.0.1",
    "cmeel-tinyxml2": "10.0.0",
    "eiquadprog": "1.3.0",
    "proxsuite": "0.8.0",
    "example-robot-data": "6.0.0",
}
"""The versions that go together, as pyproject.toml pins them."""

_LOADED_FIRST = ("pinocchio", "placo", "coal", "eigenpy")


def installed_versions(folders: Sequence[Path]) -> dict[str, str]:
    """Versions of the family's distributions that lie in folders of packages; of two the first folder's."""
    found: dict[str, str] = {}
    for folder in folders:
        for path in folder.glob("*.dist-info") if folder.is_dir() else ():
            name, _, version = path.name.removesuffix(".dist-info").partition("-")
            name = re.sub(r"[-_.]+", "-", name).lower()
            if name in FAMILY:
                found.setdefault(name, version)
    return found


def check_family(versions: Mapping[str, str]) -> None:
    """Raise InputError where a version is none that goes with the others; what is not there is not looked at."""
    odd = {name: version for name, version in versions.items() if FAMILY[name] != version}
    if not odd:
        return
    said = ", ".join(f"{name} {version} (needs {FAMILY[name]})" for name, version in sorted(odd.items()))
    wanted = " ".join(f"{name}=={FAMILY[name]}" for name in sorted(odd))
    raise InputError(
        f"versions do not go together: {said}", source="installed packages", remedy=f"pip install {wanted}"
    )


class _Watch(MetaPathFinder):
    """Looks at the versions when the first of the family is imported, by whomever, and then goes away."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find nothing; raises InputError as :func:`check_family`."""
        if fullname in _LOADED_FIRST:
            sys.meta_path.remove(self)
            paths = sysconfig.get_paths()
            check_family(installed_versions([Path(paths[kind]) for kind in ("purelib", "platlib")]))
        return None


def watch_imports() -> None:
    """Have the versions looked at once, before the first of the family is loaded."""
    if not any(isinstance(finder, _Watch) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Watch())
