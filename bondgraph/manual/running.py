"""Directives that run what a page shows: models, commands and Python; a build ends with an error where one fails.

Each page has an empty folder, in which its files lie, beside a link to `models/`, and one namespace for its Python.
"""

from __future__ import annotations

import io
import os
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from pygments.lexers.shell import BashSessionLexer
from pygments.lexers.special import TextLexer
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from .. import check
from ..commands import commands
from ..editors.pygments_lexer import BondgraphLexer

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[2]
FENCES = ("bg", "bg-part", "bg-drawn", "bg-later")  # those of the language reference
FIRST_RUN = "note: making the machine code of the "  # once on a machine, so not on every page
RUN: Counter[str] = Counter()  # what this build has run, by its kind
NAMESPACES: dict[str, dict[str, object]] = {}  # of the Python of each page
LOG = logging.getLogger(__name__)


class RunningDirective(SphinxDirective):  # type: ignore[misc]
    """A directive with the folder of its page."""

    has_content = True
    optional_arguments = 1

    @property
    def folder(self) -> Path:
        return Path(self.env.doctreedir, "pages", self.env.docname)

    def block(self, text: str, language: str) -> nodes.Node:
        block = nodes.literal_block(text, text, language=language)
        block["classes"] = [f"shown-{language}"]
        return block

    def picture(self) -> Iterator[nodes.Node]:
        """Yield the picture that the option names, as a file of the build."""
        for name in str(self.options.get("picture", "")).split():
            if not (self.folder / name).is_file():
                raise self.error(f"nothing made the picture {name}")
            yield nodes.image(uri=self.address(name), alt=self.options.get("alt", name))

    def address(self, name: str) -> str:
        """Return the path of a file of the page's folder as Sphinx takes that of an image: from its sources."""
        path: str = os.path.relpath(self.folder / name, self.env.srcdir)
        return "/" + path.replace(os.sep, "/")

    def first_lines(self, text: str) -> str:
        """Return a text, cut behind as many lines as the option says."""
        lines, most = text.splitlines(), self.options.get("lines", 10_000)
        return "\n".join([*lines[:most], *(["…"] * (len(lines) > most))])


class FileDirective(RunningDirective):
    """`bg NAME`: a model of the page, checked; `:wrong:` says that it has errors."""

    required_arguments = 1
    optional_arguments = 0
    option_spec: ClassVar[dict[str, Callable[[str], object]]] = {"wrong": directives.flag}

    def run(self) -> list[nodes.Node]:
        text = "\n".join(self.content) + "\n"
        file = self.folder / self.arguments[0]
        file.write_text(text, encoding="utf-8")
        if file.suffix == ".bg":
            RUN["models checked"] += 1
            if bool(problems := check(file)) != ("wrong" in self.options):
                raise self.error(
                    "\n".join(f"line {d.span.line}: {d.code} {d.sentence}" for d in problems) or "no error"
                )
        caption = nodes.paragraph("", "", nodes.literal(text=file.name), classes=["file-name"])
        return [caption, self.block(text, "bg" if file.suffix == ".bg" else "text")]


class CommandDirective(RunningDirective):
    """`run`: lines of `bondgraph …` with what they print; `:exit:` is the exit code of the last, `:picture:` a file that they write."""

    option_spec: ClassVar[dict[str, Callable[[str], object]]] = {
        "exit": int, "picture": str, "alt": str, "lines": int,
    }  # fmt: skip

    def run(self) -> list[nodes.Node]:
        shown = []
        for line in self.content:
            code, text = run_command(shlex.split(line)[1:], self.folder)
            if code != (self.options.get("exit", 0) if line == self.content[-1] else 0):
                raise self.error(f"`{line}` ended with {code}:\n{text}")
            shown.append(f"$ {line}\n{self.first_lines(text)}".rstrip())
        return [self.block("\n".join(shown), "console"), *self.picture()]


