"""Completion: the words that may stand at the cursor, from the open block, the statement so far and the names of the model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from compiler import api
from compiler.api import tree

from .answers import Suggestion
from .context import Context, context_at, path_before
from .facts import declared_dimension, dimension_of, entry_of, ports
from .libraries import import_suggestions, library_models, part_suggestion
from .units import unit_suggestions
from .vocabulary import FUNCTION_TEXTS, JUNCTIONS, KEYWORDS, USAGES, kind_text
from .workspace import Workspace

PLACES = ("element", "junction", "instance", "mechanism", "port")
WORDS_OF_EXPRESSIONS = ("time", "pi", "if", "else", "and", "or", "not", "true", "false")
PART_UNITS = {
    "mass": "kg",
    "inertia": "kg*m^2",
    "at": "m",
    "angle": "rad",
    "turn": "rad",
    "lead": "m",
    "radius": "m",
    "gravity": "m/s^2",
}


@dataclass(frozen=True, slots=True)
class CursorPlace:
    """Everything that decides what may stand at the cursor."""

    document: api.EditedFile
    survey: api.FileSurvey
    context: Context
    model: tree.ModelSyntax | None
    names: api.NameTable

    @property
    def home(self) -> str:
        """Name of the model that the cursor is in."""
        return "" if self.model is None else self.model.name

    @property
    def file(self) -> api.FileScope:
        return self.survey.file


def completion(workspace: Workspace, path: Path, at: int) -> list[Suggestion]:
    """Return what may stand at a character, in the order in which it is offered."""
    place = place_at(workspace, path, at)
    context = place.context
    if context.is_silent:
        return list(import_suggestions(workspace, path, context)) if context.first == "import" else []
    offered = dict[tuple[str, str], Suggestion]()
    for item in _offered(workspace, place):
        offered.setdefault((item.label, item.kind), item)
    return list(offered.values())


def place_at(workspace: Workspace, path: Path, at: int) -> CursorPlace:
    """Return the surroundings of a character, with the names of the model that it is in."""
    document, survey = workspace.names(path)
    start = 0
    for piece in document.pieces:
        if piece.source.before[0] <= at:
            start = piece.source.before[0]
    context = context_at(document.text[start:], at - start)
    head = next((b for b in context.blocks if b and b[0].text in ("model", "plain")), ())
    model = document.tree.models.get(head[-1].text) if head else None
    return CursorPlace(document, survey, context, model, {} if model is None else api.table_of(model))


def _offered(workspace: Workspace, place: CursorPlace) -> Iterator[Suggestion]:
    context = place.context
    if context.last == ".":
        yield from _members(place)
    elif context.first == "import":
        yield from import_suggestions(workspace, place.document.path, context)
    elif not context.blocks:
        yield from _keywords("file") if not context.statement else _expression(place)
    elif _wants_unit(context):
        yield from unit_suggestions(_wanted_dimension(place), context)
    elif context.head in ("model", "for") and not _in_mechanism(context):
        yield from _in_model(workspace, place)
    elif context.head in _BLOCKS:
        yield from _BLOCKS[context.head](place)
    else:
        yield from _attributes(place)


def _in_mechanism(context: Context) -> bool:
    return any(block and block[0].text == "multibody" for block in context.blocks)


def _keywords(where: str) -> Iterator[Suggestion]:
    for row in KEYWORDS:
        if where in row.place.split():
            yield Suggestion(
                row.word, "keyword", documentation=row.text, insert=row.snippet, is_snippet="$" in row.snippet
            )


# ---------------------------------------------------------------- models


_WITH_EXPRESSIONS = ("parameter", "constant", "input", "signal", "output", "mode", "solve", "function", "when", "every", "require", "for")  # fmt: skip


def _in_model(workspace: Workspace, place: CursorPlace) -> Iterator[Suggestion]:
    context = place.context
    first = context.first
    if not context.statement:
        yield from _names(place, PLACES)
        yield from _keywords("model")
        yield from _kinds(workspace, place)
    elif first == "port" or (
        _is_declaration(place) and _behind_colon(context) and len(context.statement) == context_colon(context) + 1
    ):
        yield from _domains()
        yield from _law(place) if first in api.ELEMENTS else ()
        yield from _expression(place) if first not in JUNCTIONS and first != "port" else ()
    elif _is_bond(context):
        yield from _names(place, PLACES)
    elif first in api.ELEMENTS and _behind_colon(context):
        yield from _law(place)
        yield from _expression(place)
    elif first in _WITH_EXPRESSIONS:
        yield from _keywords("sampling") if first == "every" and context.last != first else ()
        named = context.last == first or (context.last == "," and not context.brackets)  # a new name
        yield from () if named else _expression(place)


def _is_declaration(place: CursorPlace) -> bool:
    first = place.context.first
    return first in api.ELEMENTS or first in JUNCTIONS or first in place.file.models


def _is_bond(context: Context) -> bool:
    arrows = [w.text in ("->", "=>") for w in context.statement]
    others = (*api.ELEMENTS, *_WITH_EXPRESSIONS)
    return any(arrows) or (context.last in (",", "(") and context.first not in others and len(context.statement) > 0)


def context_colon(context: Context) -> int:
    """Position of the first colon outside of brackets; -1 if there is none."""
    depth = 0
    for number, word in enumerate(context.statement):
        depth += (word.text in ("(", "[")) - (word.text in (")", "]"))
        if word.text == ":" and not depth:
            return number
    return -1


def _behind_colon(context: Context) -> bool:
    return context_colon(context) >= 0


def _domains() -> Iterator[Suggestion]:
    for name, domain in api.DOMAINS.items():
        letters = " ".join(letter or "-" for letter in domain.letters)
        yield Suggestion(name, "domain", f"{letters}: {domain.effort}, {domain.flow}")
    yield from (Suggestion(name, "domain", " ".join(parts)) for name, parts in api.BUNDLES.items())


def _kinds(workspace: Workspace, place: CursorPlace) -> Iterator[Suggestion]:
    for kind, row in api.ELEMENTS.items():
        snippet = f"{kind} ${{1:name}} : ${{0:{row.example}}}"
        yield Suggestion(kind, "kind", row.relates, kind_text(kind), snippet, True)
    for kind, text in JUNCTIONS.items():
        yield Suggestion(kind, "kind", "junction", text, f"{kind} ${{0:name}}", True)
    for name, definition in place.file.models.items():
        if name != place.home:
            yield part_suggestion(name, definition.model)
    yield from library_models(workspace, place.document, place.file)


def _law(place: CursorPlace) -> Iterator[Suggestion]:
    """Letters of the element whose law is written."""
    name = place.context.statement[1].text if len(place.context.statement) > 1 else ""
    row = api.ELEMENTS[place.context.first]
    domains = ports(place.survey, place.home, name)
    if not domains:
        letters = {d.letter(v): d for d in api.DOMAINS.values() if d.typed for v in row.variables if d.letter(v)}
        yield from (Suggestion(letter, "variable", domain.name) for letter, domain in letters.items())
    for port, domain in domains.items():
        for variable in row.variables:
            letter = domain.letter(variable)
            label = f"{letter}{port}" if port in ("1", "2") else f"{port}.{letter}" if port else letter
            yield Suggestion(label, "variable", f"in {domain.dimension(variable)}")
    yield Suggestion("energy", "variable", "in J") if row.group == "storage" else Suggestion("e", "variable", "effort")


# ---------------------------------------------------------------- names


def _names(place: CursorPlace, kinds: Iterable[str]) -> Iterator[Suggestion]:
    """Names of some kinds, those of the first kind first."""
    order = list(kinds)
    listed = [name for name in place.names.values() if name.kind in order]
    yield from map(_named, sorted(listed, key=lambda name: order.index(name.kind)))


def _named(name: api.DeclaredName) -> Suggestion:
    value = name.node.value if isinstance(name.node, tree.Item) else None
    shown = f"= {value.span.words}" if value is not None and name.kind != "output" else ""
    return Suggestion(name.name, name.kind, " ".join(filter(None, (name.type, shown))), name.description)


def _expression(place: CursorPlace) -> Iterator[Suggestion]:
    yield from (_named(n) for n in place.names.values() if n.kind != "function")
    for name in api.file_names(place.file).values():
        if name.kind == "constant":
            yield _named(name)
    functions = {n.name for n in (*place.names.values(), *api.file_names(place.file).values()) if n.kind == "function"}
    yield from (Suggestion(f, "function", "", "", f"{f}($0)", True) for f in functions)
    for function, usage in USAGES.items():
        yield Suggestion(function, "function", usage, FUNCTION_TEXTS.get(function, ""), f"{function}($0)", True)
    yield from (Suggestion(w, "keyword") for w in WORDS_OF_EXPRESSIONS)


def _members(place: CursorPlace) -> Iterator[Suggestion]:
    """Names behind a point: ports in a bond, else what can be read."""
    path = path_before(place.context.statement)
    names, file, name, owner = place.names, place.file, None, place.home
    for word in path:
        name = names.get(word)
        if name is None:
            return
        owner = name.owner[0] if name.owner else owner
        names, file = api.names_inside(name, file)
    if name is None:
        return
    bond = _is_bond(place.context) or len(place.context.statement) == 2 * len(path)
    for inner in names.values():
        if inner.span.unit is not None and inner.name.startswith(api.HELD):
            continue  # what a run exchanges with the unit
        if not bond or inner.kind in ("port", "component", "part"):
            yield _named(inner)
    if name.kind == "part":
        yield from _coordinates(place, name)
    elif name.kind in ("element", "junction") and not bond:
        yield from _readable(place, name, owner)


def _coordinates(place: CursorPlace, part: api.DeclaredName) -> Iterator[Suggestion]:
    mechanism = place.names.get(part.owner[-1])
    planar = mechanism is None or mechanism.type != "spatial"
    yield from (Suggestion(c, "port", "coordinate") for c in api.freedoms_of(part.type, planar))
    entry = entry_of(place.survey, place.home, part.owner[-1])
    inner = getattr(getattr(entry, "parts", None), "entries", {}).get(part.name)
    if isinstance(inner, api.PartEntry):
        yield from (Suggestion(group, "variable", " ".join(names)) for group, names in inner.groups.items())


def _readable(place: CursorPlace, name: api.DeclaredName, owner: str) -> Iterator[Suggestion]:
    row = api.ELEMENTS.get(name.type)
    words = {"e": "effort", "f": "flow", "q": "displacement", "p": "momentum"}
    for port, domain in ports(place.survey, owner, name.name).items():
        readable = row.readable if row is not None else {"0": "e", "1": "f"}.get(name.type, "ef")
        for variable in readable if not port or port in ("1", "2") else ():
            yield Suggestion(
                f"{domain.letter(variable)}{port}", "variable", f"{words[variable]} in {domain.dimension(variable)}"
            )


# ---------------------------------------------------------------- blocks


def _experiment(place: CursorPlace) -> Iterator[Suggestion]:
    context = place.context
    if not context.statement:
        yield from _keywords("experiment")
    elif context.first in ("set", "sweep") and "=" not in [w.text for w in context.statement]:
        yield from _names(place, ("parameter", "input", "instance"))
    elif context.first == "start" and "=" not in [w.text for w in context.statement]:
        yield from _names(place, ("element", "instance", "mechanism", "mode", "signal"))
    elif context.first == "report" and context.last in ("report", ","):
        yield from _names(place, ("output", "element", "junction", "instance", "mechanism", "signal", "input"))
    elif context.last == "simulate":
        yield Suggestion("0 .. 1 s", "keyword", "from .. to", "", "0 .. ${0:1 s}", True)
    elif context.first in api.ANALYSIS_STEPS and context.last != "=":
        yield from _names(place, ("parameter", "input", "output", "signal", "instance"))
        yield from (Suggestion(w, "keyword") for w in ("to", "over"))
    else:
        yield from _expression(place)


def _mechanism(place: CursorPlace) -> Iterator[Suggestion]:
    context = place.context
    block = next(b for b in context.blocks if b and b[0].text == "multibody")
    mechanism = place.names.get(block[1].text) if len(block) > 1 else None
    planar = not any(word.text == "spatial" for word in block)
    if not context.statement:
        for kind in api.kinds_of(planar):
            listed = ", ".join(api.attributes_of(kind, planar))
            form = (
                " : ${2:ground} to ${3:body}" if kind not in ("body", "frame") else " : ${2:body}" * (kind == "frame")
            )
            yield Suggestion(kind, "kind", listed, "", f"{kind} ${{1:name}}{form} {{ $0 }}", True)
        yield from _keywords("mechanism")
    else:
        yield Suggestion("ground", "keyword")
        yield Suggestion("to", "keyword")
        if mechanism is not None and isinstance(mechanism.node, tree.MechanismSyntax):
            yield from (_named(n) for n in api.parts_of(mechanism.node, mechanism.owner).values())
        yield from _expression(place)


def _simulate(place: CursorPlace) -> Iterator[Suggestion]:
    if [w.text for w in place.context.statement[-2:]] == ["solver", "="]:
        yield from (Suggestion(name, "solver") for name in api.SOLVERS)
    elif not place.context.statement or place.context.last == ",":
        yield from _keywords("simulate")
    else:
        yield from _expression(place)


def _analysis(place: CursorPlace) -> Iterator[Suggestion]:
    row = api.ANALYSIS_STEPS[place.context.head]
    if not place.context.statement or place.context.last == ",":
        words = (*(name for name, _, _ in row.counts), *row.truths, *row.named)
        yield from (Suggestion(word, "attribute") for word in words)
    else:
        yield from _expression(place)


def _resets(place: CursorPlace) -> Iterator[Suggestion]:
    kinds = ("mode", "element", "instance", "mechanism")
    yield from _names(place, kinds) if place.context.last in ("", ",") else _expression(place)


_BLOCKS: Mapping[str, Callable[[CursorPlace], Iterator[Suggestion]]] = {
    "experiment": _experiment,
    "multibody": _mechanism,
    "for": _mechanism,
    "simulate": _simulate,
    "when": _resets,
    "every": _resets,
    **dict.fromkeys(api.ANALYSIS_STEPS, _analysis),
}


def _attributes(place: CursorPlace) -> Iterator[Suggestion]:
    """Attributes in the braces of a declaration."""
    context = place.context
    words = context.statement
    if context.last == ",":
        words = words[[w.text for w in words].index(",") + 1 :]
    if context.last in ("start", "nominal") and context.head in api.ELEMENTS:
        name = place.names.get(context.blocks[-1][1].text)
        readable = list(_readable(place, name, place.home)) if name is not None else []
        yield from readable or _letters_of_law(context)
        return
    if "=" in [w.text for w in words]:
        yield from _expression(place)
        yield from (Suggestion(w, "keyword") for w in ("integral", "derivative", "effort", "flow"))
        return
    definition = place.file.models.get(context.head)
    if definition is not None:
        for name in api.table_of(definition.model).values():
            if name.kind in ("parameter", "input"):
                item = _named(name)
                yield Suggestion(item.label, item.kind, item.detail, item.documentation, f"{name.name} = ", False)
    elif _in_mechanism(context):
        planar = not any(word.text == "spatial" for block in context.blocks for word in block[:5])
        if context.head in api.kinds_of(planar):
            yield from (Suggestion(a, "attribute", "", "", f"{a} = ") for a in api.attributes_of(context.head, planar))
    elif context.head in JUNCTIONS:
        yield from (
            Suggestion(k.word, "attribute", "", k.text, k.snippet, True) for k in KEYWORDS if "junction" in k.place
        )
    elif context.head in api.ELEMENTS:
        yield from _keywords("attribute")


def _letters_of_law(context: Context) -> Iterator[Suggestion]:
    """Letters of an element whose line cannot be read yet, in the domain that has most of those that it uses."""
    words = {w.text for w in context.blocks[-1]}
    domain = max((d for d in api.DOMAINS.values() if d.typed), key=lambda d: len(words.intersection(d.letters)))
    for variable in api.ELEMENTS[context.head].readable:
        if domain.letter(variable) in words:
            yield Suggestion(domain.letter(variable), "variable", f"in {domain.dimension(variable)}")


# ---------------------------------------------------------------- units


def _wants_unit(context: Context) -> bool:
    """Return True behind a number, in the brackets behind one, behind the colon of a quantity and behind the `in` of a report."""
    words = context.statement
    if not words:
        return False
    if words[-1].kind == "number":
        return (words[0].text not in ("for",) and len(words) > 1) or words[0].kind != "number"
    if context.brackets and words[context.brackets[-1]].text == "[":
        before = words[context.brackets[-1] - 1] if context.brackets[-1] else None
        return before is not None and before.kind == "number"
    if words[-1].text == "in" and words[0].text == "report":
        return True
    return words[0].text in ("parameter", "constant", "input", "signal", "output", "sweep") and _declares_unit(context)


def _declares_unit(context: Context) -> bool:
    """Return True between the colon of a quantity and its `=`."""
    for word in reversed(context.statement):
        if word.text == ":":
            return True
        if word.text in ("=", ","):
            return False
    return False


def _wanted_dimension(place: CursorPlace) -> api.Dimension | None:
    """Dimension that a quantity at the cursor must have, if the statement tells."""
    context = place.context
    words = [w.text for w in context.statement]
    if context.first == "report" and context.last == "in":
        return _dimension_of_words(place, context.statement[:-1])
    if context.first in ("simulate",):
        return dimension_of("s")
    if "=" not in words:
        return None
    equals = len(words) - 1 - words[::-1].index("=")
    names = [w for w in context.statement[:equals] if w.kind == "name"]
    if not names:
        return None
    definition = place.file.models.get(context.head)
    if definition is not None and len(context.blocks) > 1:
        inner = api.table_of(definition.model).get(names[-1].text)
        return None if inner is None else declared_dimension(inner, place.survey, definition.name)
    if _in_mechanism(context) and names[-1].text in PART_UNITS:
        return dimension_of(PART_UNITS[names[-1].text])
    if context.head in api.ELEMENTS and names[0].text in ("start", "nominal"):
        return _letter_dimension(place, context.blocks[-1][1].text, names[-1].text)
    if context.first in api.ELEMENTS and len(words) - equals <= 2:
        return _letter_dimension(place, words[1], names[-1].text)
    if context.first in ("parameter", "constant", "input", "signal", "output"):
        comma = max((i for i, word in enumerate(words[:equals]) if word == ","), default=0)
        if ":" not in words[comma:equals]:  # the unit of its value is its own
            return None
        return _dimension_of_words(place, context.statement[comma + 1 : comma + 2])
    return _dimension_of_words(place, context.statement[:equals])


def _letter_dimension(place: CursorPlace, element: str, letter: str) -> api.Dimension | None:
    for domain in ports(place.survey, place.home, element).values():
        variable = domain.variable(letter) or domain.variable(letter[:-1])
        if variable is not None:
            return domain.dimension(variable)
    usual: set[api.Dimension] = {
        d.dimension(v) for d in api.DOMAINS.values() if d.guessed and (v := d.variable(letter)) and letter not in "efqp"
    }
    return next(iter(usual)) if len(usual) == 1 else None


def _dimension_of_words(place: CursorPlace, words: tuple[object, ...]) -> api.Dimension | None:
    """Dimension of the last path among the words: a name, or `spring.x`."""
    texts = [getattr(w, "text", "") for w in words]
    if not texts:
        return None
    if len(texts) > 2 and texts[-2] == ".":
        return _letter_dimension(place, texts[-3], texts[-1])
    name = place.names.get(texts[-1])
    return None if name is None else declared_dimension(name, place.survey, place.home)
