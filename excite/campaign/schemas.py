"""JSON schemas of the files that people write and read, generated from the models that check them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from excite.campaign.assessment import RankReport
from excite.campaign.experiment import Simulation, Truth
from excite.campaign.journal import BegunCampaign
from excite.conversion.explicit_mapping import Map
from excite.diagnosis.answer.answer import Diagnosis
from excite.documents.campaign import Campaign
from excite.documents.document import Document, model_of, schema_of
from excite.documents.plan import PlanDocument
from excite.errors import UnknownNameError
from excite.export.export import ExportReport
from excite.export.models.simulator_model import SimulatorModel
from excite.finding import Examination
from excite.human.measure import MeasuredPerson
from excite.identification.physical.bounds_file import BoundsDocument
from excite.identification.result import Identification
from excite.logs.log import LogHeader
from excite.motion.files import MotionDocument
from excite.robot.description import RobotDescription
from excite.safety.verdict import CheckReport

_MODELS: dict[str, type[BaseModel]] = {
    "log": LogHeader,
    "robot": RobotDescription,
    "bounds": BoundsDocument,
    "map": Map,
    "motion": MotionDocument,
}
# Documents of which a class is a model, then results whose own fields are the document's.
_KINDS: tuple[type[Document], ...] = (
    *(
        model_of(result)
        for result in (
            Identification,
            Diagnosis,
            PlanDocument,
            CheckReport,
            Examination,
            RankReport,
            Simulation,
            Truth,
            BegunCampaign,
            Campaign,
            MeasuredPerson,
            ExportReport,
            SimulatorModel,
        )
    ),
)
DOCUMENTS: dict[str, type[Document]] = {schema_of(kind): kind for kind in _KINDS}


def schema_names() -> list[str]:
    """Names that :func:`file_schema` knows: of files written by hand, of each result, and ``results``."""
    return sorted([*_MODELS, "results", *(_short_name(name) for name in DOCUMENTS)])


def file_schema(name: str) -> dict[str, Any]:
    """The JSON schema of a file; ``results`` is that of any result.

    Args:
        name: ``log``, ``robot``, ``bounds``, ``map``, ``motion``, ``results``, or one result's name.

    Returns:
        The schema, ready for JSON.

    Raises:
        UnknownNameError: no such file.
    """
    if name in _MODELS:
        found = _MODELS[name].model_json_schema(by_alias=True)
    elif name == "results":
        found = {
            "title": "results",
            "oneOf": [kind.model_json_schema(by_alias=True) for kind in DOCUMENTS.values()],
        }
    else:
        kinds = {_short_name(full): kind for full, kind in DOCUMENTS.items()}
        if name not in kinds:
            raise UnknownNameError("schema", name, schema_names())
        found = kinds[name].model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def _short_name(schema: str) -> str:
    """``plan`` of ``excite.plan/1``."""
    return schema.removeprefix("excite.").partition("/")[0]
