"""Directive `made`: parts of pages that are written from the package's own tables, its models and its tests."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from docutils import nodes

import bondgraph
from compiler.api import Diagnostic

from ..catalogue import LibraryPart, example_of, interface_of, library_parts
from ..commands import GROUPS
from .running import ROOT, RUN, RunningDirective, run_command

if TYPE_CHECKING:
    from sphinx.application import Sphinx

MODELS, TESTS = ROOT / "models", ROOT / "tests"
CASES = TESTS / "errors" / "cases"
# Tests of models against something else.
COMPARING = ("gallery/test_*.py", "acceptance/test_models.py", "physics/test_*.py")
PLACE = re.compile(r"^[^:\n]+:\d+:\d+: (BG\d+): (.*)$", re.MULTILINE)


class MadeDirective(RunningDirective):
    """`made WHAT`: Markdown that a function of this module writes."""

    has_content = False
    required_arguments = 1
    optional_arguments = 0

    def run(self) -> list[nodes.Node]:
        text = "\n".join(MADE[self.arguments[0]](self))
        return list(self.parse_text_to_nodes(text, allow_section_headings=True))


def shown(language: str, text: str, closed: str = "") -> Iterator[str]:
    """Yield a block of text, behind a line that opens it if it has a name."""
    block = [f"````{language}", text.strip("\n"), "````"]
    yield from ["", f":::{{dropdown}} {closed}", *block, ":::", ""] if closed else ["", *block, ""]


def row(*cells: str) -> str:
    return "| " + " | ".join(c.replace("\n", " ").replace("|", "\\|") for c in cells) + " |"


def gallery(page: RunningDirective) -> Iterator[str]:
    """Yield the models in the order of `models/README.md`, each with its idea, picture, formula and text."""
    yield "## First models"
    for line in (MODELS / "README.md").read_text(encoding="utf-8").splitlines():
        if chapter := re.match(r"\| \*\*(.*?)\*\*(.*?)\|", line):
            yield from ("", f"## {chapter[1]}", "", chapter[2].strip().lstrip(", "), "")
        elif model := re.match(r"\| `(\w+)` \| (.*?) \|", line):
            name, idea = model.groups()
            yield from ("", f"### `{name}`", "", f"{idea[0].upper()}{idea[1:]}.", "")
            if (MODELS / "pictures" / f"{name}.svg").is_file():
                yield from (f"![bond graph of {name}](/../../models/pictures/{name}.svg)", "")
            yield from checked_against(name)
            yield from shown("bg", (MODELS / f"{name}.bg").read_text(encoding="utf-8"), f"models/{name}.bg")


def checked_against(model: str) -> Iterator[str]:
    """Yield what the tests compare a model with: the documentation of each test that names it."""
    naming = [test for test in tests_of_models() if model in test[2]]
    for file, text, _ in [t for t in naming if t[1]] or naming[:1]:
        formula = " ".join(text.split("\n\n")[-1 if text.endswith(")") else 0].split())
        yield f"- Checked: {code(formula)} (`{file}`)" if formula else f"- Checked in `{file}`."
    if not naming:
        yield "- Checked: its energy balance (`tests/acceptance/test_models.py`)."


@cache
def tests_of_models() -> tuple[tuple[str, str, frozenset[str]], ...]:
    """Return file, documentation and the models that it names of each test that compares models with something else."""
    tests = []
    for file in sorted(f for pattern in COMPARING for f in TESTS.glob(pattern)):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                words = {c.value for c in ast.walk(node) if isinstance(c, ast.Constant) and isinstance(c.value, str)}
                names = frozenset(w.removeprefix("models/").removesuffix(".bg") for w in words)
                tests.append((file.relative_to(ROOT).as_posix(), ast.get_docstring(node) or "", names))
    return tuple(tests)


def code(formula: str) -> str:
    """Return a formula so that Markdown leaves its signs alone."""
    return re.sub(r"([\\*_`<\[\]|^'])", r"\\\1", formula)


def library(page: RunningDirective) -> Iterator[str]:
    """Yield a chapter for each file of the library, in it a section for each part."""
    parts = library_parts()
    chapter = ""
    for part in parts:
        if part.library != chapter:
            chapter = part.library
            yield from ("", f"## {chapter}", "")
        yield from ("", f"### {part.name}", "", part.description, "", *part_rows(part), "")
        example = example_of(part, parts)
        if example:
            yield from part_picture(part, example, page)
            yield from shown("bg", example, f"example of {part.name}")


def part_rows(part: LibraryPart) -> Iterator[str]:
    """Yield law, source, validity, ports and quantities of a part as a table."""
    interface = interface_of(part)
    yield from ("| | |", "|---|---|")
    notes = {"law": part.law, "source": part.source, "valid": "; ".join([part.valid, *interface.limits]).strip("; ")}
    yield from (row(key, code(text)) for key, text in notes.items() if text)
    for port in interface.ports:
        yield row("port", f"`{port.name}`: {port.domain}, arrow {'in' if port.enters else 'out'}; {code(port.description)}".removesuffix("; "))  # fmt: skip
    for q in interface.quantities:
        declared = f"`{q.name}{f': {q.unit}' * bool(q.unit)}{f' = {q.value}' * bool(q.value)}`"
        yield row(q.role, f"{declared} {code(q.description)}".strip())


def part_picture(part: LibraryPart, example: str, page: RunningDirective) -> Iterator[str]:
    """Yield the bond graph of a part's example, drawn in this build unless it is to be short."""
    if page.env.config.manual_pictures:
        RUN["pictures"] += 1
        name = f"{part.library}_{part.name}.svg"
        bondgraph.load(example).draw(page.folder / name, closed=True)
        yield from (f"![bond graph of the example of {part.name}]({page.address(name)})", "")


