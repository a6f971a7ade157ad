"""Changes of a text that keep its meaning: statements to statements, and the names after the change."""

from __future__ import annotations

import keyword
from collections.abc import Callable
from dataclasses import dataclass, replace
from random import Random
from typing import Any

from ..errors import CompilationFailed
from ..graph.domains import DOMAINS, GENERIC
from ..semantics.names.declared_names import DeclaredName, model_name
from ..semantics.names.domain_table import slot_defaults
from ..semantics.names.name_uses import name_uses, name_uses_in_path
from ..semantics.names.scope import RESERVED
from ..syntax import tree
from ..syntax.blocks import Statements, with_inner_blocks
from .printing import path, rewrite
from .renaming import as_file, has_branches, in_other_words


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
