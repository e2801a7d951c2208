"""A scaled OpenSim model: the masses of its segments as nominal ones, and which segment carries which marker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from excite.errors import InputError
from excite.finding import list_names
from excite.formats.documents import read_xml, read_yaml
from excite.human.body import Body
from excite.human.markers.marker_set import MARKER_SETS, MarkerSet, MarkerSite, read_marker_set
from excite.human.segments import NAMES, PARENTS

# Which segment a body of OpenSim's models belongs to, by its name without the side.
_KINDS: Mapping[str, str] = {
    body: kind
    for kind, bodies in read_yaml(Path(__file__).with_name("segment_tables.yaml"))["opensim"].items()
    for body in bodies.split()
}
_SIDES = {"_r": "right_", "_l": "left_"}


@dataclass(frozen=True)
class OpenSimModel:
    """What a scaled model says of a person.

    Attributes:
        masses: by segment that has a body of its own [kg].
        markers: segments by label, with the bony landmark where a known set has that label on that segment.
    """

    masses: Mapping[str, float]
    markers: MarkerSet

    def segment_masses(self, body: Body) -> dict[str, float]:
        """Masses of all segments, together the person's; what has no body of its own is part of what carries it.

        Args:
            body: the person by the tables, whose masses share out a body that holds several segments.
        """
        own = {name: inertia.mass for name, inertia in zip(NAMES, body.inertias, strict=True)}
        carriers = {}
        for name, parent in zip(NAMES, PARENTS, strict=True):
            carriers[name] = name if name in self.masses else carriers[NAMES[parent]]
        held = {name: sum(own[one] for one in NAMES if carriers[one] == name) for name in self.masses}
        scale = body.subject.mass / sum(self.masses.values())
        return {
            name: scale * self.masses[carrier] * own[name] / held[carrier]
            for name, carrier in carriers.items()
        }


def read_osim(path: str | Path) -> OpenSimModel:
    """Read a scaled model, of OpenSim 3 or 4.

    Raises:
        InputError: it is no such model, or a body with a mass is of no segment that is known.
    """
    path = Path(path)
    root = read_xml(path)
    if root.tag != "OpenSimDocument":
        raise InputError(
            "is no OpenSim model",
            source=path,
            field=root.tag,
            remedy="give the .osim that the scale tool wrote",
        )
    masses: dict[str, float] = {}
    unknown = []
    for body in root.iter("Body"):
        name, segment, mass = body.get("name", ""), _segment(body.get("name", "")), _mass(body, path)
        if segment is None:
            unknown += [name] if mass > 0.0 else []
        else:
            masses[segment] = masses.get(segment, 0.0) + mass
    if unknown:
        what = f"has bodies of no segment that is known: {list_names(unknown, 4)}"
        raise InputError(what, source=path, field="BodySet", remedy="give masses with --segment-mass instead")
    masses = {name: mass for name, mass in masses.items() if mass > 0.0}
    if "pelvis" not in masses:
        raise InputError(
            "has no pelvis with a mass", source=path, field="BodySet", remedy="give the scaled model"
        )
    known: dict[str, MarkerSite] = {}
    for name in MARKER_SETS:
        known = {**read_marker_set(name).sites, **known}
    sites = {}
    for marker in root.iter("Marker"):
        label, segment = marker.get("name", ""), _segment(_carrier(marker))
        if segment is not None:
            site = known.get(label)
            sites[label] = site if site is not None and site.segment == segment else MarkerSite(segment)
    return OpenSimModel(masses, MarkerSet(path.stem, sites))


def _segment(body: str) -> str | None:
    """The segment that a body belongs to; None where that is not known."""
    if body in NAMES:
        return body
    side = _SIDES.get(body[-2:].lower(), "")
    kind = _KINDS.get((body[:-2] if side else body).lower())
    if kind is None:
        return None
    return next((name for name in (kind, f"{side}{kind}") if name in NAMES), None)


def _mass(body: Element, path: Path) -> float:
    try:
        return float(body.findtext("mass") or 0.0)
    except ValueError as error:
        raise InputError(
            "is no number", source=path, field=f"{body.get('name')}/mass", remedy="give kg"
        ) from error


def _carrier(marker: Element) -> str:
    """Name of the body that a marker is fixed to: ``/bodyset/NAME`` of OpenSim 4, ``body`` of OpenSim 3."""
    stated = marker.findtext("socket_parent_frame") or marker.findtext("body") or ""
    return stated.strip().removeprefix("/bodyset/")
