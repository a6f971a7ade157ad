"""Syntax tree to bond graph: the room's one verb, in the order in which things must happen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..algebra.formula import Bound
from ..errors import CompilationFailed, Diagnostic
from ..graph.domains import Domain
from ..graph.network import Bond, BondGraph, Element, End, Junction, Kind, Law, MechanismNode, Node, Port, Switch
from ..scene import Plan, Scene
from ..source import Source, Span
from ..syntax import SyntaxTree, tree
from .connect import Connector
from .domain_table import slot_defaults, wall_items
from .elaborate import Elaborator
from .errors import (
    NoSingleModel,
    UnknownAttribute,
    UnknownName,
    WrongLaw,
    WrongMechanism,
    WrongValue,
)
from .events import read_events
from .experiments import choose_experiment, experiment_overrides, experiments_of, read_plan
from .known import Known
from .laws import CompiledLaw, compile_law, node_kind, plain_kind
from .load import Loader
from .mechanisms import build_mechanism
from .part_attributes import static_bounds
from .requirements import read_condition, read_requirements
from .resolve import MAXIMUM_MISTAKES
from .scope import AlreadyTold, Broken, ElementEntry, FileScope, ModelDefinition, Scope, Wrong, suggestion
from .starts import read_starts
from .transducers import expand_transducers
from .unconnected import unconnected


@dataclass(frozen=True, slots=True)
class Built:
    """A flat model and what its experiment plans."""

    graph: BondGraph
    plan: Plan
    files: tuple[Source, ...] = ()  # that were read besides the text itself
    positive: tuple[tuple[str, Bound], ...] = ()  # what is never negative, but only a run can tell


def build_graph(syntax: SyntaxTree, scene: Scene, library: Path | None = None) -> Built:
    """Open the model that a scene asks for. Raises `CompilationFailed` with everything that is wrong."""
    loader = Loader(library)
    file = loader.load(syntax)
    definition = choose_model(file, scene.model, loader.diagnostics)
    opened = _Opened.of(definition, scene, loader.diagnostics, False, Known())
    built = opened.built()
    if opened.elaborator.diagnostics:
        raise CompilationFailed(opened.elaborator.diagnostics)
    others = [scope for scope in loader.files.values() if scope is not file]
    sheets = [sheet.source for scope in (file, *others) for sheet in scope.sheets.values()]
    return replace(built, files=(*(scope.source for scope in others), *sheets))


@dataclass(frozen=True, slots=True)
class Checked:
    """What is wrong in a file; if nothing is, the model that would be run comes along, so that it is opened once."""

    diagnostics: list[Diagnostic]
    built: Built | None = None


def check_parts(
    syntax: SyntaxTree, library: Path | None = None, wanted: str | None = None, broken: frozenset[str] = frozenset()
) -> Checked:
    """What is wrong in any model of a file and its experiments, each looked at by itself.

    Ports may be open and parameters without value, but not in the model that would be run, if nothing else is wrong.
    `broken` names models of which lines could not be read: they are not looked at, and their instances tell nothing.
    """
    loader = Loader(library)
    file = loader.load(syntax)
    for name in broken:
        file.models.pop(name, None)
    file.missing |= broken
    diagnostics = list(loader.diagnostics)
    known = Known()
    main = None if diagnostics or broken else _main(file, wanted)
    whole: Built | None = None
    for definition in [d for d in file.models.values() if d.file is file]:
        if len(diagnostics) > MAXIMUM_MISTAKES:
            break
        opened = _Opened.of(definition, Scene(experiment=None), (), definition is not main, known)
        whole = opened.built() if definition is main else whole
        if definition is main and opened.elaborator.diagnostics:  # what only a run lacks is told if nothing else is
            whole, opened = None, _Opened.of(definition, Scene(experiment=None), (), True, known)
            opened.built()
        elif definition is not main:
            opened.built()
        diagnostics += opened.elaborator.diagnostics
        for experiment in experiments_of(definition).values():
            diagnostics += _check_experiment(opened, experiment, known)
    return Checked(diagnostics, None if diagnostics else whole)


def _main(file: FileScope, wanted: str | None) -> ModelDefinition | None:
    """The model that would be run; None for a file of parts."""
    try:
        chosen = choose_model(file, wanted, [])
    except CompilationFailed:
        return None
    return None if any(wall_items(chosen.model)) else chosen


def _check_experiment(opened: _Opened, experiment: tree.Experiment, known: Known) -> list[Diagnostic]:
    """What is wrong in an experiment. One that sets and sweeps nothing is read in the model as it is open already."""
    scene = Scene(experiment=experiment.name)
    if any(isinstance(s, tree.Set | tree.Study) for s in experiment.steps):
        other = _Opened.of(opened.definition, scene, (), True, Known())
        other.built()
        return other.elaborator.diagnostics
    elaborator = opened.elaborator
    before = len(elaborator.diagnostics)
    read_plan(elaborator, experiment, elaborator.root, scene)
    elaborator.integrals()
    return elaborator.diagnostics[before:]


def is_part(syntax: SyntaxTree, wanted: str | None) -> bool:
    """Whether the model that would be run has ports of its own. Raises `CompilationFailed` if there is none to run."""
    file = FileScope(syntax.source, {}, {}, {})
    file.models.update({n: ModelDefinition(m, file) for n, m in syntax.models.items()})
    return any(wall_items(choose_model(file, wanted, []).model))


def choose_model(file: FileScope, wanted: str | None, diagnostics: Sequence[Diagnostic]) -> ModelDefinition:
    """The model that is asked for, or the one that no other model of the file uses."""
    own = {n: d for n, d in file.models.items() if d.file is file}
    span = Span(file.source, 0, min(1, len(file.source.text)))
    if wanted is not None:
        if wanted in own:
            return own[wanted]
        hint = suggestion(wanted, list(own), f"It defines: {', '.join(own) or 'no model'}.")
        raise CompilationFailed([*diagnostics, UnknownName(span, wanted, "the models of the file", hint)])
    declarations = [d for m in own.values() for d in _declarations(m.model.statements)]
    used = {d.kind for d in declarations}
    used |= {name for m in own.values() for name in slot_defaults(m.model.statements).values()}
    used |= {a.value.words for d in declarations for a in d.attributes if isinstance(a.value, tree.Path)}
    free = [n for n in own if n not in used]
    if len(free) == 1:
        return own[free[0]]
    if not own:
        if diagnostics:
            raise CompilationFailed(diagnostics)
        raise CompilationFailed([NoSingleModel(span, "The file defines no model", "Write `model Name { … }`.")])
    if not free:  # all use each other: opening one finds the cycle
        return next(iter(own.values()))
    what = f"The file has several models to run: {', '.join(free)}"
    raise CompilationFailed(
        [*diagnostics, NoSingleModel(own[free[1]].model.name_span, what, f"Name one: `--model {free[0]}`.")]
    )


def _declarations(statements: tuple[tree.Node, ...]) -> list[tree.Declaration]:
    found = []
    for statement in statements:
        if isinstance(statement, tree.Declaration):
            found.append(statement)
        elif isinstance(statement, tree.Loop):
            found += _declarations(statement.statements)
    return found


@dataclass(frozen=True, slots=True)
class _Opened:
    """A model that has been opened for a scene: all its names are known, no law has been read yet."""

    definition: ModelDefinition
    scene: Scene
    experiment: tree.Experiment | None
    elaborator: Elaborator
    known: Known

    @staticmethod
    def of(
        definition: ModelDefinition, scene: Scene, earlier: Sequence[Diagnostic], part: bool, known: Known
    ) -> _Opened:
        experiment, told = choose_experiment(definition, scene.experiment)
        overrides = [*experiment_overrides(experiment), *scene.overrides]  # the command line comes last and wins
        elaborator = Elaborator(overrides, part, known)
        elaborator.diagnostics += [*earlier, *told]
        steps = experiment.steps if experiment is not None else ()
        elaborator.swept = tuple(s for s in steps if isinstance(s, tree.Study) and s.role == "sweep")
        elaborator.open_root(definition)
        return _Opened(definition, scene, experiment, elaborator, known)

    def built(self) -> Built:
        """Its flat graph and plan; what is wrong goes to the elaborator."""
        elaborator = self.elaborator
        for pending in elaborator.pending:
            elaborator.guard(elaborator.quantity, pending)
        nodes = _Nodes(elaborator, self.known)
        nodes.build()
        starts = read_starts(elaborator, self.experiment, elaborator.root, nodes.nodes)
        requirements = read_requirements(elaborator)
        events = read_events(elaborator, nodes.nodes)
        elaborator.integrals()  # which may read delays
        delays = elaborator.delays()
        plan, outputs = read_plan(elaborator, self.experiment, elaborator.root, self.scene)
        _check_overrides(elaborator, self.scene)
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
        return Built(graph, plan, positive=tuple(elaborator.positive))


def _check_overrides(elaborator: Elaborator, scene: Scene) -> None:
    settable = [p.name for p in elaborator.pending if p.role in ("parameter", "input")]
    roles = {p.name: p.role for p in elaborator.pending}
    lists = {n for n in elaborator.quantities if "[" in n}
    for path, override in elaborator.overrides.items():
        if path in elaborator.used_overrides:
            continue
        if path in roles and roles[path] not in ("parameter", "input"):
            elaborator.tell(
                UnknownName(
                    override.span,
                    path,
                    "what can be set",
                    f"It is a {roles[path]}; only parameters and inputs are set from outside.",
                )
            )
        elif not isinstance(elaborator.root.entries.get(path.split("[")[0].split(".")[0]), Broken):
            hint = suggestion(
                path,
                [*settable, *lists],
                f"Parameters and inputs: {', '.join(settable[:12])}{'…' if len(settable) > 12 else ''}.",
            )
            elaborator.tell(UnknownName(override.span, path, f"`{elaborator.root.definition.name}`", hint))
    for name in scene.free - {"*"}:
        if name not in elaborator.quantities:
            span = elaborator.root.definition.model.name_span
            elaborator.tell(UnknownName(span, name, "what can be set", suggestion(name, settable)))


class _Nodes:
    """Makes the nodes and bonds of the flat graph."""

    def __init__(self, elaborator: Elaborator, known: Known) -> None:
        self.elaborator = elaborator
        self.nodes: list[Node] = []
        self.bonds: list[Bond] = []
        self.switches: list[Switch] = []
        self.walls: dict[tuple[str, str], int] = {}
        self.ends: dict[tuple[str, str], End] = {}
        self._laws = known.laws
        self._interned = known.interned

    def build(self) -> None:
        elaborator = self.elaborator
        for scope, declaration, entry in elaborator.elements:
            before = len(self.nodes)
            elaborator.guard(self._element, scope, declaration, entry)
            if (
                len(self.nodes) == before and declaration.kind != "splitter"
            ):  # its law is wrong: its bonds can still be checked
                for number, port in enumerate(entry.ports):
                    self.ends[entry.name, port] = End(before, number)
                self.nodes.append(_placeholder(entry))
        connector = Connector(elaborator)
        connector.connect()
        for name, kind, domain, scope, span in connector.anonymous:
            self.ends[name, ""] = End(len(self.nodes), 0)
            self.nodes.append(Junction(name, Kind(kind), domain, f"{scope.definition.name}.{kind}(…)", span))
        self._mechanisms(connector)
        self.bonds = connector.bonds(self.ends)
        self.walls = connector.passed
        self._share_ports()
        expand_transducers(self.nodes, self.bonds)

    def _element(self, scope: Scope, declaration: tree.Declaration, entry: ElementEntry) -> None:
        if declaration.kind == "splitter":
            return
        index = len(self.nodes)
        definition = f"{scope.definition.name}.{entry.name.removeprefix(scope.path).split('[')[0]}"
        if declaration.kind in ("0", "1"):
            if isinstance(declaration.definition, tree.Law):
                raise Wrong(
                    WrongLaw(
                        declaration.definition.span,
                        f"The junction `{entry.name}` has a law",
                        "A junction has none: a 0-junction shares its effort, a 1-junction its flow.",
                    )
                )
            domain = next(iter(entry.ports.values()))
            self.ends[entry.name, ""] = End(index, 0)
            self.nodes.append(Junction(entry.name, Kind(declaration.kind), domain.name, definition, entry.span))
            for attribute in declaration.attributes:
                self._active(scope, attribute, entry)
            return
        compiled = self._law(scope, declaration, entry)
        arguments = tuple(self.elaborator.scalar_at(slot, scope).reference for slot in compiled.slots)
        ports = tuple(Port(n, d.name) for n, d in entry.ports.items())
        for number, port in enumerate(ports):
            self.ends[entry.name, port.name] = End(index, number)
        attributes = self._attributes(scope, declaration, entry, compiled.stored)
        kind = plain_kind(declaration.kind)
        self.nodes.append(
            Element(
                entry.name, node_kind(declaration.kind), kind != declaration.kind, ports, compiled.law, arguments, compiled.stored,
                attributes.starts, attributes.nominals, attributes.prefer, attributes.require, definition, entry.span,
            )
        )  # fmt: skip

    def _active(self, scope: Scope, attribute: tree.Attribute, entry: ElementEntry) -> None:
        """When a junction is on."""
        known = any(s.junction == entry.name for s in self.switches)
        if attribute.name != "active" or attribute.target is not None or known:
            raise Wrong(UnknownAttribute(attribute.span, entry.name, attribute.name, "A junction has `active`, once."))
        hint = "A junction is on where a condition holds: `active = not open`, `active = x > 0 m`."
        _, condition = read_condition(self.elaborator, attribute.value, scope, hint)
        self.switches.append(Switch(entry.name, condition, attribute.span))

    def _law(self, scope: Scope, declaration: tree.Declaration, entry: ElementEntry) -> CompiledLaw:
        elaborator = self.elaborator
        known = self._laws.setdefault(id(declaration), [])
        found = next((law for law in known if elaborator.same_lists(law.lists, scope)), None)
        if found is None:
            try:
                compiled = compile_law(
                    declaration, entry.name, entry.ports, scope, elaborator.resolve, elaborator.scalar_at
                )
            except Wrong:
                if elaborator.table_of(scope.definition).diagnostics:
                    raise AlreadyTold from None  # with a wrong domain its letters mean nothing
                raise
            found = replace(compiled, law=self._interned.setdefault(compiled.law, compiled.law))
            known.append(found)
        elaborator.check(found.checks, found.slots, scope)
        return found

    def _attributes(
        self, scope: Scope, declaration: tree.Declaration, entry: ElementEntry, stored: tuple[str, ...]
    ) -> _Attributes:
        result = _Attributes({}, {}, None, None)
        ports = list(entry.ports)
        for attribute in declaration.attributes:
            self.elaborator.guard(self._attribute, scope, attribute, entry, ports, stored, result)
        return result

    def _attribute(
        self,
        scope: Scope,
        attribute: tree.Attribute,
        entry: ElementEntry,
        ports: list[str],
        stored: tuple[str, ...],
        result: _Attributes,
    ) -> None:
        """One attribute of an element."""
        if attribute.name in ("start", "nominal") and stored:
            self._stored_value(scope, attribute, entry, ports, stored, result)
            return
        if attribute.name not in ("prefer", "require"):
            known = (["start", "nominal"] if stored else []) + ["prefer", "require"]
            hint = suggestion(attribute.name, known, f"`{entry.kind}` has: {', '.join(known)}.")
            raise Wrong(UnknownAttribute(attribute.span, entry.name, attribute.name, hint))
        word = attribute.value.words if isinstance(attribute.value, tree.Path) else attribute.value.span.words
        allowed = ["integral", "derivative", "effort", "flow"] if stored else ["effort", "flow"]
        if word not in allowed:
            hint = suggestion(word, allowed, f"It can be: {', '.join(allowed)}.")
            raise Wrong(WrongValue(attribute.value.span, attribute.name, entry.name, word, hint))
        if attribute.name == "prefer":
            result.prefer = word
        else:
            result.require = word

    def _stored_value(
        self,
        scope: Scope,
        attribute: tree.Attribute,
        entry: ElementEntry,
        ports: list[str],
        all_stored: tuple[str, ...],
        result: _Attributes,
    ) -> None:
        words = attribute.target.words if attribute.target is not None else ""
        port, letter = ("", words) if ports == [""] else (words.partition(".")[0], words.partition(".")[2])
        domain: Domain | None = entry.ports.get(port)
        stored = all_stored[ports.index(port) if port in ports else 0]
        variable = None if domain is None else (domain.variable(letter) if letter else stored)
        allowed = stored + {"q": "e", "p": "f"}[stored]
        if (
            domain is None
            or variable is None
            or variable not in allowed
            or (attribute.name == "nominal" and variable != stored)
        ):
            names = [f"{p}.{d.letter(v)}" if p else d.letter(v) for p, d in entry.ports.items() for v in allowed]
            raise Wrong(
                UnknownAttribute(
                    attribute.span,
                    entry.name,
                    f"{attribute.name} {words}".strip(),
                    f"Write `{attribute.name} {names[0]} = …`; it can name: {', '.join(names)}.",
                )
            )
        (bound,) = static_bounds(
            self.elaborator, attribute.value, scope, domain.dimension(variable), f"`{attribute.name} {words}`", 1
        )
        target = result.starts if attribute.name == "start" else result.nominals
        number = ports.index(port)
        if number in target:
            raise Wrong(UnknownAttribute(attribute.span, entry.name, f"{attribute.name} {words}", "It is given twice."))
        target[number] = (variable, bound)

    def _mechanisms(self, connector: Connector) -> None:
        elaborator = self.elaborator
        for scope, statement, entry in elaborator.mechanisms:
            mechanism = build_mechanism(elaborator, scope, statement, entry)
            used = dict.fromkeys(
                t.port for s in connector.segments for t in (s.tail, s.head) if t.node == entry.name and not t.side
            )
            ports = tuple(Port(p, elaborator.port_domain(entry.name, p).name) for p in used)
            for number, port in enumerate(ports):
                self.ends[entry.name, port.name] = End(len(self.nodes), number)
            if not mechanism.bodies and not elaborator.diagnostics:
                elaborator.tell(
                    WrongMechanism(
                        statement.span,
                        f"The mechanism `{entry.name}` has no body",
                        "Declare what moves: `body name { mass = … }`.",
                    )
                )
            self.nodes.append(
                MechanismNode(
                    entry.name,
                    Kind.MECHANISM,
                    ports,
                    mechanism,
                    f"{scope.definition.name}.{statement.name}",
                    entry.span,
                )
            )

    def _share_ports(self) -> None:
        """A part of a mechanism takes any number of bonds, which share its flow: a 1-junction stands there if they are several."""
        by_port: dict[End, list[int]] = {}
        for number, bond in enumerate(self.bonds):
            for end in (bond.tail, bond.head):
                if isinstance(self.nodes[end.node], MechanismNode):
                    by_port.setdefault(end, []).append(number)
        for end, numbers in by_port.items():
            if len(numbers) < 2:
                continue
            node = self.nodes[end.node]
            assert isinstance(node, MechanismNode)
            port = node.ports[end.port]
            junction = End(len(self.nodes), 0)
            self.nodes.append(Junction(f"{node.name}.{port.name}", Kind.ONE, port.domain, node.definition, node.span))
            for number in numbers:
                bond = self.bonds[number]
                moved = (
                    Bond(junction, bond.head, bond.domain, bond.span)
                    if bond.tail == end
                    else Bond(bond.tail, junction, bond.domain, bond.span)
                )
                self.bonds[number] = moved
            first = self.bonds[numbers[0]]
            self.bonds.append(Bond(junction, end, port.domain, first.span))


@dataclass(slots=True)
class _Attributes:
    starts: dict[int, tuple[str, Bound]]
    nominals: dict[int, tuple[str, Bound]]
    prefer: str | None
    require: str | None


def _placeholder(entry: ElementEntry) -> Node:
    """Stands for what is wrong, so that its bonds can be checked; the graph is never used."""
    if entry.kind in ("0", "1"):
        return Junction(entry.name, Kind(entry.kind), next(iter(entry.ports.values())).name, "", entry.span)
    ports = tuple(Port(n, d.name) for n, d in entry.ports.items())
    kind = node_kind(entry.kind)
    return Element(entry.name, kind, False, ports, Law((), None, 0), (), (), {}, {}, None, None, "", entry.span)
