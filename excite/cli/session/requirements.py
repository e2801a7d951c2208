"""Packages that are not as excite asks for them: what an error that nobody foresaw is most often about.

The libraries that share C++ code are looked at before they are loaded (:mod:`excite.binary_family`); of all others any
version may do, so that they are looked at only after something failed.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from importlib import metadata


@dataclass(frozen=True)
class Unmet:
    """A package of another version than asked for, or none at all.

    Attributes:
        asked: what pip would be told, such as ``numpy<2.4,>=2.3``.
        text: what is there and what is asked for.
    """

    asked: str
    text: str


def unmet_requirements(distribution: str = "excite") -> list[Unmet]:
    """What an installed distribution asks for, extras left out, and does not find; empty where it is not installed."""
    from packaging.requirements import Requirement
    from packaging.version import InvalidVersion

    found: list[Unmet] = []
    try:
        asked = [Requirement(text) for text in metadata.requires(distribution) or ()]
    except metadata.PackageNotFoundError:
        return []
    for one in asked:
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        wanted = f"{one.name}{one.specifier}"
        try:
            version = metadata.version(one.name)
        except metadata.PackageNotFoundError:
            found.append(Unmet(wanted, f"{one.name} is not installed"))
            continue
        try:
            fits = one.specifier.contains(version, prereleases=True)
        except (InvalidVersion, TypeError):  # of a distribution whose own description is damaged
            fits = False
        if not fits:
            found.append(Unmet(wanted, f"{one.name} {version} (needs {one.specifier})"))
    return found


def pip_install(unmet: list[Unmet]) -> str:
    """The command that puts them right, for a shell."""
    return "pip install " + " ".join(shlex.quote(one.asked) for one in unmet)
