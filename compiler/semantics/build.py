"""Syntax tree to bond graph: the main function of this room, with the passes in the order that they need."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import field, replace
from pathlib import Path

from ..algebra.formula import Bound
from ..errors import CompilationFailed, Diagnostic
from ..fast_dataclass import dataclass
from ..graph.domains import DOMAINS
from ..graph.network import BondGraph, Requirement, behind
from ..scene import Plan, Scene
from ..source import Source, Span
from ..syntax import SyntaxTree, parse, parse_expression, tree
from ..syntax.blocks import flat
from .experiments.initial_values import read_initial_values
from .experiments.plan import choose_experiment, experiment_overrides, experiments_of, read_plan
from .names.compound_units import in_one_literal, names_in, with_readings
from .names.domain_table import slot_defaults, wall_items
from .names.errors import AbsentName, NoSingleModel, UnknownName, WrongConnection
from .names.imports import Loader
from .names.scope import Absent, Broken, FileScope, ModelDefinition, Scalar, Scope
from .names.statement_errors import MAXIMUM_MISTAKES, suggestion
from .network.elaborate import Elaborator
from .network.events import parameter_checks, read_events, read_relays, read_requirements, read_stops
from .network.nodes import Nodes, unconnected
from .resolution.elaboration_cache import MAXIMUM_PARTS, ElaborationCache
from .resolution.solves import read_solves


@dataclass(frozen=True, slots=True)
class Built:
    """A flat model and the plan of its experiment."""

    graph: BondGraph
    plan: Plan
    files: tuple[Source, ...] = ()  # files that were read in addition to the text
    positive: tuple[tuple[str, Bound], ...] = ()  # expressions that must not be negative; only a run knows their values
    structural: frozenset[str] = frozenset()  # quantities that decide which parts there are
    choices: Mapping[str, tuple[str, ...]] = field(
        default_factory=dict
    )  # parameters that are one of several words; of a text none
    truths: frozenset[str] = frozenset()  # quantities that are true or false

    def checking(self, checks: Iterable[Requirement], fixed: Set[str] = frozenset()) -> Built:
        """Return the same with checks at its start, and with constants in the place of parameters of these names."""
        quantities = {
            name: replace(named, role="constant") if named.role == "parameter" and name in fixed else named
            for name, named in self.graph.quantities.items()
        }
        requirements = (*self.graph.requirements, *checks)
        return replace(self, graph=replace(self.graph, quantities=quantities, requirements=requirements))


def build_graph(
    syntax: SyntaxTree, scene: Scene, library: Path | None = None, most_parts: int = MAXIMUM_PARTS
) -> Built:
    """Elaborate the model that a scene names. Raises `CompilationFailed` with all errors."""
    loader = Loader(library)
    file = loader.load(syntax)
    definition = choose_model(file, scene.model, loader.diagnostics)
    definition = _with_outputs(definition, scene.extra_outputs)
    for port, given in scene.ports:
        definition = _with_source(definition, port, given)
    opened = _Opened.of(definition, scene, loader.diagnostics, False, ElaborationCache(most_parts))
    built = opened.built()
    if opened.elaborator.diagnostics:
        raise CompilationFailed(with_readings(opened.elaborator.diagnostics, syntax))
    others = [scope for scope in loader.files.values() if scope is not file]
    sheets = [sheet.source for scope in (file, *others) for sheet in scope.sheets.values()]
    return replace(built, files=(*(scope.source for scope in others), *sheets))


def _with_outputs(definition: ModelDefinition, outputs: Sequence[tuple[str, str]]) -> ModelDefinition:
    """Return a model with more outputs at its end. Raises `CompilationFailed` for a text that is no expression."""
    if not outputs:
        return definition
    items, names = [], _names_read_in(definition)
    for name, text in outputs:
        source = Source(f"output {name}", text)
        span = Span(source, 0, len(text))
        value = in_one_literal(parse_expression(source), names)
        items.append(tree.Item(span, name, None, None, value, None))
    model = definition.model
    statement = tree.Quantities(items[0].span, "output", tuple(items))
    return replace(definition, model=replace(model, statements=(*model.statements, statement)))


def _with_source(definition: ModelDefinition, port: str, given: str) -> ModelDefinition:
    """Return a model with a source in the place of a port, whose effort or flow is an input; the other is an output. Raises `CompilationFailed`."""
    model, statements = definition.model, list[tree.SyntaxNode]()
    places = [p for s in model.statements if isinstance(s, tree.PortsSyntax) for p in s.items]
    single = [p for p in places if not (p.index or p.components or p.width) and DOMAINS.get(p.domain or "") is not None]
    if port not in (p.name for p in single):
        hint = f"Its ports of one bond with a domain are {', '.join(f'`{p.name}`' for p in single)}."
        if any(p.name == port for p in places):
            hint = "Only a port of one bond can be open, and it says its domain: `port end: translation`."
        elif not single:
            hint = f"It has none: inside it, write `port {port}: translation`, or of another domain, and its bond, `{port} -> NAME`."
        raise CompilationFailed([WrongConnection(model.name_span, f"`{port}` is no port of one bond of `{model.name}`", hint)])  # fmt: skip
    domain = DOMAINS[next(p.domain for p in single if p.name == port) or ""]
    variable, kind, other = ("e", "MSe", "f") if given == "effort" else ("f", "MSf", "e")
    plain = model.plain or not domain.typed
    letter, result = (variable, other) if plain else (domain.letter(variable), domain.letter(other))
    unit = "" if plain else f": {domain.dimension(variable)}"
    text = f"input {port}_{letter}{unit} = 0\n{kind} {port} : {letter} = {port}_{letter}\noutput {port}_{result} = {port}.{result}"
    source = parse(Source(f"port {port}", f"{'plain ' * plain}model Port {{\n{text}\n}}")).models["Port"]
    for statement in model.statements:
        if not isinstance(statement, tree.PortsSyntax):
            statements.append(statement)
        elif others := tuple(p for p in statement.items if p.name != port):
            statements.append(replace(statement, items=others))
    return replace(definition, model=replace(model, statements=(*statements, *source.statements)))


def _names_read_in(definition: ModelDefinition) -> set[str]:
    return names_in(definition.model) | definition.file.constants.keys()


@dataclass(frozen=True, slots=True)
class Checked:
    """Errors in a file. If there are none, also the elaborated main model, so that it is not elaborated twice."""

    diagnostics: list[Diagnostic]
    built: Built | None = None


def check_parts(
    syntax: SyntaxTree, library: Path | None = None, wanted: str | None = None, broken: frozenset[str] = frozenset(),
    most_parts: int = MAXIMUM_PARTS,
) -> Checked:  # fmt: skip
    """Check every model of a file separately, with its experiments, and return all errors.

    Open ports and parameters without value are allowed, except in the main model if it has no other errors.
    `broken` names models with lines that could not be parsed: they are skipped, and their instances give no errors.
    """
    loader = Loader(library)
    file = loader.load(syntax)
    for name in broken:
        file.models.pop(name, None)
    file.missing |= broken
    diagnostics = list(loader.diagnostics)
    known = ElaborationCache(most_parts)
    main = None if diagnostics or broken else main_model(file, wanted)
    whole: Built | None = None
    for definition in [d for d in file.models.values() if d.file is file]:
        if len(diagnostics) > MAXIMUM_MISTAKES:
            break
        checked = check_model(definition, definition is main, known)
        whole = checked.built if definition is main else whole
        diagnostics += checked.diagnostics
    diagnostics += check_sets(file, known)
    return Checked(with_readings(diagnostics, syntax), None if diagnostics else whole)


@dataclass(frozen=True, slots=True)
class CheckedModel:
    """Errors in one model and its experiments, its names, and its flat graph; `built` is complete if there are no errors and it is the main model."""

    diagnostics: list[Diagnostic]
    scope: Scope | None  # None if a limit was passed
    parts: Built | None
    built: Built | None = None


def check_model(definition: ModelDefinition, is_main: bool, known: ElaborationCache) -> CheckedModel:
    """Elaborate one model with its experiments and return all errors in it."""
    opened = _Opened.of(definition, Scene(experiment=None), (), not is_main, known)
    parts = opened.built()
    whole = parts if is_main else None
    if is_main and opened.elaborator.diagnostics:  # values missing for a run: reported last
        whole, opened = None, _Opened.of(definition, Scene(experiment=None), (), True, known)
        parts = opened.built()
    diagnostics = list(opened.elaborator.diagnostics)
    for experiment in experiments_of(definition).values():
        diagnostics += _check_experiment(opened, experiment, known)
    return CheckedModel(diagnostics, opened.elaborator.root, parts, whole)


def check_sets(file: FileScope, known: ElaborationCache) -> list[Diagnostic]:
    """Return the errors in the sets of parameters of a file."""
    elaborator = Elaborator((), True, known)
    elaborator.check_sets(s for s in file.sets.values() if s.file is file)
    return elaborator.diagnostics


def main_model(file: FileScope, wanted: str | None) -> ModelDefinition | None:
    """The model that a run would take; None for a file of parts."""
    try:
        chosen = choose_model(file, wanted, [])
    except CompilationFailed:
        return None
    return None if any(wall_items(chosen.model)) else chosen


def _check_experiment(opened: _Opened, experiment: tree.Experiment, known: ElaborationCache) -> list[Diagnostic]:
    """Return the errors of an experiment. One that sets and sweeps nothing is read in the model that is already elaborated."""
    scene = Scene(experiment=experiment.name)
    if any(isinstance(s, tree.Set | tree.SweepSyntax | tree.Analysis) for s in experiment.steps):
        other = _Opened.of(opened.definition, scene, (), True, ElaborationCache(known.most_parts))
        other.built()
        return other.elaborator.diagnostics
    elaborator = opened.elaborator
    before = len(elaborator.diagnostics)
    read_stops(elaborator, experiment)
    read_plan(elaborator, experiment, elaborator.root, scene)
    elaborator.integrals()
    return elaborator.diagnostics[before:]


def open_part(syntax: SyntaxTree, wanted: str | None) -> str | None:
    """Return the name of the main model if it has ports of its own. Raises `CompilationFailed` if the file has no main model."""
    file = FileScope(syntax.source)
    file.models.update({n: ModelDefinition(m, file) for n, m in syntax.models.items()})
    model = choose_model(file, wanted, []).model
    return model.name if any(wall_items(model)) else None


def choose_model(file: FileScope, wanted: str | None, diagnostics: Sequence[Diagnostic]) -> ModelDefinition:
    """Return the model named `wanted`; without a name, the only model that no other model of the file uses."""
    own = {n: d for n, d in file.models.items() if d.file is file}
    span = Span(file.source, 0, min(1, len(file.source.text)))
    if wanted is not None:
        if wanted in own:
            return own[wanted]
        hint = suggestion(wanted, list(own), f"It defines: {', '.join(own) or 'no model'}.")
        raise CompilationFailed([*diagnostics, UnknownName(span, wanted, "the models of the file", hint)])
    declarations = [d for m in own.values() for d in flat(m.model.statements) if isinstance(d, tree.Declaration)]
    used = {d.kind for d in declarations}
    used |= {name for m in own.values() for name in slot_defaults(m.model.statements).values()}
    used |= {a.value.words for d in declarations for a in d.attributes if isinstance(a.value, tree.PathSyntax)}
    free = [n for n in own if n not in used]
    if len(free) == 1:
        return own[free[0]]
    if not own:
        if diagnostics:
            raise CompilationFailed(diagnostics)
        hint = "Write `model Name { … }`, or begin with what `bondgraph new` writes."
        raise CompilationFailed([NoSingleModel(span, "The file defines no model", hint)])
    if not free:  # all use each other: opening one finds the cycle
        return next(iter(own.values()))
    what = f"The file has several models to run: {', '.join(free)}"
    whole = [n for n in free if not any(isinstance(s, tree.PortsSyntax) for s in own[n].model.statements)]
    hint = (
        f"Name one: `--model {whole[0]}`."
        if whole
        else f'All are parts, with ports: `import {free[0]} from "FILE"` in a model that has an instance of one.'
    )
    raise CompilationFailed([*diagnostics, NoSingleModel(own[free[1]].model.name_span, what, hint)])


@dataclass(frozen=True, slots=True)
class _Opened:
    """A model elaborated for a scene: all its names are known, its laws are not read yet."""

    definition: ModelDefinition
    scene: Scene
    experiment: tree.Experiment | None
    elaborator: Elaborator
    known: ElaborationCache

    @staticmethod
    def of(
        definition: ModelDefinition, scene: Scene, earlier: Sequence[Diagnostic], part: bool, known: ElaborationCache
    ) -> _Opened:
        experiment, told = choose_experiment(definition, scene.experiment)
        overrides = [*experiment_overrides(experiment), *scene.overrides]  # the command line comes last and wins
        names = _names_read_in(definition) if overrides else set[str]()
        overrides = [replace(o, value=in_one_literal(o.value, names)) for o in overrides]
        elaborator = Elaborator(overrides, part, known)
        elaborator.diagnostics += [*earlier, *told]
        elaborator.for_all_values = "*" in scene.free
        steps = experiment.steps if experiment is not None else ()
        elaborator.swept = tuple(s for s in steps if isinstance(s, tree.SweepSyntax))
        elaborator.instantiate(definition, "", {}, ())
        return _Opened(definition, scene, experiment, elaborator, known)

    def built(self) -> Built:
        """Build the flat graph and its plan. Errors are collected in the elaborator."""
        elaborator = self.elaborator
        for pending in elaborator.pending:
            elaborator.guard(elaborator.quantity, pending)
        read_solves(elaborator)
        nodes = Nodes(elaborator, self.known)
        nodes.build()
        starts = read_initial_values(elaborator, self.experiment, elaborator.root, nodes.nodes)
        requirements = read_requirements(elaborator)
        events = (*read_events(elaborator, nodes.nodes), *read_stops(elaborator, self.experiment))
        elaborator.integrals()  # signals with memory may read each other
        elaborator.delays()
        read_relays(elaborator)
        plan, outputs = read_plan(elaborator, self.experiment, elaborator.root, self.scene)
        _check_overrides(elaborator, self.scene)
        events = (*events, *read_relays(elaborator))
        delays = elaborator.delays()
        elaborator.need_no_values()
        graph = BondGraph(
            self.definition.name,
            tuple(starts.nodes(nodes.nodes)),
            tuple(nodes.bonds),
            starts.quantities(elaborator.quantities),
            outputs,
            starts.memories(elaborator.integrals()),
            self.definition.model.name_span,
            requirements,
            elaborator.stands,
            nodes.walls,
            events,
            tuple(nodes.switches),
            delays,
        )
        if not elaborator.part and not elaborator.structure_broken:
            elaborator.diagnostics += unconnected(graph)
        choices = {p.name: tuple(word for word, _ in p.item.choices) for p in elaborator.pending if p.item.choices}
        truths = (p.name for p in elaborator.pending if isinstance(p.result, Scalar) and p.result.truth)
        structural = behind(elaborator.structural, graph.quantities)
        choices |= {p.name: () for p in elaborator.pending if getattr(p.result, "text", None) is not None}
        built = Built(graph, plan, (), tuple(elaborator.positive), structural, choices, frozenset(truths))
        if "*" not in self.scene.free:
            return built
        # A program for all values is one for these parts alone.
        return built.checking(parameter_checks(elaborator, graph.quantities), structural | self.scene.fixed)


def _check_overrides(elaborator: Elaborator, scene: Scene) -> None:
    settable = [p.name for p in elaborator.pending if p.role in ("parameter", "input")]
    known = f"Parameters and inputs: {', '.join(settable[:12])}{'…' if len(settable) > 12 else ''}."
    known = known if settable else "It has neither parameters nor inputs."
    roles = {p.name: p.role for p in elaborator.pending}
    lists = {n for n in elaborator.quantities if "[" in n}
    for path, override in elaborator.overrides.items():
        if path in elaborator.used_overrides:
            continue
        first = elaborator.root.entries.get(path.split("[")[0].split(".")[0])
        if path in roles and roles[path] not in ("parameter", "input"):
            article = "an" if roles[path][:1] in "aeiou" else "a"
            what = "what a `solve` looks for" if roles[path] == "solve" else f"{article} {roles[path]}"
            hint = f"It is {what}; only parameters and inputs are set from outside."
            elaborator.tell(UnknownName(override.span, path, "what can be set", hint))
        elif isinstance(first, Absent):
            elaborator.tell(AbsentName(override.span, path, first.branch, first.span))
        elif not isinstance(first, Broken):
            hint = suggestion(path, [*settable, *lists], known)
            elaborator.tell(UnknownName(override.span, path, f"`{elaborator.root.definition.name}`", hint))
    for name in scene.free - {"*"}:
        if name not in elaborator.quantities:
            span = elaborator.root.definition.model.name_span
            elaborator.tell(UnknownName(span, name, "what can be set", suggestion(name, settable, known)))
