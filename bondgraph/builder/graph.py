"""A model under construction.

g = Graph("Oscillator")
m, k = g.parameter("m", 1, "kg"), g.parameter("k", 100, "N/m")
push = g.Se("push", "F = 1 N*step(time - 0.1 s)")
body = g.one("body", "translation")
mass = g.I("mass", f"p = {m}*v")
spring = g.C("spring", f"F = {k}*x", start={"x": "1 mm"})
push >> body >> (mass, spring)
g.output("position", f"{spring}.x")
g.model().simulate(to="5 s")
print(g.text())
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, TypedDict, Unpack

from compiler.api import Diagnostic, Source, bond_lines, braces, check_source

from ..compiled_model import LIBRARY, CompiledModel
from ..errors import UsageError
from ..keywords import check_keywords
from ..model import Model
from ..simulation.integrators.methods import chosen_solver
from .argument_checks import (
    Value,
    description_of,
    is_one_number,
    law_of,
    literal_of,
    mapping_of,
    path_of,
    unit_of,
    value_of,
)
from .elements import Elements
from .mechanism import Multibody
from .parts import NamedQuantity, Part, model_name_of, name_of


class SimulationOptions(TypedDict, total=False):
    """Options of the run that an experiment has."""

    points: int | None
    rtol: float | None
    solver: str | None
    bandwidth: Value | None
    stop_when: Value | None


class Graph(Elements):
    """One model under construction, statement by statement.

    `plain`: bare numbers without units. `folder`: folder of imported files. Raises `UsageError` or `CompilationFailed` for arguments that are not valid
    at their place.
    """

    def __init__(self, name: str, description: str = "", *, plain: bool = False, folder: str | Path | None = None) -> None:  # fmt: skip
        self.name = model_name_of(name)
        self.description = description_of(description)
        self.plain = plain
        self.folder = None if folder is None else Path(folder)
        self._names: dict[str, set[str]] = {}  # name without index -> used indices
        self._quantities: list[str] = []
        self._outputs: list[str] = []
        self._parts: list[str] = []
        self._events: list[str] = []
        self._mechanisms: list[Multibody] = []
        self._bonds: list[tuple[str, str, str]] = []
        self._experiments: dict[str, list[str]] = {}
        self._imports: dict[tuple[str, str], None] = {}  # (model, path as in the text)
        self._files: list[Path] = []
        self._inner: dict[str, Graph | Source] = {}  # models before this one in the text, by name

    def __repr__(self) -> str:
        return f"<bondgraph builder {self.name}: {len(self._parts) + len(self._mechanisms)} parts, {len(self._bonds)} bonds>"

    def _repr_html_(self) -> str:
        """Return the current model for notebooks, or its errors."""
        return self.model()._repr_html_()

    # ------------------------------------------------------------ quantities
    def parameter(self, name: str, value: Value = None, unit: str = "", description: str = "") -> NamedQuantity:
        """Add a parameter: fixed before a run and set from outside. A number is in `unit`, a text has its own: `parameter("k", "2 [kN/m]")`."""
        return self._quantity("parameter", name, value, unit, description)

    def constant(self, name: str, value: Value, unit: str = "", description: str = "") -> NamedQuantity:
        """Add a constant: as a parameter, but not to be set."""
        return self._quantity("constant", name, value, unit, description)

    def input(self, name: str, value: Value = 0.0, unit: str = "", description: str = "") -> NamedQuantity:
        """Add an input: a signal from outside; `value` is its default."""
        return self._quantity("input", name, value, unit, description)

    def signal(self, name: str, value: Value, unit: str = "", description: str = "") -> NamedQuantity:
        """Add a name for an expression: `signal("force", "c*volt^2")`, `signal("h", "integral(ball.v, 1 m)")`."""
        return self._quantity("signal", name, value, unit, description)

    def mode(self, name: str, value: Value, unit: str = "", description: str = "") -> NamedQuantity:
        """Add a discrete variable that only events change, a number or a truth value; `value` is its start: `mode("resting", "false")`."""
        return self._quantity("mode", name, value, unit, description)

    def solve(self, name: str, law: str, guess: Value = None, unit: str = "", description: str = "") -> NamedQuantity:
        """Add a number that makes an equation true, near a guess: `solve("x", "x^3 + a*x = b", 1, "m")`. Those of several equations read one another."""
        return self._quantity(f"solve {law_of(law, f'the equation of `{name}`')} for", name, guess, unit, description)

    def output(self, name: str, value: Value, unit: str = "", description: str = "") -> NamedQuantity:
        """Add an output: a signal that runs report: `output("position", "spring.x")`."""
        return self._quantity("output", name, value, unit, description)

    def _quantity(self, role: str, name: str, value: Value, unit: str, description: str) -> NamedQuantity:
        own = name_of(name)
        if unit and self.plain:
            raise UsageError("BR517", f"`{own}`: a plain graph has no units")
        text = f"{role} {own}"
        if unit:
            text += f": {unit_of(unit, f'the unit of `{own}`')}"
        if value is not None:
            text += f" = {value_of(value, f'the value of `{own}`', unit, declared=True)}"
        text += literal_of(description)
        quantity = NamedQuantity(self, self._enter(own))
        (self._outputs if role == "output" else self._quantities).append(text)
        return quantity

    # ------------------------------------------------------------ parts
    def _add(self, name: str, statement: str, ports: tuple[str, ...] | None) -> Part:
        part = Part(self, self._enter(name), ports)
        self._parts.append(statement)
        return part

    def multibody(self, name: str, *, spatial: bool = False, gravity: Sequence[Value] | None = None) -> Multibody:
        """Add a planar or spatial mechanism: `stage = g.multibody("stage")`, then `stage.body(…)`, `stage.slide(…)`."""
        lines = [] if gravity is None else [f"gravity = {value_of(gravity, 'gravity', 'm/s^2')}"]
        mechanism = Multibody(self, self._enter(name), lines, spatial)
        self._mechanisms.append(mechanism)
        return mechanism

    def when(self, condition: Value, sets: Mapping[Any, Value]) -> None:
        """Add an event at the instant a condition becomes true: `when("height < 0 m", {"mass.v": "-0.8*mass.v"})`."""
        self._event(f"when {value_of(condition, 'a condition')}", sets)

    def every(
        self, period: Value, sets: Mapping[Any, Value] | Sequence[tuple[Any, Value]], *,
        offset: Value | None = None, delay: Value | None = None, jitter: Value | None = None, seed: int | None = None,
    ) -> None:  # fmt: skip
        """Add an event at each multiple of a time, so much later by an offset: `every("1 ms", {"command": "2*(1 - angle)"}, offset="0.2 ms")`.

        `sets` are its lines, in order; pairs may set one thing twice. A number is in s. `delay`: what it sets takes effect so much later.
        """
        unit = "" if self.plain else "s"
        timing = {"offset": (offset, unit), "delay": (delay, unit), "jitter": (jitter, unit), "seed": (seed, "")}
        words = [f"{w} {value_of(x, f'the {w} of a sample', u)}" for w, (x, u) in timing.items() if x is not None]
        self._event(" ".join([f"every {value_of(period, 'a period', unit)}", *words]), sets)

    def _event(self, told: str, sets: Mapping[Any, Value] | Sequence[tuple[Any, Value]]) -> None:
        pairs = sets if isinstance(sets, list | tuple) else mapping_of(sets, "what is set").items()
        inner = "; ".join(f"{path_of(n)} = {value_of(v, f'what `{told}` sets')}" for n, v in pairs)
        self._events.append(f"{told} {{ {inner} }}")

    # ------------------------------------------------------------ models within models
    def instance(self, name: str, model: CompiledModel | Graph | NamedQuantity | str, /, **values: Value) -> Part:
        """Add an instance of another model, with its parameters and inputs; `instance["port"]` is one of its ports.

        `model` is a `Graph`, a model from `bondgraph.load` (`load("mems.bg", "CombDrive")`; a file is imported, a text is copied), a model of the shipped
        library by its path, "electric.Diode", or a slot of this graph.
        """
        own = self._free(name)
        given = {
            name_of(n): None if isinstance(v, Graph | CompiledModel) else value_of(v, f"`{n}` of `{own}`")
            for n, v in values.items()
        }
        kind = self._use(model)
        # slots are set to models
        inner = [f"{n} = {self._use(values[n]) if v is None else v}" for n, v in given.items()]
        return self._add(own, f"{kind} {own}{braces(inner)}", None)

    def slot(self, name: str, default: CompiledModel | Graph | str) -> NamedQuantity:
        """Add a slot: an instance of this graph may replace it by another model with the same ports."""
        own = self._free(name)
        self._quantities.append(f"parameter {own}: model = {self._use(default)}")
        return NamedQuantity(self, self._enter(own))

    def _use(self, model: CompiledModel | Graph | NamedQuantity | str) -> str:
        """Return the name of a model that this one uses, and add the necessary text."""
        if isinstance(model, NamedQuantity):
            return model.name
        if isinstance(model, str):
            place, dot, kind = model.rpartition(".")
            if not dot:
                raise UsageError("BR518", f"{model!r} is no model of the library:", "write its path, `electric.Diode`")
            self._imports[name_of(kind), name_of(place)] = None
            return kind
        if isinstance(model, Graph):
            if model is self or self in model._within():
                raise UsageError("BR519", f"`{self.name}` cannot contain itself")
            return self._copy(model.name, model)
        if not isinstance(model, CompiledModel):
            raise UsageError("BR520", f"an instance is one of a model, not of {model!r}")
        kind = _model_of(model)
        return self._copy(kind, model.source) if model.source.path is None else self._import(kind, model.source.path)

    def _copy(self, kind: str, model: Graph | Source) -> str:
        """Add a model to the same text."""
        if kind == self.name or self._inner.get(kind, model) != model:
            raise UsageError("BR521", f"`{self.name}` already uses another model `{kind}`")
        self._inner[kind] = model
        return kind

    def _import(self, kind: str, file: Path) -> str:
        """Import a model from a file, with a path relative to the folder of this one."""
        path = file.resolve()
        self.folder = self.folder if self.folder is not None else path.parent
        place = Path(os.path.relpath(path, self.folder.resolve())).as_posix()
        self._imports[kind, literal_of(place).strip()] = None
        self._files.append(path)
        return kind

    def _within(self) -> list[Graph]:
        """Return the graphs inside this one, at any depth."""
        direct = [g for g in self._inner.values() if isinstance(g, Graph)]
        return direct + [deeper for g in direct for deeper in g._within()]

    # ------------------------------------------------------------ bonds
    def bond(self, *places: object) -> None:
        """Add half arrows from each place to the next; several places in parallel are a sequence."""
        self._arrows("->", places)

    def multibond(self, *places: object) -> None:
        """Add the same with multibonds: all ports of a splitter, joint, body or port at once, by name."""
        self._arrows("=>", places)

    def _arrows(self, arrow: str, places: tuple[Any, ...]) -> None:
        if len(places) < 2:
            raise UsageError("BR522", "a bond has two ends")
        groups = [self._group(p) for p in places]
        for tails, heads in pairwise(groups):
            if len(tails) > 1 and len(heads) > 1:
                raise UsageError(
                    "BR523", "a bond from several places to several places: which goes to which is not guessed"
                )
        for tails, heads in pairwise(groups):
            self._bonds += [(tail, arrow, head) for tail in tails for head in heads]

    def _group(self, places: object) -> list[str]:
        if isinstance(places, Sequence) and not isinstance(places, str):
            return [self._place(p) for p in places]
        return [self._place(places)]

    def _place(self, place: object) -> str:
        if isinstance(place, str):
            return path_of(place)
        if not isinstance(place, Part | Multibody):
            raise UsageError("BR524", f"a bond reaches parts, not {place!r}")
        if place.graph is not self:
            raise UsageError("BR525", f"`{place}` belongs to the graph `{place.graph.name}`, not to `{self.name}`")
        return str(place)

    # ------------------------------------------------------------ experiments
    def experiment(
        self, name: str, to: Value, *, settings: Mapping[Any, Value] | None = None,
        report: Mapping[Any, str] | Sequence[Any] | NamedQuantity = (), **options: Unpack[SimulationOptions],
    ) -> None:  # fmt: skip
        """Add a run from 0 to `to` (a number is in s) with `settings`; `report={"position": "mm"}` names outputs and their units.

        `options`: `points`, `rtol`, `solver`, `bandwidth` (a number is in Hz): faster modes need not be followed, and `stop_when`, a condition that ends it.
        """
        check_keywords(self.experiment, options, SimulationOptions.__optional_keys__)
        solver, bandwidth = options.get("solver"), options.get("bandwidth")
        own = name_of(name)
        if own in self._experiments:
            raise UsageError("BR526", f"`{self.name}` already has an experiment `{own}`")
        lines = [
            f"set {path_of(n)} = {value_of(v, f'`{n}` in `{own}`')}"
            for n, v in mapping_of(settings or {}, "`settings`").items()
        ]
        given = {"points": options.get("points"), "rtol": options.get("rtol")}
        inner = [f"{word} = {value_of(v, f'`{word}` of `{own}`')}" for word, v in given.items() if v is not None]
        if solver is not None:
            inner.append(f"solver = {chosen_solver(solver)}")
        end = value_of(to, f"the end of `{own}`", "" if self.plain else "s")
        lines.append(f"simulate 0 .. {end if is_one_number(end) else f'({end})'}{braces(inner)}")
        if bandwidth is not None:
            lines.append(f"bandwidth {value_of(bandwidth, f'the bandwidth of `{own}`', '' if self.plain else 'Hz')}")
        if options.get("stop_when") is not None:
            lines.append(f"stop when {value_of(options['stop_when'], f'what ends `{own}`')}")
        listed = [report] if isinstance(report, str | NamedQuantity) else report
        wanted = listed if isinstance(listed, Mapping) else dict.fromkeys(listed, "")
        for what, unit in wanted.items():
            reading = value_of(what, f"what `{own}` reports")
            lines.append(f"report {reading}" + (f" in {unit_of(unit, f'the unit of {reading}')}" if unit else ""))
        self._experiments[own] = lines

    # ------------------------------------------------------------ what comes of it
    def text(self) -> str:
        """Return the model as .bg text, with the models that it contains."""
        imports: dict[tuple[str, str], None] = {}
        models: dict[Graph | Source, str] = {}
        self._collect(imports, models)
        head = "".join(f"import {kind} from {place}\n" for kind, place in imports)
        return "\n".join([head, *models.values()] if head else models.values())

    def _collect(self, imports: dict[tuple[str, str], None], models: dict[Graph | Source, str]) -> None:
        """Collect the texts of this model and of those in it, inner ones first."""
        for inner in self._inner.values():
            if isinstance(inner, Graph):
                inner._collect(imports, models)
            else:
                models[inner] = inner.text.rstrip() + "\n"
        imports.update(self._imports)
        models[self] = self._model_text()

    def _model_text(self) -> str:
        mechanisms = [line for m in self._mechanisms for line in m.text()]
        blocks = [
            [literal_of(self.description).strip()] if self.description else [],
            self._quantities, [*self._parts, *mechanisms], list(bond_lines(self._bonds)), self._events, self._outputs,
            *([f"experiment {n} {{", *(f"  {line}" for line in lines), "}"] for n, lines in self._experiments.items()),
        ]  # fmt: skip
        body = "\n\n".join("\n".join(f"  {line}" for line in lines) for lines in blocks if lines)
        return f"{'plain ' * self.plain}model {self.name} {{\n{body}\n}}\n"

    def _source(self) -> Source:
        graphs = [self, *self._within()]
        folders = {g.folder.resolve() for g in graphs if g.folder is not None}
        if len(folders) > 1:
            listed = ", ".join(sorted(map(str, folders)))
            raise UsageError("BR527", f"graphs in each other need one folder for what they import, not {listed}")
        name = f"{self.name}.bg"
        if not folders:
            return Source(name, self.text())
        path = folders.pop() / name
        while any(path in g._files for g in graphs):  # a file of this name is imported: choose another name
            path = path.with_name(f"_{path.name}")
        return Source(name, self.text(), path)

    def model(self) -> Model:
        """Return the model, as if it had been read from text. Semantic errors are raised at its first use."""
        return Model(self._source(), self.name)

    def check(self) -> tuple[Diagnostic, ...]:
        """Return all errors of the model; empty if there are none."""
        return tuple(check_source(self._source(), self.name, LIBRARY))

    # ------------------------------------------------------------ names
    def _free(self, name: str) -> str:
        """Return an unused name."""
        full = name_of(name)
        word, _, index = full.partition("[")
        taken = self._names.get(word, set())
        if index in taken or (taken and ("" in taken or not index)):
            raise UsageError("BR528", f"`{self.name}` already has `{full if index in taken else word}`")
        return full

    def _enter(self, name: str) -> str:
        """Reserve a name."""
        full = self._free(name)
        word, _, index = full.partition("[")
        self._names.setdefault(word, set()).add(index)
        return full


def _model_of(model: CompiledModel) -> str:
    """Return the name of a loaded model; a file with several models needs the choice of one."""
    names = list(model.compilation().tree.models)
    if model.model is not None and model.model not in names:
        raise UsageError(
            "BR529", f"{model.source.name} defines no model `{model.model}`; it defines: {', '.join(names)}"
        )
    if model.model is None and len(names) != 1:
        raise UsageError(
            "BR530", f"{model.source.name} defines {', '.join(names)}:", f"name one, `load(path, {(names[0] if names else '')!r})`",
        )  # fmt: skip
    return model.model or names[0]
