"""Document as one file: it contains its style and scripts, and the browser is told to run no others and to load nothing.

Style and scripts are named by their hashes, so that nothing from a model's text could run even if it were not escaped.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from ..diagram.svg import style_rules
from .document import Document
from .markup import Html, tag

HERE = Path(__file__).parent
STYLES = ("page", "text", "diagram", "runs", "live", "print")
SCRIPTS = ("numbers", "plot", "export", "measured", "solids", "mechanism", "diagram", "player", "sliders", "page")
LIVE = ("editor", "suggestions", "live")
# Who answers a page: what its policy allows for that, and further scripts.
ASKED: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "": ("", ()),
    "server": ("; connect-src 'self'", ("server", *LIVE)),
    "worker": ("; worker-src 'self'", ("playground", *LIVE)),
}


def page_text(document: Document, asked: str = "", token: str = "") -> str:
    """Return the text of an HTML file. The page is live if somebody is `asked`: its server, which knows it by a `token`, or a worker beside it."""
    style, script = _style(), _script(asked)
    policy = (
        f"default-src 'none'; style-src {_hashed(style)}; script-src {_hashed(script)}; img-src data:; base-uri 'none'; form-action 'none'"
        + ASKED[asked][0]
    )
    head = [
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("meta", name="referrer", content="no-referrer"),
        *([tag("meta", name="token", content=token)] if token else []),
        tag("title", document.title),
        Html(f"<style>{style}</style>"),
    ]
    player = Html((HERE / "player.html").read_text(encoding="utf-8"))
    body = [
        tag("div", id="problems", role="alert"),
        player,
        tag("main", document.sections, id="page"),
        Html(f'<script type="application/json" id="data">{data_text(document.data)}</script>'),
        Html(f"<script>{script}</script>"),
    ]
    return f"<!DOCTYPE html>\n{tag('html', tag('head', *head), tag('body', *body), lang='en')}\n"


def data_text(data: object) -> str:
    """Return JSON without any character that could end the element that contains it. Values that are not finite are null."""
    told = json.dumps(_finite(data), ensure_ascii=True, separators=(",", ":"), allow_nan=False)
    return told.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _finite(data: object) -> Any:
    if isinstance(data, float):
        return data if abs(data) < float("inf") else None
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    return [_finite(item) for item in data] if isinstance(data, list | tuple) else data


def _hashed(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode('ascii')}'"


@cache
def _style() -> str:
    own = "\n".join((HERE / "styles" / f"{name}.css").read_text(encoding="utf-8") for name in STYLES)
    return f"{style_rules().replace('@media (', '@media screen and (')}\n{own}"  # print.css last


@cache
def _script(asked: str) -> str:
    """Return the scripts one after the other, in a common scope."""
    names = (*SCRIPTS, *ASKED[asked][1])
    parts = "\n".join((HERE / "scripts" / f"{name}.js").read_text(encoding="utf-8") for name in names)
    return f'"use strict";\n(() => {{\n{parts}\nstart();\n}})();\n'
