"""Expressions to the source of a Python module that needs numpy alone.

Each assignment has its own line, with the author's name and the line of the text that it comes from. The functions take single
states and batches: every array is transposed so that its last axis comes first, and back at the end.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ...algebra.expression import Apply, Expression, Number, Symbol
from ...algebra.systems import SYSTEMS
from ...errors import printable
from ..dependence import INPUT, MODE, STATE, TIME
from ..events import LoweredEvents
from ..functions import FIXED, ProgramFunction, functions_of
from ..limits import Leaf
from ..lower import moving
from ..lowered import Lowered
from .body import NumpyLines, NumpyNeeds, number
from .names import Identifiers
from .runtime import beginning


class Writer:
    """Writer of the module."""

    def __init__(self, lowered: Lowered, more: Sequence[tuple[ProgramFunction, Sequence[Expression]]] = ()) -> None:
        """`more`: functions that only this program has."""
        self.lowered = lowered
        self.functions = (*functions_of(lowered), *more)
        self.constants = self._constant_nodes()
        self.constant_names: dict[Expression, str] = {}
        identifiers = Identifiers()
        for node in self.constants:
            self.constant_names[node] = identifiers.of(self._label(node))
        self.state_names = [identifiers.of(lowered.space.variables[v].name) for v in moving(lowered.space)]
        self.input_names = [identifiers.of(lowered.space.variables[v].name) for v in lowered.inputs]
        self.taken = set(identifiers.taken)
        self.needs = NumpyNeeds(lowered.labels)

    def _label(self, node: Expression) -> str:
        if isinstance(node, Symbol) and isinstance(node.key, Leaf) and node.key.role == "parameter":
            return self.lowered.space.variables[self.lowered.parameters[node.key.position]].name
        label = self.lowered.labels.get(node)
        return label.name if label is not None else "constant"

    # ------------------------------------------------------------ what is constant
    def _constant_nodes(self) -> list[Expression]:
        """Largest expressions of parameters alone that another expression reads."""
        found: dict[Expression, None] = {}
        seen: set[int] = set()  # by identity: to compare equal nodes costs more than to look at some twice
        changing = TIME | INPUT | STATE | MODE
        results = [x for row, results in self.functions if row.arguments != FIXED for x in results]
        stack = [*results, *self.lowered.time_roots][::-1]
        argument_values = [
            self.lowered.values[a] for s in self.lowered.space.storages for a in s.arguments if isinstance(a, int)
        ]
        fixed = [x for row, results in self.functions if row.arguments == FIXED for x in results]
        found |= dict.fromkeys(node for node in (*fixed, *argument_values) if not isinstance(node, Number))
        while stack:
            node = stack.pop()
            if id(node) in seen or type(node) is Number:
                continue
            seen.add(id(node))
            changes = self.lowered.dependence(node) & changing
            if type(node) is Apply and (changes or node.operator in SYSTEMS):  # of a system only items are numbers
                stack += node.operands[::-1]
            elif not changes:
                found[node] = None
        return list(found)

    # ------------------------------------------------------------ the module
    def module(self, units: Sequence[tuple[str, Sequence[tuple[str, str]]]], note: str) -> str:
        """The whole text. `units` are the name tables: heading, then (name, unit)."""
        lowered = self.lowered
        parts: list[str] = []
        for heading, rows in units:
            inner = "".join(f"    ({n!a}, {u!a}),\n" for n, u in rows)
            parts.append(f"{heading} = (  # (name, SI unit)\n{inner})\n" if rows else f"{heading} = ()\n")
        defaults = ", ".join(number(lowered.space.variables[v].value) for v in lowered.parameters)
        input_defaults = ", ".join(number(lowered.space.variables[v].value or 0.0) for v in lowered.inputs)
        parts.append(f"DEFAULTS = ({defaults}{',' if lowered.parameters else ''})\n")
        parts.append(f"INPUT_DEFAULTS = ({input_defaults}{',' if lowered.inputs else ''})\n")
        parts.append(self._constants())
        for row, roots in self.functions:
            name, arguments, doc = row.name, row.arguments, row.description(lowered)
            if name == "sensitivities":
                parts.append(_pattern("SENSITIVITY_PATTERN", sorted(lowered.sensitivities), "dependents, states"))
            if name == "invariant_slopes":
                parts.append(_pattern("INVARIANT_PATTERN", sorted(lowered.invariant_slopes), "invariants, states"))
            parts.append(self._function(name, arguments, doc, roots))
            if name == "jacobian_entries":
                parts.append(_jacobian(sorted(lowered.jacobian), len(lowered.rates)))
        if lowered.events.present:
            parts.append(_mode_at(lowered.events))
        arrays = "".join(f"{name} = np.array({list(values)!r})\n" for values, name in self.needs.arrays.items())
        return "\n".join(
            [f'"""{_quoted(note)}"""', beginning(self.needs.operators), *([arrays] if arrays else []), *parts]
        )

    def _constants(self) -> str:
        body = NumpyLines(self.needs, {}, {*self.taken})
        for position in range(len(self.lowered.parameters)):
            leaf = Symbol(Leaf("parameter", position))
            name = self.constant_names.get(leaf) or body.identifiers.of(self._label(leaf))
            body.known[leaf] = name
            body.lines.append(f"{name} = parameters[{position}]")
        results = body.write(self.constants, self.constant_names)
        lines = [
            "def constants(parameters):",
            '    """All that depends on parameters alone."""',
            "    batch = _leading(0.0, parameters)",
            "    parameters = np.asarray(parameters, dtype=float).T",
            *_indented(body.lines),
            _return(results, (len(self.constants),)),
        ]
        return "\n" + "\n".join(lines) + "\n"

    def _function(self, name: str, arguments: str, note: str, roots: Sequence[Expression]) -> str:
        body = NumpyLines(self.needs, dict(self.constant_names), set(self.taken))
        for position, leaf_name in enumerate(self.state_names):
            body.known[Symbol(Leaf("state", position))] = leaf_name
        for position, leaf_name in enumerate(self.input_names):
            body.known[Symbol(Leaf("input", position))] = leaf_name
        for position in range(self.lowered.events.size):
            body.known[Symbol(Leaf("mode", position))] = f"mode[{position}]"
        body.known[Symbol(Leaf("time", 0))] = "time"
        results = body.write(roots, {})
        lines = [f"def {name}({arguments}):", f'    """{note}"""']
        lines += _indented(self._prelude(body.used, arguments))
        lines += _indented(body.lines)
        lines.append(_return(results, (len(roots),)))
        return "\n" + "\n".join(lines) + "\n"

    def _prelude(self, used: set[str], arguments: str) -> list[str]:
        """Give names to the items of the arrays that the function reads."""
        arrays = [a for a in ("state", "inputs", "constants") if a in arguments]
        lines = [f"batch = _leading({'time' if 'time' in arguments else '0.0'}, {', '.join(arrays)})"]
        if "state" in arguments and self.state_names:
            names = ", ".join(n if n in used else "_" for n in self.state_names)
            lines.append(f"{names}{',' if len(self.state_names) == 1 else ''} = np.asarray(state).T")
        if "inputs" in arguments and any(n in used for n in self.input_names):
            lines.append(
                ", ".join(self.input_names)
                + f"{',' if len(self.input_names) == 1 else ''} = np.asarray(inputs, dtype=float).T"
            )
        wanted = [(i, n) for i, n in enumerate(self.constant_names.values()) if n in used]
        if wanted:
            lines.append("constants = np.asarray(constants).T")
            lines += [f"{n} = constants[{i}]" for i, n in wanted]
        if "mode" in arguments and any(n.startswith("mode[") for n in used):
            lines.append("mode = np.asarray(mode).T")
        if "time" in arguments and "time" in used:
            lines.append("time = np.asarray(time, dtype=float).T[()]")
        return lines


def _pattern(name: str, places: Sequence[tuple[int, int]], what: str) -> str:
    first, second = (", ".join(str(p[i]) for p in places) for i in (0, 1))
    return f"\n{name} = (np.array([{first}], dtype=int), np.array([{second}], dtype=int))  # {what}\n"


def _jacobian(places: Sequence[tuple[int, int]], n: int) -> str:
    """Pattern of the Jacobian, and the dense matrix from its entries."""
    return f'''{_pattern("PATTERN", places, "rows, columns")}

def jacobian(time, state, inputs, constants, mode):
    """The derivatives of the rates (rows) by the states (columns)."""
    entries = jacobian_entries(time, state, inputs, constants, mode)
    matrix = np.zeros((*entries.shape[:-1], {n}, {n}))
    matrix[(..., *PATTERN)] = entries
    return matrix
'''


def _mode_at(events: LoweredEvents) -> str:
    """The mode from the conditions on time and on states."""
    located = [item.note.position for item in events.located]
    strict = [item.note.strict for item in events.located]
    counts = [item.position for item in events.counts]
    counted = f"\n        mode[..., {counts}] = counts(time, state, inputs, constants, mode)" if counts else ""
    return f'''
def mode_at(time, state, inputs, constants):
    """The mode at a state, with what only events change as it starts."""
    mode = np.zeros((*_leading(time, state, inputs, constants), {events.size}))
    mode[..., {list(range(len(events.starts)))}] = mode_start(constants)
    mode[..., {events.timed}] = switches(time, constants)
    for _ in range({len(located)}):  # one may be asked under another
        left_less_right = roots(time, state, inputs, constants, mode)
        mode[..., {located}] = (left_less_right < 0) | ((left_less_right == 0) & ~np.array({strict})){counted}
    return mode
'''


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _return(results: Sequence[str], shape: tuple[int, ...]) -> str:
    items = "".join(f"            {r},\n" for r in results)
    values = f"(\n{items}        )" if results else "()"
    return f"    return _pack(\n        {values},\n        {shape},\n        batch,\n    )"


def _quoted(text: str) -> str:
    lines = (printable(line).replace("\\", "\\\\").replace('"', "'") for line in text.split("\n"))
    return "\n".join(lines)
