"""Which marker sits where: marker sets and the mapping files that describe others."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from excite.errors import InputError, UnknownNameError
from excite.finding import list_names
from excite.human.markers.landmarks import LANDMARKS, landmark_segment
from excite.human.segments import NAMES
from excite.reading.yaml_document import read_yaml

SCHEMA = "excite.markers/1"
_FEWEST = 10
_SHARE = 0.5


@dataclass(frozen=True)
class MarkerSite:
    """Where a marker sits.

    Attributes:
        segment: segment that carries it.
        landmark: bony landmark under it, None for a marker whose place only calibration finds.
    """

    segment: str
    landmark: str | None = None


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Markers by label.

    Attributes:
        name: of the set.
        sites: by label.
    """

    name: str
    sites: Mapping[str, MarkerSite]


def _both_sides(pairs: Mapping[str, str], right: str = "R", left: str = "L") -> dict[str, str]:
    """Landmarks (without side) by label's ending, for both sides."""
    return {
        f"{letter}{ending}": f"{side}_{name}"
        for letter, side in ((right, "right"), (left, "left"))
        for ending, name in pairs.items()
    }


def _from_landmarks(name: str, landmarks: Mapping[str, str], technical: Mapping[str, str]) -> MarkerSet:
    sites = {label: MarkerSite(landmark_segment(mark), mark) for label, mark in landmarks.items()}
    return MarkerSet(name, sites | {label: MarkerSite(segment) for label, segment in technical.items()})


# The 35 markers of Jovic et al., T-RO 2016, section V.
_JOVIC = _from_landmarks(
    "jovic",
    {
        "TOP": "parietal",
        "C7": "c7",
        "T10": "t10",
        "STRN": "suprasternale",
        "XIPH": "xiphoid",
        "SACR": "sacrum",
        "RSCAP": "right_scapula",
        **_both_sides(
            {
                "HEAD": "temple",
                "SHO": "acromion",
                "ELBL": "lateral_elbow",
                "ELBM": "medial_elbow",
                "WRT": "radial_wrist",
                "WRP": "ulnar_wrist",
                "HND": "second_metacarpal",
                "ASIS": "asis",
                "TROC": "greater_trochanter",
                "KNEL": "lateral_knee",
                "ANKL": "lateral_ankle",
                "HEEL": "heel",
                "MT1": "first_metatarsal",
                "MT5": "fifth_metatarsal",
            }
        ),
    },
    {},
)
_RAJAGOPAL = _from_landmarks(
    "rajagopal",
    {
        "C7": "c7",
        "CLAV": "suprasternale",
        **_both_sides(
            {
                "ACR": "acromion",
                "ASI": "asis",
                "PSI": "psis",
                "LEL": "lateral_elbow",
                "MEL": "medial_elbow",
                "FAradius": "radial_wrist",
                "FAulna": "ulnar_wrist",
                "LFC": "lateral_knee",
                "MFC": "medial_knee",
                "LMAL": "lateral_ankle",
                "MMAL": "medial_ankle",
                "CAL": "heel",
                "TOE": "toe",
                "MT5": "fifth_metatarsal",
            }
        ),
    },
    {
        f"{letter}{label}": f"{side}_{segment}"
        for letter, side in (("R", "right"), ("L", "left"))
        for label, segment in {
            **{f"UA{i}": "upper_arm" for i in (1, 2, 3)},
            **{f"TH{i}": "thigh" for i in (1, 2, 3, 4)},
            **{f"TB{i}": "shank" for i in (1, 2, 3)},
            "FAsuperior": "forearm",
        }.items()
    },
)
_PLUG_IN_GAIT = _from_landmarks(
    "plug_in_gait",
    {
        "C7": "c7",
        "T10": "t10",
        "CLAV": "suprasternale",
        "STRN": "xiphoid",
        "RBAK": "right_scapula",
        **_both_sides(
            {
                "FHD": "temple",
                "BHD": "back_of_head",
                "SHO": "acromion",
                "ELB": "lateral_elbow",
                "WRA": "radial_wrist",
                "WRB": "ulnar_wrist",
                "FIN": "second_metacarpal",
                "ASI": "asis",
                "PSI": "psis",
                "KNE": "lateral_knee",
                "ANK": "lateral_ankle",
                "HEE": "heel",
                "TOE": "second_metatarsal",
            }
        ),
    },
    {
        f"{letter}{label}": f"{side}_{segment}"
        for letter, side in (("R", "right"), ("L", "left"))
        for label, segment in {"UPA": "upper_arm", "FRM": "forearm", "THI": "thigh", "TIB": "shank"}.items()
    },
)
MARKER_SETS: tuple[MarkerSet, ...] = (_JOVIC, _PLUG_IN_GAIT, _RAJAGOPAL)


