"""Table of renderers: each entry names a class of the package and a function of the presentation layer that exists."""

from __future__ import annotations

import ast
from importlib import import_module

import pytest

from bondgraph import rendering
from bondgraph.presentation.renderers import RENDERERS
from tests.architecture import structure


@pytest.mark.parametrize("entry", RENDERERS, ids=" ".join)
def test_an_entry_names_a_class_and_a_function(entry: tuple[str, str]) -> None:
    module, _, function = RENDERERS[entry].partition(":")
    assert callable(getattr(import_module(module), function))
    with_renderers = ["bondgraph.rendering"]
    with_renderers += [m for m, other in structure.file_imports().edges if other == "bondgraph.rendering"]
    classes = [n.name for m in with_renderers for n in structure.trees()[m].body if isinstance(n, ast.ClassDef)]
    assert classes.count(entry[0]) == 1


def test_the_table_is_installed_once() -> None:
    with pytest.raises(RuntimeError, match="installed already"):
        rendering.install(RENDERERS)


def test_only_the_facade_and_the_commands_import_the_presentation() -> None:
    above = {
        "bondgraph",
        "bondgraph.model",
        "bondgraph.commands",
        "bondgraph.reproduction",
        "bondgraph.exercises",
        "bondgraph.language_service",
    }
    arrows = structure.room_imports().edges
    assert {
        a for a, b in arrows if b.startswith("bondgraph.presentation") and not a.startswith("bondgraph.presentation")
    } <= above
