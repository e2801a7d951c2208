"""The page of Python: every public name, each with an example; and what ``help`` says of every verb is complete."""

from __future__ import annotations

import importlib
import inspect
import re
import subprocess
import sys
from operator import attrgetter

import pytest

import excite
from excite.api import SPACES
from tests.manual.pages import DOCS

PAGE = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
NAMES = [
    *(name for name in excite.__all__ if name not in (*SPACES, "__version__")),
    *(f"{space}.{name}" for space, names in SPACES.items() for name in names),
]
SECTIONS = {text.split("\n", 1)[0]: text for text in re.split(r"^### ", PAGE, flags=re.MULTILINE)[1:]}
VERBS = [name for name in NAMES if inspect.isfunction(attrgetter(name)(excite))]


def test_every_public_name_has_a_section_and_no_other() -> None:
    assert sorted(SECTIONS) == sorted(NAMES)


def test_the_face_is_small_and_groups_hold_the_rest() -> None:
    assert len(excite.__all__) <= 40 and dir(excite) == sorted(excite.__all__)
    for space, names in SPACES.items():
        module = importlib.import_module(f"excite.{space}")
        assert getattr(excite, space) is module
        assert module.__all__ == list(names) and dir(module) == sorted(names)
        # Reached without the group too, and the same thing.
        assert all(getattr(excite, name) is getattr(module, name) for name in names)
        with pytest.raises(AttributeError, match=rf"excite\.{space}.*no_such_name"):
            module.no_such_name
    with pytest.raises(AttributeError, match="no_such_name"):
        excite.no_such_name


def test_groups_cost_nothing_until_they_are_used() -> None:
    code = f"import sys, excite; [getattr(excite, name) for name in {list(SPACES)}]; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.mark.parametrize("name", SECTIONS)
def test_a_section_shows_the_docstring_and_uses_the_name(name: str) -> None:
    kind = "autoclass" if inspect.isclass(attrgetter(name)(excite)) else "autofunction"
    assert f".. {kind}:: excite.{name}\n" in SECTIONS[name]
    (example,) = re.findall(r"^```py(?:thon)?\n(.*?)^```$", SECTIONS[name], flags=re.DOTALL | re.MULTILINE)
    assert re.search(rf"excite\.{re.escape(name)}\b", example) or name in ("Finding",)


def test_all_but_a_few_examples_are_run() -> None:
    """What is not run needs a recording that cannot be made here, or too long."""
    left = {name for name, text in SECTIONS.items() if "```py\n" in text}
    assert left == {"demo", "NoSolutionError"}


@pytest.mark.parametrize("name", VERBS)
def test_help_names_every_argument_and_what_is_returned(name: str) -> None:
    verb = attrgetter(name)(excite)
    said = inspect.getdoc(verb) or ""
    signature = inspect.signature(verb)
    for parameter in signature.parameters:
        assert re.search(rf"^    \*{{0,2}}{parameter}: \S", said, flags=re.MULTILINE), parameter
    if signature.parameters and signature.return_annotation != "None":
        assert "\nReturns:\n" in said
