"""Playground: the live page of a folder as files for any web host. Python itself, from Pyodide, runs it in the reader's browser.

`index.html` is the page as built here, `worker.js` what answers it, `packages.zip` our code, the pure packages that it needs, and the models. The
publisher adds `pyodide/`, with numpy and scipy: these are not ours to hand on.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from ....files import replacing, write_text
from ....language_service.text_answers import TextAnswers
from ..shell import HERE, page_text
from .answers import answered, looked_up
from .files import models_in, path_of
from .request import RequestRefused
from .session import Session

OURS, PURE = ("bondgraph", "compiler"), ("lark", "networkx")
LEFT_OUT = frozenset({"__pycache__", "tests", "manual", "vscode", "tree_sitter"})  # folders that no run needs
CORE = ("pyodide.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
COMPILED = ("numpy", "scipy")


def write_playground(folder: Path, out: Path) -> list[str]:
    """Write the playground of the models of a folder; return the files that `out` still lacks. Raises OSError."""
    session = Session(folder, None, TextAnswers())
    session.load()
    out.mkdir(exist_ok=True)
    with replacing(out / "packages.zip") as stream, ZipFile(stream, "w", ZIP_DEFLATED) as archive:
        for name, path in sorted(_packed(folder)):
            # without its time: equal files, equal bytes
            archive.writestr(ZipInfo(name), path.read_bytes(), ZIP_DEFLATED)
    shutil.copyfile(HERE / "scripts" / "worker.js", out / "worker.js")
    write_text(out / "index.html", page_text(session.page(), "worker"))
    return missing(out / "pyodide")


def _packed(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield names in the archive, and files: packages, licences of those of others, models, and tables that they may read."""
    for package in (*OURS, *PURE):
        spec = find_spec(package)
        (place,) = (spec.submodule_search_locations if spec is not None else None) or ("",)
        for path in Path(place).rglob("*"):
            name = path.relative_to(Path(place).parent)
            if path.is_file() and not LEFT_OUT & {*name.parts}:
                yield name.as_posix(), path
    for package in PURE:
        for file in distribution(package).files or ():
            if "dist-info" in str(file.parent) and file.name.startswith(("LICENSE", "METADATA")):
                yield file.as_posix(), Path(str(file.locate()))
    for model in (*models_in(folder), *(p.relative_to(folder).as_posix() for p in folder.rglob("[!.]*.csv"))):
        yield f"models/{model}", folder / model


def missing(place: Path) -> list[str]:
    """Return the files of Pyodide that a folder lacks: its core, and the packages with machine code and what its list says they need."""
    lacking = [name for name in CORE if not (place / name).is_file()]
    if not list(place.glob("pyodide.asm.*js")):
        lacking.append("pyodide.asm.mjs (pyodide.asm.js before 314)")
    wanted = list(COMPILED)
    try:
        packages = json.loads((place / "pyodide-lock.json").read_text(encoding="utf-8"))["packages"]
        for name in wanted:  # grows meanwhile
            wanted += [n for n in packages[name]["depends"] if n not in wanted]
        files = [packages[name]["file_name"] for name in wanted]
    except (OSError, ValueError, LookupError, TypeError):  # there is no list, or it is cut off, or another
        return [*dict.fromkeys([*lacking, "pyodide-lock.json"]), *(f"{name}-….whl" for name in COMPILED)]
    return lacking + [f for f in files if not (place / f).is_file()]


def answers_of(folder: str, saved: Mapping[str, str], shown: str) -> Callable[[str, str | None], tuple[int, str]]:
    """Return what answers a page from its worker: HTTP status and text by path and body. `saved`: files that this reader has saved; `shown`: the first."""
    place = Path(folder)
    for name, text in saved.items():
        if (place / name).parent.is_dir():
            write_text(place / name, text)
    session = Session(place, None, TextAnswers())
    if saved or shown != session.name:
        session.version = 1  # the page was built from other texts: it gets these
    session.path = path_of(place, shown) if shown in session.names else session.path
    session.load()

    def answer(path: str, body: str | None) -> tuple[int, str]:
        path, _, query = path.partition("?")
        try:
            if body is not None:
                return answered(session, path, body.encode("utf-8"))
            return looked_up(session, path, {"since": [query.removeprefix("since=")]}, 0.0)
        except RequestRefused as refused:
            return refused.status, str(refused)

    return answer
