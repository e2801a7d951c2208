"""Every Python and bash block of the manual runs, page by page, from an empty folder."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from excite.cli.main import app
from excite.conversion.sources.registry import SOURCES
from excite.diagnosis.effects.registry import EFFECTS
from excite.export.registry import EXPORTERS
from excite.safety.check import CHECKS
from tests.manual.pages import DOCS, ROOT, SKILLS, blocks_of, pages, run_page

PAGES = {page.relative_to(ROOT).as_posix(): page for page in pages()}


@pytest.fixture
def own_members(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a page registers is gone after it."""
    for registry in (EXPORTERS, SOURCES):
        monkeypatch.setattr(registry, "_members", registry._members)
    tables: tuple[dict, ...] = (EFFECTS, CHECKS)
    before = [dict(table) for table in tables]
    yield
    for table, members in zip(tables, before, strict=True):
        table.clear()
        table.update(members)


@pytest.mark.slow
@pytest.mark.usefixtures("reader_here")
@pytest.mark.parametrize("name", PAGES)
def test_the_blocks_of_a_page_run(name: str, tmp_path: Path, own_members: None) -> None:
    run_page(PAGES[name], tmp_path)


def test_every_tutorial_and_guide_has_something_to_run() -> None:
    written = {
        path.relative_to(ROOT).as_posix()
        for kind in ("tutorials", "howto")
        for path in (DOCS / kind).glob("*.md")
    }
    # Guides that answer a question in words.
    assert written - set(PAGES) <= {"docs/howto/index.md"}


def test_no_block_is_left_out_for_its_language() -> None:
    """Fences are those that are run, or say that they are none of it."""
    known = {"python", "py", "bash", "console", "text", "yaml", "{toctree}", "{glossary}", "{eval-rst}"}
    for page in DOCS.rglob("*.md"):
        if "generated" in page.parts:
            continue
        for fence in re.findall(r"^```(\S+)", page.read_text(encoding="utf-8"), flags=re.MULTILINE):
            assert fence in known, (page, fence)
    assert all(blocks_of(page) for page in PAGES.values())


QUESTIONS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (DOCS / "questions.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("|")
][2:]


@pytest.mark.parametrize("row", QUESTIONS, ids=lambda row: row[0])
def test_a_question_leads_to_a_guide_that_runs_its_command(row: list[str]) -> None:
    _, command, guide = row
    page = PAGES["docs/" + re.search(r"\((\S+)\)", guide)[1]]
    assert command.strip("`") in "".join(block.text for block in blocks_of(page))


def test_an_assistant_finds_every_skill_by_its_name() -> None:
    listed = re.findall(r"^- \[(\S+)\]\((\S+)\)", (ROOT / "AGENTS.md").read_text(), flags=re.MULTILINE)
    skills = {page.parent.name: page.relative_to(ROOT).as_posix() for page in SKILLS.glob("*/SKILL.md")}
    assert dict(listed) == skills
    for name, page in skills.items():
        assert re.match(rf"---\nname: {name}\ndescription: \S.+\n---\n", (ROOT / page).read_text())
        assert page in PAGES


def test_there_are_twelve_questions() -> None:
    assert len({question for question, _, _ in QUESTIONS}) == len(QUESTIONS) == 12


SHOWN = sorted(
    {
        line
        for page in DOCS.rglob("*.md")
        if "generated" not in page.parts
        for line in re.findall(
            r"^(?:\$|   ) (excite [^#\n…]*[^#\s…])$", page.read_text(encoding="utf-8"), flags=re.MULTILINE
        )
    }
)


COMMANDS = typer.main.get_command(app).commands


@pytest.mark.parametrize("line", SHOWN)
def test_a_command_that_is_only_shown_is_accepted(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name, *arguments = shlex.split(line)[1:]
    command = COMMANDS[name]
    command.make_context(name, arguments).close()
