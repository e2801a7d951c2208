"""The licence of a distribution, as its metadata state it, and whether that is a copyleft licence."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.metadata import Distribution

# Sentences by which the text of a licence is known, for distributions whose metadata do not name theirs.
_TEXTS = {
    "MIT License": "MIT",
    "Qhull, Copyright": "Qhull",
    "Neither the name of": "BSD-3-Clause",
}
_UNSTATED = {"", "UNKNOWN", "OSI Approved"}
_WEAK = re.compile(r"\bLGPL|Lesser General Public|\bMPL\b|\bMPL-|Mozilla Public|\bEPL\b|\bEPL-|\bCDDL")
_STRONG = re.compile(r"\bA?GPL|(?<!Lesser )General Public License|Affero")


@dataclass(frozen=True)
class Licence:
    """What a distribution says about its licence.

    Attributes:
        name: of the distribution, normalised.
        version: of the distribution.
        licence: an expression, a name or a classifier; empty where nothing says it.
    """

    name: str
    version: str
    licence: str

    @property
    def copyleft(self) -> str:
        """``strong`` for the GPL and its like, ``weak`` where only changes to the work itself are bound, else empty."""
        if _WEAK.search(self.licence):
            return "weak"
        return "strong" if _STRONG.search(self.licence) else ""


def licence_of(name: str, found: Distribution) -> Licence:
    """Read a distribution's licence: expression, else the named field, else classifiers, else the text shipped."""
    metadata = found.metadata
    classifiers = (line.split(" :: ") for line in metadata.get_all("Classifier") or [])
    classified = sorted({words[-1] for words in classifiers if words[0] == "License"} - _UNSTATED)
    field = (metadata.get("License") or "").strip()
    # Some put the whole text into the field, which the classifiers then name.
    short = "" if "\n" in field else field
    for said in (metadata.get("License-Expression") or "", short, " AND ".join(classified)):
        if said not in _UNSTATED:
            return Licence(name, found.version, said)
    return Licence(name, found.version, _known_text(field) or _shipped(found))


def _shipped(found: Distribution) -> str:
    """The licence whose text lies in the distribution, empty where there is none that is known."""
    for path in found.files or []:
        if path.name.upper().startswith(("LICENSE", "LICENCE", "COPYING")):
            licence = _known_text(path.read_text(encoding="utf-8"))
            if licence:
                return licence
    return ""


def _known_text(text: str) -> str:
    return next((licence for sentence, licence in _TEXTS.items() if sentence in text), "")
