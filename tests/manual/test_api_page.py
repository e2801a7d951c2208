"""The page of Python: every public name, each with an example; and what ``help`` says of every verb is complete."""

from __future__ import annotations

import inspect
import re

import pytest

import excite
from tests.manual.pages import DOCS

PAGE = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
SECTIONS = {text.split("\n", 1)[0]: text for text in re.split(r"^### ", PAGE, flags=re.MULTILINE)[1:]}
VERBS = [name for name in excite.__all__ if inspect.isfunction(getattr(excite, name))]


def test_every_public_name_has_a_section_and_no_other() -> None:
    assert set(SECTIONS) == set(excite.__all__) - {"__version__"}


@pytest.mark.parametrize("name", SECTIONS)
def test_a_section_shows_the_docstring_and_uses_the_name(name: str) -> None:
    kind = "autoclass" if inspect.isclass(getattr(excite, name)) else "autofunction"
    assert f".. {kind}:: excite.{name}\n" in SECTIONS[name]
    (example,) = re.findall(r"^```py(?:thon)?\n(.*?)^```$", SECTIONS[name], flags=re.DOTALL | re.MULTILINE)
    assert re.search(rf"excite\.{name}\b", example) or name in ("Finding",)


def test_all_but_a_few_examples_are_run() -> None:
    """What is not run needs a recording that cannot be made here, or too long."""
    left = {name for name, text in SECTIONS.items() if "```py\n" in text}
    assert left == {
        "import_recordings",
        "identify_person",
        "added_mass",
        "identify_wearing",
        "demo",
        "NoSolutionError",
    }


@pytest.mark.parametrize("name", VERBS)
def test_help_names_every_argument_and_what_is_returned(name: str) -> None:
    verb = getattr(excite, name)
    said = inspect.getdoc(verb) or ""
    signature = inspect.signature(verb)
    for parameter in signature.parameters:
        assert re.search(rf"^    \*{{0,2}}{parameter}: \S", said, flags=re.MULTILINE), parameter
    if signature.parameters and signature.return_annotation != "None":
        assert "\nReturns:\n" in said
