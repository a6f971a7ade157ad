"""Parameters and constants that are texts: known before there is a program, which has none."""

from __future__ import annotations

from ...graph.units import ONE
from ...scene import Override
from ...syntax import tree
from ..names.domain_table import is_slot
from ..names.errors import WrongType
from ..names.scope import Pending, Scalar, TextValue
from ..names.statement_errors import Wrong
from .resolver import Resolver

WORD = "text"  # the unit of a parameter that is a text


def is_text(resolver: Resolver, pending: Pending) -> bool:
    """Return True for a quantity that is declared as a text, or whose default is one. Raises `Wrong`."""
    item, default = pending.item, pending.item.value
    if pending.role not in ("parameter", "constant") or item.choices:
        return False
    if isinstance(default, tree.PathSyntax) and pending.owner.find(default.head) is not None:
        return is_slot(item, WORD) or getattr(resolver.lookup(default, pending.owner), "text", None) is not None
    return isinstance(default, tree.TextSyntax) or is_slot(item, WORD)


def text_of(resolver: Resolver, pending: Pending, override: Override | None) -> Scalar:
    """The text that a quantity is given: in quotation marks, or by the name of another one. Raises `Wrong`."""
    item, text = pending.item, None
    value, scope = (pending.value, pending.scope) if override is None else (override.value, resolver.root)
    assert value is not None
    if item.unit is not None and not is_slot(item, WORD):
        raise Wrong(WrongType(item.span, "A number", "a text", "A text has no unit."))
    if isinstance(value, tree.TextSyntax):
        text = TextValue(value.value, scope.definition.file)
    elif isinstance(value, tree.PathSyntax) and (scope.find(value.head) or resolver.file_entry(value.head, scope)):
        text = getattr(resolver.lookup(value, scope), "text", None)
    if text is None:
        span, words = (item.span, f"{value:g}") if isinstance(value, float) else (value.span, value.span.words)
        hint = f'A text stands in quotation marks: `{item.name} = "{words}"`; on the command line `--set \'{pending.name}="{words}"\'`.'
        raise Wrong(WrongType(span, f"A text for `{item.name}`", f"`{words}`", hint))
    return Scalar(0.0, ONE, "parameter", pending.name, text=text)
