"""The documents by the words of their field ``schema``. A new one is one file beside this one and one line here."""

from __future__ import annotations

from excite.documents.blind import BlindAnswer, BlindAnswers
from excite.documents.check import Check
from excite.documents.diagnosis import Diagnosis
from excite.documents.document import Document, schema_of
from excite.documents.identification import Identification
from excite.documents.plan import Plan, Refusals
from excite.documents.results import (
    Campaign,
    Doctor,
    Export,
    Human,
    Journal,
    Model,
    Rank,
    Signals,
    Simulation,
    Truth,
)

_KINDS: tuple[type[Document], ...] = (
    Plan,
    Refusals,
    Check,
    Rank,
    Export,
    Simulation,
    Identification,
    Campaign,
    Diagnosis,
    Doctor,
    Human,
    Model,
    Signals,
    Journal,
    Truth,
    BlindAnswers,
    BlindAnswer,
)

DOCUMENTS: dict[str, type[Document]] = {schema_of(kind): kind for kind in _KINDS}
