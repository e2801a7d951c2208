"""The documents by the words of their field ``schema``. A new one is one file beside this one and one line here."""

from __future__ import annotations

from excite.documents.blind import BlindAnswers
from excite.documents.blind_answer import BlindAnswer
from excite.documents.campaign import Campaign
from excite.documents.check import Check
from excite.documents.diagnosis import Diagnosis
from excite.documents.doctor import Doctor
from excite.documents.document import Document, schema_of
from excite.documents.export import Export
from excite.documents.human import Human
from excite.documents.identification import Identification
from excite.documents.journal import Journal
from excite.documents.model import Model
from excite.documents.plan import Plan, Refusals
from excite.documents.rank import Rank
from excite.documents.signals import Signals
from excite.documents.simulation import Simulation
from excite.documents.truth import Truth

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
