"""Examination of a text: the errors of each of its models, and the certificate of the main one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from .compilation import Compilation, too_long
from .errors import CompilationFailed, Diagnostic
from .garbage_collection import uncollected
from .reduction import Certificate
from .scene import Scene
from .semantics import MAXIMUM_PARTS, check_parts
from .semantics.names.compound_units import with_compound_units
from .source import Source
from .syntax import SyntaxTree, parse_what_can_be_read
from .syntax.tree import ModelSyntax, ParameterSet

# Several models to choose from are no mistake of a file of parts.
PART_ONLY = frozenset({"BG132"})


def check(source: Source, model: str | None = None, library: Path | None = None) -> tuple[Diagnostic, ...]:
    """Return all errors of a text: each of its models separately, then the main model up to its equations."""
    return examine(source, model, library)[0]


def examine(
    source: Source, model: str | None = None, library: Path | None = None, most_parts: int = MAXIMUM_PARTS
) -> tuple[tuple[Diagnostic, ...], Certificate | None]:
    """Return the errors of a text; if there are none, also the certificate of the main model, if there is one."""
    with uncollected():
        return _examine(source, model, library, most_parts)


def _examine(
    source: Source, model: str | None, library: Path | None, most_parts: int
) -> tuple[tuple[Diagnostic, ...], Certificate | None]:
    certificate: Certificate | None = None
    tree, mistakes = parse_what_can_be_read(source)
    tree = None if tree is None else with_compound_units(tree)
    broken = frozenset[str]() if tree is None else models_with(mistakes, tree)
    if tree is None or (mistakes and not broken):
        return CompilationFailed(mistakes).diagnostics, None
    try:
        parts = check_parts(tree, library, model, broken, most_parts)
    except CompilationFailed as failed:  # a limit was passed
        return CompilationFailed([*mistakes, *failed.diagnostics]).diagnostics, None
    except RecursionError:
        return (too_long(tree),), None
    found = [*mistakes, *parts.diagnostics]
    if not found:
        compilation = Compilation(source, Scene(model, None), library, most_parts=most_parts)
        compilation.__dict__["tree"] = tree
        if parts.built is not None:
            compilation.__dict__["_built"] = parts.built
        found, certificate = look_at_equations(compilation)
    return (CompilationFailed(found).diagnostics, None) if found else ((), certificate)


def look_at_equations(compilation: Compilation) -> tuple[list[Diagnostic], Certificate | None]:
    """Return the errors that only the equations of the main model show, and its certificate; neither for a file of parts."""
    tree = compilation.tree
    try:
        if compilation.open_part is not None:
            return [], None
        compilation.look_at_laws()
        return [], compilation.certificate
    except CompilationFailed as failed:
        has_parts = any(isinstance(s, ModelSyntax | ParameterSet) for s in tree.statements)
        parts_only = compilation.scene.model is None and has_parts
        return [d for d in failed.diagnostics if not parts_only or d.code not in PART_ONLY], None
    except RecursionError:
        return [too_long(tree)], None


_NO_BRACES = re.compile(r'"[^"\n]*"|#[^\n]*')  # texts and comments: braces in them open nothing


def models_with(mistakes: Sequence[Diagnostic], tree: SyntaxTree) -> frozenset[str]:
    """Models with a line that cannot be parsed; none if such a line is outside of all models, where it defines the meaning of names."""
    found = set()
    for place in [d.span.start for d in mistakes]:
        before = [m for m in tree.models.values() if m.span.start <= place]
        if not before:
            return frozenset()
        home = max(before, key=lambda m: m.span.start)
        text = _NO_BRACES.sub("", tree.source.text[home.span.start : place])
        if text.count("{") <= text.count("}"):
            return frozenset()
        found.add(home.name)
    return frozenset(found)
