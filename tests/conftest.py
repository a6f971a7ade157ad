"""Common parts of all tests: golden files, and the option that renews them."""

from __future__ import annotations

import gc
import os
import tempfile
import zlib
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

# Before numpy comes. Matrices are small here, and runs go side by side: threads of linear algebra that wait for a core that another run has took a
# random graph from 5 s of processor time to 120.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from bondgraph.compiled_scene import chosen_target

# The same examples in every run: what fails here fails everywhere.
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("repeatable")

# What is compiled in the tests is kept for them alone, and thrown away with them.
_KEPT = tempfile.TemporaryDirectory(prefix="bondgraph-tests-")
os.environ.setdefault("BONDGRAPH_CACHE", _KEPT.name)

_FULL: list[int] = []  # full collections when all was last left out of further ones

Golden = Callable[[Path, str], None]


def pytest_configure(config: pytest.Config) -> None:
    # What thousands of tests keep need not be looked through that often, and most of a model is gone before it is looked at.
    gc.set_threshold(500_000, 5, 10)
    config.addinivalue_line(
        "markers", "interpreted: asks for the target numpy itself, so that it is the same where there is no LLVM"
    )
    config.addinivalue_line("markers", "few(number): so many of the test's cases always run, all of them with --long")
    config.addinivalue_line("markers", "machine_code: left out where there is no LLVM, or it is hidden")


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("machine_code") and chosen_target(None) != "native":
        pytest.skip("there is no LLVM, or it is hidden")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out cases of tests with a marker `few`, and of all tests with `--cases`, the same in every run; none with `--long` or where a test is named. What `-k` and `-m` leave out is not counted."""
    if config.getoption("--long") or any("::" in argument for argument in config.args):
        return
    cases, most = defaultdict(list), config.getoption("--cases")
    for item in items:
        cases[item.nodeid.partition("[")[0]].append(item)
    left_out: set[pytest.Item] = set()
    for group in cases.values():
        numbers = [*(marker.args[0] for marker in group[0].iter_markers("few")), *([most] if most else [])]
        group.sort(key=lambda item: zlib.crc32(item.nodeid.encode()))
        left_out.update(group[min(numbers) :] if numbers else ())
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=list(left_out))


# A server leaves all there is out of later collections; here that would keep the garbage of earlier tests.
_freeze_all, gc.freeze = gc.freeze, lambda: None


def pytest_collection_finish() -> None:
    """Leave thousands of tests and the modules they import out of every later collection."""
    gc.collect()
    _freeze_all()
    _FULL[:] = [gc.get_stats()[2]["collections"]]


def pytest_runtest_logfinish() -> None:
    """Leave what earlier tests keep out, too, once a collection has walked through all of it: syntax trees of the whole house are millions of objects."""
    if gc.get_stats()[2]["collections"] > _FULL[0]:
        pytest_collection_finish()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden", action="store_true", help="write the golden files anew instead of comparing with them"
    )
    parser.addoption("--long", action="store_true", help="run all cases of the tests that take long")
    parser.addoption("--cases", type=int, help="run at most so many cases of each test")


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Golden:
    """`golden(file, text)`: the text is what the file says; with --update-golden the file is made to say it."""
    update = bool(request.config.getoption("--update-golden"))

    def compare(file: Path, text: str) -> None:
        text = text.rstrip("\n") + "\n"
        if update:
            file.write_text(text, encoding="utf-8")
        assert file.is_file(), f"{file.name} is missing: run pytest with --update-golden and read what it wrote"
        assert text == file.read_text(encoding="utf-8"), (
            f"{file.name} is out of date: if the new text is right, --update-golden renews it"
        )

    return compare
