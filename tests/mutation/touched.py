"""A pytest plugin that notes which functions each test enters: ``pytest -p tests.mutation.touched --touched FILE``.

What a fixture enters counts for every test that uses the fixture, also where its value was made for an earlier one.
"""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType

import pytest

# By file and first line, decorators included, as the interpreter counts it.
Function = tuple[str, int]


class Touched:
    """Collects functions of ``excite`` by test and by fixture."""

    def __init__(self, root: Path, out: Path):
        self.root, self.out = str(root / "excite"), out
        self.by_fixture: dict[tuple[str, str], set[Function]] = defaultdict(set)
        self.by_test: dict[str, set[Function]] = defaultdict(set)
        self.seconds: dict[str, float] = defaultdict(float)
        self._entered: list[set[CodeType]] = []

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(self.root):
            for entered in self._entered:
                entered.add(frame.f_code)

    @contextmanager
    def watching(self, functions: set[Function]) -> Iterator[None]:
        """Add to ``functions`` what is entered within."""
        before, entered = sys.getprofile(), set[CodeType]()
        self._entered.append(entered)
        sys.setprofile(self)
        try:
            yield
        finally:
            sys.setprofile(before)
            self._entered.pop()
            for code in entered:
                path = "excite" + code.co_filename.removeprefix(self.root)
                functions.add((path, code.co_firstlineno))

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef):
        with self.watching(self.by_fixture[fixturedef.argname, fixturedef.baseid]):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item):
        start = time.perf_counter()
        with self.watching(self.by_test[item.nodeid]):
            result = yield
        self.seconds[item.nodeid] = time.perf_counter() - start
        definitions = item._fixtureinfo.name2fixturedefs
        for definition in (one for several in definitions.values() for one in several):
            self.by_test[item.nodeid] |= self.by_fixture[definition.argname, definition.baseid]
        return result

    def pytest_sessionfinish(self) -> None:
        found = {
            test: {"seconds": self.seconds[test], "functions": sorted(functions)}
            for test, functions in self.by_test.items()
        }
        self.out.write_text(json.dumps(found), encoding="utf-8")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--touched", type=Path, required=True, help="file to write")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Touched(config.rootpath, config.getoption("--touched")))
