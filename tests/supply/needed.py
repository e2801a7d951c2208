"""The installed distributions that a project file asks for, those that they need included."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
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


def needed(requirements: Iterable[str]) -> dict[str, Distribution]:
    """Installed distributions that requirements lead to, however many steps away, by normalised name.

    Args:
        requirements: as in a project file, for example ``"numpy>=2; python_version < '3.14'"``.

    Raises:
        PackageNotFoundError: one of them is not installed; its message says which and who asks for it.
    """
    found: dict[str, Distribution] = {}
    for source, name, one in _walk(requirements, {}):
        if one is None:
            raise PackageNotFoundError(f"{name}, which {source} needs")
        found[name] = one
    return dict(sorted(found.items()))


def needed_names(requirements: Iterable[str], environment: Mapping[str, str]) -> set[str]:
    """Normalised names of what requirements lead to in another environment.

    Followed as far as it is installed here: of what only the other environment needs, that it is needed is known, and
    not what it needs in turn.

    Args:
        requirements: as in a project file.
        environment: values of markers that differ from those of this interpreter.
    """
    return {name for _, name, _ in _walk(requirements, environment)}


def _walk(
    requirements: Iterable[str], environment: Mapping[str, str]
) -> Iterator[tuple[str, str, Distribution | None]]:
    """Who asks, for what, and the distribution, None where it is not installed."""
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
            one = distribution(requirement.name)
        except PackageNotFoundError:
            yield source, name, None
            continue
        yield source, name, one
        waiting += [(name, line, wanted[1]) for line in one.requires or []]


def _applies(requirement: Requirement, extras: frozenset[str], environment: Mapping[str, str]) -> bool:
    """Whether a requirement counts here, given the extras that were asked for of the one that states it."""
    if requirement.marker is None:
        return True
    return any(requirement.marker.evaluate({**environment, "extra": extra}) for extra in ("", *extras))
