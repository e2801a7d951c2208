"""The package as a house: rooms in the order of CONTRIBUTING.md, no circles, reasons for late imports, sizes."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter

import pytest

from tests.architecture.source_tree import PACKAGE, ROOT, circles, loaded_by, module_edges, modules

MOST_FILES = 20
MOST_LINES = 800


def order() -> dict[str, str]:
    """The rooms with what each is for, leftmost first: the block in CONTRIBUTING.md."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    block = text.partition("The rooms, ")[2].partition("```\n")[2].partition("```")[0]
    return dict(re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in block.splitlines())


def is_room(name: str) -> bool:
    return (ROOT / PACKAGE / name).is_dir()


def test_the_list_names_every_room_once_and_says_what_it_is_for():
    rooms = {module.room for module in modules().values() if is_room(module.room) and module.name != PACKAGE}
    assert set(order()) == rooms
    assert all(len(use.split()) >= 3 for use in order().values())


def test_no_room_imports_from_a_room_on_its_right():
    place = {room: index for index, room in enumerate(order())}
    found = []
    for name, others in module_edges().items():
        here = modules()[name]
        # The package's face loads verbs by name; ``python -m excite`` is the command line.
        if name in (PACKAGE, f"{PACKAGE}.__main__"):
            continue
        for other in others:
            there = modules()[other]
            # Modules beside the rooms stand left of them all.
            if place.get(there.room, -1) > place.get(here.room, -1):
                found.append(f"{name} imports {other}")
    assert found == []


def test_no_circle_between_modules_not_even_for_types():
    assert circles(module_edges()) == []


def test_diagnosis_of_each_kind_does_not_reach_back_to_the_door_that_chooses_it():
    door = f"{PACKAGE}.diagnosis.diagnose"
    assert [name for name, others in module_edges().items() if door in others] == []


def test_an_import_within_a_function_names_the_heavy_library_that_it_loads():
    """``# lazy: LIBRARY``: the import loads it, and the module that holds the function does not do so anyway."""
    found = []
    for name, module in modules().items():
        for item in module.imports:
            if not item.inside or item.by_name or item.module not in modules():
                continue
            reason = re.match(r"lazy: (\w+)", item.comment)
            at = f"{name}:{item.line} {item.module}"
            if reason is None:
                found.append(f"{at} gives no reason")
            elif reason[1] in sys.stdlib_module_names or reason[1] not in loaded_by(item.module):
                found.append(f"{at} does not load {reason[1]}")
            elif reason[1] in loaded_by(name):
                found.append(f"{at}: {name} loads {reason[1]} anyway")
    assert found == []


def test_no_room_or_folder_in_it_holds_more_files_than_one_can_take_in():
    files = Counter(
        m.path.parent.relative_to(ROOT) for m in modules().values() if m.path.name != "__init__.py"
    )
    assert {str(folder): n for folder, n in files.items() if n > MOST_FILES} == {}


def test_no_module_is_longer_than_one_reads_at_a_sitting():
    assert {m.name: m.n_lines for m in modules().values() if m.n_lines > MOST_LINES} == {}


def test_every_file_says_what_it_is_for():
    assert [m.name for m in modules().values() if len((m.docstring or "").split()) < 4] == []


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("excite.logs.signals.butterworth", ("pinocchio", "mujoco", "matplotlib", "pydantic")),
        ("excite.arrays", ("pinocchio", "scipy")),
        ("excite.cli.main", ("pinocchio", "mujoco", "matplotlib", "scipy", "pyarrow")),
    ],
)
def test_importing_what_is_light_loads_nothing_heavy(module, heavy):
    code = f"import sys, {module}; print([m for m in {heavy!r} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_the_checks_see_what_they_are_to_forbid():
    """A circle is found, also through a third module; what a module loads is followed through those it imports."""
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]
    assert circles({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert "numpy" in loaded_by("excite.logs.signals.butterworth")
    late = [i for m in modules().values() for i in m.imports if i.inside and i.module == "mujoco"]
    assert late
    assert any(item.typing for item in modules()["excite.export.registry"].imports)
    registry = modules()["excite.export.registry"]
    assert any(item.by_name and item.module == "excite.export.plain_tables" for item in registry.imports)
