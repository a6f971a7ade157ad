"""Safe markup by construction: any value that is not `Html` is text, and is escaped."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape as _escape

from ..text.tables import visible

VOID = frozenset({"input", "br", "meta"})


class Html(str):
    """Text that is markup already; only this module makes it."""

    __slots__ = ()


def text(words: str) -> Html:
    """Return markup that shows words: no part of them is a tag, a reference or a character that changes the reading direction."""
    return Html(_escape("\n".join(map(visible, words.split("\n"))), quote=True))


def joined(parts: Iterable[str], between: str = "") -> Html:
    """Return the parts one after the other, each escaped unless it is markup."""
    return Html(text(between).join(p if isinstance(p, Html) else text(p) for p in parts))


def tag(name: str, /, *inside: str, **attributes: str | int | bool | None) -> Html:
    """Return an element. `class_` is `class`, `data_x` is `data-x`; True is an attribute without a value, None and False are omitted."""
    told = "".join(_attribute(key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items())
    if name in VOID:
        return Html(f"<{name}{told}>")
    return Html(f"<{name}{told}>{joined(inside)}</{name}>")


def _attribute(name: str, value: str | int | bool | None) -> str:
    if value is None or value is False:
        return ""
    return f" {name}" if value is True else f' {name}="{text(str(value))}"'


def preformatted(*inside: str) -> Html:
    """Return text in lines as they are, in a frame that scrolls where the page is narrow."""
    return tag("pre", *inside, tabindex=0)


def table(rows: Iterable[Iterable[str]], head: Iterable[str] = (), **attributes: str) -> Html:
    """Return a table in a frame that scrolls where the page is narrow."""
    top = [tag("thead", tag("tr", *(tag("th", h, scope="col") for h in head)))] if head else []
    body = tag("tbody", *(tag("tr", *(tag("td", cell) for cell in row)) for row in rows))
    return tag("div", tag("table", *top, body, **attributes), class_="wide", tabindex=0)