def bare_label(label: str) -> str:
    """A label without the subject's name that capture programs put before a colon."""
    return label.rsplit(":", 1)[-1].strip()


def find_marker_set(labels: Iterable[str]) -> MarkerSet:
    """The set that most labels of a file belong to.

    Raises:
        InputError: no set has half of its markers in the file; a mapping file is needed.
    """
    present = {bare_label(label) for label in labels}
    best = max(MARKER_SETS, key=lambda item: len(present & item.sites.keys()))
    found = len(present & best.sites.keys())
    if found < max(_FEWEST, _SHARE * min(len(best.sites), len(present))):
        raise InputError(
            f"labels fit no known marker set ({best.name} has {found} of them): {list_names(sorted(present), 4)}",
            field="markers",
            remedy="give a mapping file with --markers: schema: excite.markers/1, markers:, and a line a label, "
            "{landmark: right_acromion} or {segment: right_thigh} behind it",
        )
    return best


def read_marker_set(name_or_path: str | Path) -> MarkerSet:
    """A marker set by name, or from a mapping file.

    The file is YAML: ``schema: excite.markers/1``, ``markers:`` and below it one line a label,
    ``RASI: {landmark: right_asis}`` or ``RTH1: {segment: right_thigh}``.

    Raises:
        InputError: the file is missing or malformed, or names no segment or landmark.
    """
    for known in MARKER_SETS:
        if known.name == str(name_or_path):
            return known
    # Not Path.is_file, which raises for names that no file can have.
    if not os.path.isfile(name_or_path):
        names = [known.name for known in MARKER_SETS]
        raise UnknownNameError("marker set (or mapping file)", str(name_or_path)[:200], names)
    path = Path(name_or_path)
    content = read_yaml(path)
    if content.get("schema") != SCHEMA:
        raise InputError(
            "is no mapping file", source=path, field="schema", remedy=f"begin with schema: {SCHEMA}"
        )
    entries = content.get("markers")
    if not isinstance(entries, dict) or not entries:
        raise InputError(
            "lists no markers", source=path, field="markers", remedy="map label to landmark or segment"
        )
    return MarkerSet(
        path.stem, {str(label): _read_site(entry, str(label), path) for label, entry in entries.items()}
    )


def _read_site(entry: object, label: str, path: Path) -> MarkerSite:
    field = f"markers.{label}"
    if not isinstance(entry, dict) or not entry.keys() <= {"segment", "landmark"} or not entry:
        raise InputError(
            f"is {str(entry)[:60]!r}", source=path, field=field, remedy="write {landmark: …} or {segment: …}"
        )
    landmark, segment = entry.get("landmark"), entry.get("segment")
    if landmark is not None and str(landmark) not in LANDMARKS:
        raise InputError(
            f"no landmark {str(landmark)[:60]!r}",
            source=path,
            field=field,
            remedy="choose one of " + ", ".join(LANDMARKS),
        )
    segment = landmark_segment(str(landmark)) if segment is None else str(segment)
    if segment not in NAMES:
        raise InputError(
            f"no segment {segment[:60]!r}",
            source=path,
            field=field,
            remedy="choose one of " + ", ".join(NAMES),
        )
    return MarkerSite(segment, None if landmark is None else str(landmark))
