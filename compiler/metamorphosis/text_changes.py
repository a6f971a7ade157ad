"""Changes of a whole text that keep its meaning: a table of functions of the text and a seed, from statements to statements and names."""

from __future__ import annotations

import keyword
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any

from ..errors import CompilationFailed
from ..graph.domains import DOMAINS, GENERIC
from ..semantics.names.declared_names import DeclaredName, model_name, table_of
from ..semantics.names.domain_table import paths_of, slot_defaults
from ..semantics.names.name_uses import name_uses, name_uses_in_path
from ..semantics.names.scope import RESERVED, ModelDefinition
from ..source import Source
from ..syntax import parse_expression, tree
from ..syntax.blocks import Statements, with_inner_blocks
from .bonds import exploded, turned
from .printing import NOWHERE, path, path_text, rewrite, statement, text_of
from .renaming import as_file, bundled, has_branches, in_other_words
from .scaling import InBases, Powers


def enclosed(
    statements: Statements, model: str, experiment: str | None, outputs: tuple[str, ...], copies: int | None
) -> Changed:
    """The model as an instance of a new one, or as an array; inputs go in, outputs come out."""
    definition = as_file(statements).models[model]
    instances = ["inner"] if copies is None else [f"inner[{j}]" for j in range(1, copies + 1)]
    declared = [s for s in definition.model.statements if isinstance(s, tree.Quantities) and s.role == "input"]
    inputs = [i for s in declared for i in s.items if i.index is None and not _reads(definition, i.value)]
    passed, names = {i.name for i in inputs}, table_of(definition.model)

    def outer(node: tree.SyntaxNode) -> Any:
        """An expression of the model, read outside of it."""

        def change(part: object) -> object:
            if isinstance(part, tree.PathSyntax) and part.head in names and part.head not in passed:
                return path(f"{instances[0]}.{path_text(part)}")
            return part

        return rewrite(node, change)

    bindings = " { " + ", ".join(f"{i} = {i}" for i in sorted(passed)) + " }" if passed else ""
    lines = [statement(replace(s, items=tuple(inputs)), "  ") for s in declared[:1] if inputs]
    if copies is None:
        lines.append(f"  {model} inner{bindings}")
    else:
        lines.append(f"  for round in 1..{copies} {{ {model} inner[round]{bindings} }}")
    for j, instance in enumerate(instances):
        lines += [f"  output result_{k}_{j} = {instance}.{name}" for k, name in enumerate(outputs)]
    for s in definition.model.statements:
        if isinstance(s, tree.Experiment) and s.name == experiment:
            lines.append(statement(replace(s, steps=tuple(_steps(s, definition, passed, instances, outer))), "  "))
    text = text_of(statements) + f"{'plain ' * definition.model.plain}model Outer {{\n" + "\n".join(lines) + "\n}\n"
    numbers = {name: k for k, name in enumerate(outputs)}
    return Changed(
        text, "Outer", experiment,
        lambda name: tuple(f"result_{numbers[name]}_{j}" for j in range(len(instances))),
        lambda name: tuple(f"{instance}.{name}" for instance in instances),
        len(instances),
    )  # fmt: skip


def _reads(definition: ModelDefinition, value: tree.ExpressionSyntax | None) -> bool:
    return value is not None and any(p.head in table_of(definition.model) for p in paths_of(value))


def _steps(
    experiment: tree.Experiment,
    definition: ModelDefinition,
    passed: set[str],
    instances: list[str],
    outer: Callable[[tree.SyntaxNode], Any],
) -> Iterator[tree.SyntaxNode]:
    """Settings and duration of the experiment, as steps of the outer model."""
    for step in experiment.steps:
        if isinstance(step, tree.Set):
            if step.target.head in passed:
                yield replace(step, value=outer(step.value))
                continue
            for instance in instances:
                target = path(f"{instance}.{path_text(step.target)}")
                yield replace(step, target=target, value=outer(step.value))
        elif isinstance(step, tree.Simulate):
            own = tuple(replace(a, value=outer(a.value)) for a in step.attributes if a.target is None)
            yield replace(step, range=outer(step.range), attributes=own)
        elif isinstance(step, tree.Bandwidth):
            yield replace(step, value=outer(step.value))
        elif isinstance(step, tree.StopSyntax):
            yield replace(step, condition=outer(step.condition))
        elif isinstance(step, tree.Analysis) and step.role == "equilibrium":  # the run begins there
            yield replace(step, attributes=())


@dataclass(frozen=True, slots=True)
class TextScene:
    """A text as statements, the model and the experiment in it that are run, and the outputs that are compared."""

    statements: Statements
    model: str
    experiment: str | None
    outputs: tuple[str, ...]

    @property
    def plain(self) -> bool:
        """True if numbers have no units in one of the models."""
        return any(isinstance(s, tree.ModelSyntax) and s.plain for s in self.statements)

    def with_statements(self, statements: Statements) -> Changed:
        """A text whose names are those of this one."""
        return Changed(text_of(statements), self.model, self.experiment)

    @property
    def text(self) -> str:
        """The text, statement by statement."""
        return text_of(self.statements)