class PythonDirective(RunningDirective):
    """`python`: a piece of the page's program, with what it prints; `:picture:` is a file that it writes."""

    option_spec: ClassVar[dict[str, Callable[[str], object]]] = {"picture": str, "alt": str, "lines": int}

    def run(self) -> list[nodes.Node]:
        text = "\n".join(self.content)
        RUN["pieces of Python"] += 1
        names = NAMESPACES.setdefault(self.env.docname, {"__name__": "manual"})
        with shown_in(self.folder) as printed:
            try:
                exec(compile(text, f"{self.env.docname}.md", "exec"), names)
            except Exception as problem:
                raise self.error(f"{type(problem).__name__}: {problem}") from problem
        blocks = [self.block(text, "python")]
        if printed.getvalue().strip():
            blocks.append(self.block(self.first_lines(printed.getvalue()), "text"))
        return [*blocks, *self.picture()]


def run_command(arguments: list[str], folder: Path) -> tuple[int, str]:
    """Run the command line in this process; return the exit code and what it printed."""
    import click

    RUN["commands"] += 1
    with shown_in(folder) as printed:
        try:
            code = commands.main(list(arguments), prog_name="bondgraph", standalone_mode=False)
        except click.ClickException as problem:
            problem.show(printed)
            code = problem.exit_code
    lines = [line for line in printed.getvalue().splitlines() if not line.startswith(FIRST_RUN)]
    return code if isinstance(code, int) else 0, "\n".join(lines).strip("\n")


@contextmanager
def shown_in(folder: Path) -> Iterator[io.StringIO]:
    """Work in a folder, in a terminal of 100 columns whose text is collected."""
    here, columns, printed = Path.cwd(), os.environ.get("COLUMNS"), io.StringIO()
    os.chdir(folder)
    os.environ["COLUMNS"] = "100"
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            yield printed
    finally:
        os.chdir(here)
        os.environ.pop("COLUMNS")
        os.environ.update({} if columns is None else {"COLUMNS": columns})


def start_page(app: Sphinx, name: str, source: list[str]) -> None:
    """Give a page an empty folder and an empty namespace."""
    folder = app.doctreedir / "pages" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        (folder / "models").symlink_to(ROOT / "models", target_is_directory=True)
    except OSError:  # Windows has links for some users only
        shutil.copytree(ROOT / "models", folder / "models")
    NAMESPACES.pop(name, None)


def end_page(app: Sphinx, doctree: nodes.document) -> None:
    """Forget the objects of a page."""
    NAMESPACES.clear()


def tell_counts(app: Sphinx, failure: Exception | None) -> None:
    """Print how much this build has run."""
    if failure is None:
        LOG.info("run for these pages: %s", ", ".join(f"{n} {kind}" for kind, n in sorted(RUN.items())) or "nothing")
    RUN.clear()


class CommandLexer(BashSessionLexer):  # type: ignore[misc]
    """Commands behind `$`; what they print may begin with `#`."""

    name = "commands with what they print"
    aliases: ClassVar[list[str]] = []
    _ps1rgx = re.compile(r"^(\$ )(.*\n?)")


def reach_by_keyboard(
    app: Sphinx, page: str, template: str, context: dict[str, object], doctree: nodes.document | None
) -> None:
    """Let blocks that scroll take the focus, and give captions of the navigation their level, as screen readers need it."""
    for old, new in (
        ("<pre>", '<pre tabindex="0">'),
        ('<div class="table-wrapper', '<div tabindex="0" class="table-wrapper'),
    ):
        context["body"] = str(context.get("body", "")).replace(old, new)
    tree = str(context["furo_navigation_tree"])
    context["furo_navigation_tree"] = tree.replace('role="heading">', 'role="heading" aria-level="2">')


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives and the colours with Sphinx."""
    for fence in FENCES:
        app.add_lexer(fence, BondgraphLexer)
    app.add_lexer("csv", TextLexer)
    app.add_lexer("console", CommandLexer)
    app.add_directive("bg", FileDirective)
    app.add_directive("run", CommandDirective)
    app.add_directive("python", PythonDirective)
    app.connect("source-read", start_page)
    app.connect("doctree-read", end_page)
    app.connect("html-page-context", reach_by_keyboard, priority=900)  # behind the theme
    app.connect("build-finished", tell_counts)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
