"""`bondgraph manual`."""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path

import click

MANUAL = Path(__file__).resolve().parents[1] / "manual"
MODELS = MANUAL.parents[1] / "models"
NEEDED = ("sphinx", "myst_parser", "furo", "sphinx_design")


@click.command("manual")
@click.argument("word", metavar="[WORD]", required=False)
@click.option("-o", "--out", metavar="FOLDER", help="Build the pages into this folder, instead of into the cache.")
def command(word: str | None, out: str | None) -> None:
    """Open the manual: the page or section that is called WORD, else a search for it. The first call builds it (a minute)."""
    if word is not None and not word.strip():
        raise click.UsageError("WORD is empty; for example `bondgraph manual tearing`")
    address = address_of(pages(out), word)
    click.echo(address)
    if sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        click.launch(address)


def pages(out: str | None) -> Path:
    """Return the folder of the pages, built if that in the cache is not of this code and these models. Raises `UsageError`, `MissingPackage`."""
    from .. import cache
    from ..errors import UsageError

    if out is not None:
        return build(free_folder(Path(out).absolute(), "searchindex.js"))
    folder = cache.folder_of("manual")
    if folder is None:
        raise UsageError("BR656", "there is no cache folder for the manual:", "name one: `bondgraph manual -o FOLDER`")
    stamp = cache.key_of("manual", *((p.name, p.stat().st_mtime_ns) for p in sorted(MODELS.glob("*.bg"))))
    written = folder / "stamp"
    if not written.is_file() or written.read_text(encoding="ascii") != stamp:
        part = folder.with_name(f".manual.{os.getpid()}.part")
        try:
            (build(part) / "stamp").write_text(stamp, encoding="ascii")
            shutil.rmtree(folder, ignore_errors=True)
            part.replace(folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    return folder


def free_folder(folder: Path, known: str) -> Path:
    """Return a folder for pages: a new one, an empty one, or that of an earlier build, which has a `known` file. Raises `click.UsageError`."""
    if not folder.parent.is_dir() or (folder.exists() and not folder.is_dir()):
        raise click.UsageError(f"`{folder}` is no folder that can be written")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / known).is_file():
        raise click.UsageError(f"`{folder}` has other files: name a new folder")
    return folder


def build(folder: Path) -> Path:
    """Build the pages into a folder and return it. Raises `UsageError`, `MissingPackage`."""
    import gc
    from importlib.util import find_spec

    from ..errors import MissingPackage, UsageError

    if not (MANUAL.is_dir() and MODELS.is_dir()):
        raise UsageError(
            "BR655", "the manual is built in a clone of the repository:", "install that, `pip install -e .`"
        )
    if not all(find_spec(name) for name in NEEDED):
        raise MissingPackage("BR654", "the manual needs Sphinx:", 'pip install "bondgraph-lang[manual]"')
    from sphinx.cmd.build import build_main

    gc.enable()
    click.echo("building the manual (a minute)", err=True)
    if code := build_main(["-q", str(MANUAL), str(folder)]):
        raise RuntimeError(f"the build of the manual ended with {code}")
    shutil.rmtree(folder / ".doctrees", ignore_errors=True)
    return folder


def address_of(folder: Path, word: str | None) -> str:
    """Return the address of a page or a section with this name, else of a search for it."""
    if word is None:
        return (folder / "index.html").as_uri()
    slug = re.sub(r"\W+", "-", word.strip().casefold())
    files = sorted(folder.rglob("*.html"))
    for file in files:
        if file.stem == slug:
            return file.as_uri()
    for file in files:
        if f'id="{slug}"' in file.read_text(encoding="utf-8"):
            return f"{file.as_uri()}#{slug}"
    from urllib.parse import quote

    return f"{(folder / 'search.html').as_uri()}?q={quote(word)}"