@dataclass(frozen=True, slots=True)
class TextChange:
    """A changed text, and the factor by which a quantity in a unit of SI grows with the change."""

    changed: Changed
    factor: Callable[[str], float] = field(default=lambda unit: 1.0)


class Inapplicable(Exception):
    """A change that cannot be made of a text."""


def _units(scene: TextScene, seed: int) -> TextChange:
    if scene.plain:
        raise Inapplicable("bare numbers have no units")
    powers = Powers(seed)
    return TextChange(scene.with_statements(powers.scaled(scene.statements)), powers.of_unit)


def _bases(scene: TextScene, seed: int) -> TextChange:
    if scene.plain:
        raise Inapplicable("bare numbers have no units")
    return TextChange(scene.with_statements(InBases().scaled(scene.statements)))


def _wrapped(scene: TextScene, seed: int) -> TextChange:
    return TextChange(enclosed(scene.statements, scene.model, scene.experiment, scene.outputs, None))


# word -> (what is changed, the change)
TEXT_CHANGES: dict[str, tuple[str, Callable[[TextScene, int], TextChange]]] = {
    "one text": ("imports in one text", lambda scene, seed: TextChange(scene.with_statements(scene.statements))),
    "units": ("length, mass, time, charge, temperature and amount in other units", _units),
    "SI": ("every number in the base units of SI", _bases),
    "order": (
        "declarations in another order",
        lambda scene, seed: TextChange(scene.with_statements(permuted(scene.statements, seed))),
    ),
    "names": (
        "other names",
        lambda scene, seed: TextChange(Rename(scene.statements, seed).changed(scene.model, scene.experiment)),
    ),
    "bonds": ("one bond a line", lambda scene, seed: TextChange(scene.with_statements(exploded(scene.statements)))),
    "reversed bonds": (
        "bonds reversed with their signs",
        lambda scene, seed: TextChange(scene.with_statements(turned(exploded(scene.statements)))),
    ),
    "wrapped": ("the model as an instance of another", _wrapped),
}


def scene_of(
    source: Source, library: Path, names: tuple[str, str | None], outputs: tuple[str, ...], settings: Mapping[str, str]
) -> TextScene:
    """A file with its imports as one text, whose experiment has these settings, and these starts (`start NAME`); `names` of the model and the experiment.

    Raises `Inapplicable` for settings without an experiment.
    """
    scene = TextScene(bundled(source, library), *names, outputs)
    if not settings:
        return scene
    if scene.experiment is None:
        raise Inapplicable("settings are written into an experiment, and there is none")
    steps_given = {_step_of(name): text for name, text in settings.items()}
    new = tuple(
        tree.Set(NOWHERE, w, path(n), parse_expression(Source(n, text))) for (w, n), text in steps_given.items()
    )

    def steps(experiment: tree.Experiment) -> tuple[tree.SyntaxNode, ...]:
        return (
            *new,
            *(
                s
                for s in experiment.steps
                if not (isinstance(s, tree.Set) and (s.role, path_text(s.target)) in steps_given)
            ),
        )

    def inside(model: tree.ModelSyntax) -> tree.ModelSyntax:
        changed = (
            replace(s, steps=steps(s)) if isinstance(s, tree.Experiment) and s.name == scene.experiment else s
            for s in model.statements
        )
        return replace(model, statements=tuple(changed))

    own = (inside(s) if isinstance(s, tree.ModelSyntax) and s.name == scene.model else s for s in scene.statements)
    return replace(scene, statements=tuple(own))


def _step_of(name: str) -> tuple[str, str]:
    """Word and name of the step of an experiment that a setting or a start is."""
    word, _, rest = name.partition(" ")
    return ("start", rest.strip()) if word == "start" and rest else ("set", name)


def same(name: str) -> tuple[str, ...]:
    """A name that stays."""
    return (name,)


@dataclass(frozen=True, slots=True)
class Changed:
    """A changed text, and the names in it of outputs and states of the first text: more than one name if there are copies."""

    text: str
    model: str
    experiment: str | None
    outputs: Callable[[str], tuple[str, ...]] = same
    states: Callable[[str], tuple[str, ...]] = same
    copies: int = 1


# ---------------------------------------------------------------- renaming

