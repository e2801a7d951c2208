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
from excite.identification.inertia import NAMES
from excite.identification.physical.bounds_file import SCHEMA as BOUNDS_SCHEMA
from excite.identification.result import Identification
from excite.logs.log import LogHeader
from excite.motion.files import MotionDocument
from excite.robot.description import RobotDescription
from excite.safety.verdict import CheckReport

_MODELS: dict[str, type[BaseModel]] = {
    "log": LogHeader,
    "robot": RobotDescription,
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
_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_names() -> list[str]:
    """Names that :func:`file_schema` knows: of files written by hand, of each result, and ``results``."""
    return sorted([*_MODELS, "bounds", "results", *(_short_name(name) for name in DOCUMENTS)])


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
    elif name == "bounds":
        found = _bounds_schema()
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
    return {"$schema": _DIALECT, **found}


def _short_name(schema: str) -> str:
    """``plan`` of ``excite.plan/1``."""
    return schema.removeprefix("excite.").partition("/")[0]


def _bounds_schema() -> dict[str, Any]:
    """Of ``bounds.yaml``, whose reader names links and drives of the robot at hand."""
    pair = {"type": "array", "items": {"type": ["number", "string"]}, "minItems": 2, "maxItems": 2}
    positive = {"type": ["number", "string", "null"]}
    return {
        "title": "bounds",
        "description": "What is known of a robot's physical parameters, each [lower, upper] in SI.",
        "type": "object",
        "required": ["schema"],
        "additionalProperties": False,
        "properties": {
            "schema": {"const": BOUNDS_SCHEMA},
            "source": {"type": "string", "description": "where the numbers come from"},
            "total_mass": {**pair, "description": "mass of all links together [kg]"},
            "rules": {
                "type": "object",
                "description": "rules between the moments of inertia of a link",
                "additionalProperties": False,
                "properties": {
                    **dict.fromkeys(("diagonal_ratio", "off_diagonal_share", "slenderness"), positive),
                    "slender": {"type": "object", "additionalProperties": {"enum": ["x", "y", "z"]}},
                    "principal_triangle": {"type": "boolean"},
                },
            },
            "links": {
                "type": "object",
                "description": "by link: mass, centre of mass, inertias about it along the joint frame's axes",
                "additionalProperties": {
                    "type": "object",
                    "additionalProperties": False,
                    "properties": dict.fromkeys(NAMES, pair),
                },
            },
            "drives": {"type": "object", "description": "by TERM.JOINT", "additionalProperties": pair},
            "parameters": {
                "type": "object",
                "description": "the same in one level, by LINK.NAME",
                "additionalProperties": {"anyOf": [pair, {"type": "object"}]},
            },
        },
    }