def command_line(page: RunningDirective) -> Iterator[str]:
    """Yield the commands by what they are for, with what `--help` prints."""
    for title, names in GROUPS.items():
        yield from ("", f"## {title}", "")
        for name in names:
            exit_code, text = run_command([name, "--help"], page.folder)
            assert exit_code == 0, text
            yield from ("", f"### `{name}`", *shown("text", text))


def interface(page: RunningDirective) -> Iterator[str]:
    """Yield the names of the package: calls with their signatures and documentation."""
    for name in bondgraph.__all__:
        item = getattr(bondgraph, name)
        yield from ("", f"## `{name}`", "", *documented(name, item))
        if inspect.isclass(item):
            for member, method in sorted(vars(item).items()):
                if not member.startswith("_") and (inspect.isfunction(method) or isinstance(method, property)):
                    yield from documented(f"{name}.{member}", method)


def documented(name: str, item: object) -> Iterator[str]:
    """Yield a signature and a documentation."""
    call = item.fget if isinstance(item, property) else item
    signature = ""
    if inspect.isfunction(call) and not isinstance(item, property):
        signature = str(inspect.signature(call)).replace("(self, ", "(").replace("(self)", "()")
    yield from shown("python", f"{name}{signature}")
    yield from shown("text", inspect.getdoc(call) or "")


def codes(page: RunningDirective) -> Iterator[str]:
    """Yield a section for each code of an error in a text: its meaning, the smallest file that gives it, the message with advice."""
    listed = re.findall(r"^\| BG\dxx \| (.*?) \| ([\d ]+) \|$", (ROOT / "bondgraph" / "language.md").read_text(encoding="utf-8"), re.MULTILINE)  # fmt: skip
    cases = smallest_cases()
    sections: dict[str, list[str]] = {f"BG{n}": [] for _, numbers in listed for n in numbers.split()}
    chapters = {f"BG{numbers[:3]}": about for about, numbers in listed}
    for name, (case, message) in cases.items():
        text = case.read_text(encoding="utf-8")
        RUN["models checked"] += 1
        if name not in {d.code for d in bondgraph.check(case)}:
            raise page.error(f"{case.name} does not give {name}")
        sections[name] = [*shown("bg", text), *shown("text", message)]
    kinds = {kind.code: kind for kind in kinds_of_errors(Diagnostic)}
    for name, lines in sections.items():
        yield from ("", f"## {name[:3]}xx: {chapters[name]}") if name in chapters else ()
        yield from ("", f"### {name}", "", *meaning(kinds[name]), "", *lines)


def kinds_of_errors(base: type[Diagnostic]) -> Iterator[type[Diagnostic]]:
    """Yield the kinds of errors below one, in whatever room of the compiler."""
    for kind in base.__subclasses__():
        yield kind
        yield from kinds_of_errors(kind)


def meaning(kind: type[Diagnostic]) -> Iterator[str]:
    """Yield name, documentation, sentence and advice of a kind of error, with `…` for what each error fills in."""
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind.__name__).capitalize()
    about = re.sub(r"^BG\d+[:.]\s*", "", inspect.getdoc(kind) or "")
    yield f"{name}{': ' * bool(about)}{about.rstrip('.')}."
    for label, template in (("Message", kind.title), ("Advice", kind.advice)):
        words = re.sub(r"\{\w+\}", "…", template).rstrip(".")
        if words.strip("…"):
            yield f"*{label}:* {words}{'.' * (not words.endswith('…'))}"


def smallest_cases() -> dict[str, tuple[Path, str]]:
    """Return for each code the smallest file of the tests that gives it, alone if any does, and its message."""
    smallest: dict[str, tuple[bool, int, Path, str]] = {}
    for golden in sorted(CASES.glob("*.txt")):
        messages = golden.read_text(encoding="utf-8").strip("\n").split("\n\n")
        case = golden.with_suffix(".bg")
        by_code = {m[1]: message for message in reversed(messages) if (m := PLACE.match(message))}
        for name, message in by_code.items():
            entry = (len(by_code) > 1, case.stat().st_size, case, message)
            smallest[name] = min(smallest.get(name, entry), entry)
    return {name: entry[2:] for name, entry in sorted(smallest.items())}


MADE: dict[str, Callable[[RunningDirective], Iterator[str]]] = {
    "gallery": gallery, "library": library, "commands": command_line, "python": interface, "codes": codes,
}  # fmt: skip


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    app.add_config_value("manual_pictures", True, "env", types=(bool,))
    app.add_directive("made", MadeDirective)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
