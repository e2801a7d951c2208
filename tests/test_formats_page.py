"""Examples of the page of files keep to the schemas that are printed, and name every field."""

from __future__ import annotations

import re
from pathlib import Path

import jsonschema
import pytest
import yaml

import excite
from excite.campaign.schemas import schema_names
from excite.errors import UnknownNameError

PAGE = (Path(__file__).parents[1] / "docs" / "formats.md").read_text()
EXAMPLES = {
    name: yaml.safe_load(text) for name, text in re.findall(r"```yaml (\w+)\n(.*?)```", PAGE, re.DOTALL)
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_keeps_to_its_schema(name):
    jsonschema.Draft202012Validator(excite.file_schema(name)).validate(EXAMPLES[name])


@pytest.mark.parametrize("name", ["log", "robot", "bounds", "map"])
def test_an_example_has_every_field(name):
    assert set(EXAMPLES[name]) == set(excite.file_schema(name)["properties"])


@pytest.mark.parametrize("name", ["log", "robot", "bounds", "map"])
def test_a_field_that_is_none_is_refused(name):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(excite.file_schema(name)).validate(EXAMPLES[name] | {"colour": "red"})


def test_the_example_of_a_check_has_every_field():
    example, schema = EXAMPLES["check"], excite.file_schema("check")
    assert set(example) == {name for name in schema["properties"] if name != "made"}
    (motion,) = example["motions"]
    (nearest, *_), *_ = motion["nearest"].values()
    for shown, name in (
        (motion, "Verdict"),
        (motion["margins"], "Margins"),
        (nearest, "Nearest"),
        (motion["violations"][0], "Violation"),
    ):
        assert set(shown) == set(schema["$defs"][name]["properties"])
    assert (
        "`helped`" in PAGE and "helped" in excite.file_schema("campaign")["$defs"]["Iteration"]["properties"]
    )


def test_every_result_has_a_schema():
    for name in schema_names():
        jsonschema.Draft202012Validator.check_schema(excite.file_schema(name))
    assert len(excite.file_schema("results")["oneOf"]) >= 10
    with pytest.raises(UnknownNameError, match="log"):
        excite.file_schema("colour")
