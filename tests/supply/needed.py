"""The installed distributions that a project file asks for, those that they need included."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

EXTRAS = ("test", "lint", "docs")


def stated(project_file: Path, extras: Iterable[str] = EXTRAS) -> list[str]:
    """Requirements as a pyproject.toml states them, those of some extras included.

    The file is read and not the metadata of what is installed, which is that of the last installation.
    """
    project = tomllib.loads(project_file.read_text(encoding="utf-8"))["project"]
    optional = project.get("optional-dependencies", {})
    return [*project.get("dependencies", []), *(line for extra in extras for line in optional.get(extra, []))]


def needed(
    requirements: Iterable[str], environment: Mapping[str, str] | None = None
) -> dict[str, Distribution]:
    """Installed distributions that requirements lead to, however many steps away, by normalised name.

    Args:
        requirements: as in a project file, for example ``"numpy>=2; python_version < '3.14'"``.
        environment: values of markers that differ from those of this interpreter.

    Raises:
        PackageNotFoundError: one of them is not installed; its message says which and who asks for it.
    """
    found: dict[str, Distribution] = {}
    waiting = [("the project", line, frozenset[str]()) for line in requirements]
    done = set()
    while waiting:
        source, line, extras = waiting.pop()
        requirement = Requirement(line)
        name = canonicalize_name(requirement.name)
        wanted = (name, frozenset(requirement.extras))
        if not _applies(requirement, extras, environment) or wanted in done:
            continue
        done.add(wanted)
        try:
            found[name] = distribution(requirement.name)
        except PackageNotFoundError as error:
            raise PackageNotFoundError(f"{name}, which {source} needs") from error
        waiting += [(name, line, wanted[1]) for line in found[name].requires or []]
    return dict(sorted(found.items()))


def _applies(requirement: Requirement, extras: frozenset[str], environment: Mapping[str, str] | None) -> bool:
    """Whether a requirement counts here, given the extras that were asked for of the one that states it."""
    if requirement.marker is None:
        return True
    values = dict(environment or {})
    return any(requirement.marker.evaluate({**values, "extra": extra}) for extra in ("", *extras))