# Words that mean something in Python, C, numpy, sympy, to a solver, or elsewhere in this language, and nothing as a name.
HARD = [
    *(w for w in keyword.kwlist if w not in RESERVED), *keyword.softkwlist, "lambda_", "int", "float", "double", "struct", "void",
    "static", "volatile", "np", "numpy", "math", "sympy", "E", "S", "N", "O", "Q", "I", "oo", "zoo", "nan", "inf", "NaN", "Symbol",
    "beta", "gamma", "zeta", "self", "cls", "print", "list", "tuple", "exec", "eval", "t", "y", "x0", "x1", "u", "k1", "dt", "jac",
    "y0", "state", "inputs", "constants", "mode_", "result", "derivative", "output_", "_", "__", "___", "__name__", "__class__",
    "set", "start", "simulate", "report", "sweep", "modes", "response", "equilibrium", "nominal", "prefer", "require", "rtol",
    "points", "tolerance", "body", "hinge", "slide", "weld", "free", "frame", "gravity", "C", "R", "Se", "Sf", "TF", "GY", "splitter",
    "sin", "exp", "abs", "step", "polar", "integral", "min", "max", "mm", "kg", "V", "deg", "Hz", "dB", "electric", "planar",
    "energy", "electron", "ln", "And", "Or", "Not", "Piecewise", "Function", "re", "im", "errno", "main", "NULL", "EOF", "X" * 60,
]  # fmt: skip
LETTERS = frozenset(
    f"{letter}{side}"
    for d in DOMAINS.values()
    for letter in (*d.letters, *GENERIC)
    if letter
    for side in ("", "1", "2")
)
FREEDOMS = frozenset({"x", "y", "phi", "z", "rx", "ry", "rz", "ground"})

KINDS_AND_FUNCTIONS = frozenset(
    {"C", "R", "I", "Se", "Sf", "TF", "GY", "splitter", "body", "hinge", "slide", "weld", "free", "frame"}
    | {"sin", "exp", "abs", "step", "polar", "integral", "min", "max"}
)


class Rename:
    """Gives every declared name a new word, different from all others."""

    def __init__(self, statements: Statements, seed: int) -> None:
        random = Random(seed)
        self.file = as_file(statements)
        self.pool = [w for w in dict.fromkeys(HARD) if w not in LETTERS | FREEDOMS | RESERVED]
        random.shuffle(self.pool)
        self.random = random
        self.words: dict[object, str] = {}
        # What stands in a slot, or under one name in two branches of an `if`, shares its names.
        models = [d.model for d in self.file.models.values()]
        shared = any(slot_defaults(model.statements) or has_branches(model) for model in models)
        self.by_word = bool(self.file.file.sets) or shared

    def choose(self, name: DeclaredName) -> str:
        key = name.name if self.by_word and name.owner else name
        if key not in self.words:
            for position, word in enumerate(self.pool):
                if name.owner or word not in KINDS_AND_FUNCTIONS:
                    self.words[key] = self.pool.pop(position)
                    break
            else:
                self.words[key] = f"{name.name}_{self.random.randrange(10**6)}_{len(self.words)}"
        return self.words[key]

    def changed(self, model: str, experiment: str | None) -> Changed:
        definition = self.file.models[model]
        uses = list(name_uses(self.file.file, self.file.statements))
        text = in_other_words(self.file.file.source.text, uses, self.choose)
        names = (use.name for use in uses if use.name is not None and use.name.kind == "experiment")
        steps = {name.name: self.choose(name) for name in names if name.owner[0] == model}

        def word(name: str) -> tuple[str, ...]:
            try:
                read = path(name)
            except CompilationFailed:  # an integral without a name of the author's
                return (name,)
            return (in_other_words(name, name_uses_in_path(definition, read), self.choose),)

        step = None if experiment is None else steps[experiment]
        return Changed(text, self.choose(model_name(definition)), step, word, word)


# ---------------------------------------------------------------- order


def permuted(statements: Statements, seed: int) -> Statements:
    """All declarations in another order: statements of each scope, names of a statement, bonds of a fan, equations, attributes."""
    random = Random(seed)

    def shuffled(items: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(random.sample(items, len(items)))

    def change(node: object) -> Any:
        match node:
            case tree.ModelSyntax() | tree.LoopSyntax() | tree.MechanismSyntax():
                return replace(node, statements=shuffled(node.statements))
            case tree.ConditionalSyntax():
                return with_inner_blocks(node, shuffled)
            case tree.Experiment() if not any(
                isinstance(s, tree.Analysis) for s in node.steps
            ):  # a run begins where they end
                return replace(node, steps=shuffled(node.steps))
            case tree.Quantities():
                return replace(node, items=shuffled(node.items), equations=shuffled(node.equations))
            case tree.ParameterSet():
                return replace(node, items=shuffled(node.items))
            case tree.PortsSyntax():
                return replace(node, items=shuffled(node.items))
            case tree.Declaration():
                law = node.definition
                if isinstance(law, tree.LawSyntax):
                    law = replace(law, equations=shuffled(law.equations))
                return replace(node, names=shuffled(node.names), attributes=shuffled(node.attributes), definition=law)
            case tree.Declared() | tree.PortItem() if node.components:
                return node  # the last port of an RS is its heat
            case tree.Bonds():
                return replace(node, places=tuple(map(shuffled, node.places)))
            case tree.Nest():
                return replace(node, members=shuffled(node.members))
            case tree.Simulate():
                return replace(node, attributes=shuffled(node.attributes))
        return node

    return shuffled(rewrite(statements, change))
