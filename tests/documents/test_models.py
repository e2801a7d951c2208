"""The models accept what is written, and every field of them says what it is."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest
from pydantic import BaseModel

from excite.campaign.assessment import check, rank
from excite.campaign.experiment import simulate
from excite.campaign.schemas import DOCUMENTS
from excite.documents.document import read_document
from excite.errors import InputError
from excite.motion.collection import load_motions
from excite.results import write_json
from excite.robot.loading import load_robot
from tests.documents.small import SMALL
from tests.report.diagnosed import ambiguous, two_joints_diagnosed, unknown
from tests.report.sample import sample_folder


def read(path: Path) -> dict:
    """The document as its model understands it."""
    return read_document(path, DOCUMENTS[json.loads(path.read_text())["schema"]]).stated()


def kept(stated: object, written: object) -> bool:
    """Whether everything that a model keeps stands like that in the file."""
    if isinstance(stated, dict):
        return all(kept(value, written[key]) for key, value in stated.items())
    if isinstance(stated, list):
        return all(kept(a, b) for a, b in zip(stated, written, strict=True))
    return stated == written


@pytest.mark.parametrize("name", SMALL)
def test_promised_fields_are_enough(name: str, tmp_path: Path) -> None:
    path = write_json(SMALL[name], tmp_path / f"{name}.json")
    assert read(path) == SMALL[name]


@pytest.mark.parametrize("name", SMALL)
def test_fields_may_be_added(name: str, tmp_path: Path) -> None:
    path = write_json({**SMALL[name], "later": {"x": [1]}}, tmp_path / f"{name}.json")
    assert read(path) == SMALL[name]


def test_what_commands_write_is_accepted(tmp_path: Path) -> None:
    robot = load_robot("panda")
    motions = load_motions("panda")[:2]
    experiment = simulate(robot, motions, seed=1)
    experiment.save(tmp_path)
    diagnosis = two_joints_diagnosed()
    for name, document in {
        "simulation": experiment.to_json(),
        "check": check(robot, motions).to_json(),
        "rank": rank(robot, motions).to_json(),
        "export": {"schema": "excite.export/1", "format": "csv", "files": ["one.csv"]},
        "diagnosis": diagnosis.to_json(),
        "ambiguous": ambiguous(diagnosis).to_json(),
        "unknown": unknown(diagnosis).to_json(),
    }.items():
        write_json(document, tmp_path / f"{name}.json")
    sample_folder(tmp_path / "sample", robot, n_motions=2)
    read_back = sorted(tmp_path.rglob("*.json"))
    assert len(read_back) == 12
    for path in read_back:
        assert kept(read(path), json.loads(path.read_text())), path


def test_every_field_says_what_it_is() -> None:
    seen: set[type[BaseModel]] = set()
    for model in DOCUMENTS.values():
        schema = model.model_json_schema(by_alias=True)
        blocks = [schema, *schema.get("$defs", {}).values()]
        for block in blocks:
            assert block["description"]
            for name, entry in block.get("properties", {}).items():
                assert entry.get("description"), (model, name)
        seen.add(model)
    assert len(seen) == len(DOCUMENTS)


def test_a_document_of_another_kind_is_named(tmp_path: Path) -> None:
    path = write_json(SMALL["check"], tmp_path / "plan.json")
    with pytest.raises(InputError) as caught:
        read_document(path, DOCUMENTS["excite.plan/1"])
    assert caught.value.field == "schema" and caught.value.source == path
    assert "excite.check/1" in caught.value.what


def test_the_manual_lists_every_field(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs" / "_ext"))
    page = importlib.import_module("field_pages").fields_page()
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    for schema, model in DOCUMENTS.items():
        assert f"\n## {schema}\n" in page
        content = model.model_json_schema(by_alias=True)
        for block in (content, *content.get("$defs", {}).values()):
            for name, entry in block.get("properties", {}).items():
                meaning = entry["description"].replace("|", "\\|")
                assert any(f"`{name}`" in row and meaning in row for row in rows), (schema, name)
