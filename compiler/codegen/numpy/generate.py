"""A lowered state space to a numpy program: written and loaded as a Python module."""

from __future__ import annotations

import importlib.machinery
import importlib.util
from importlib.abc import InspectLoader
from types import ModuleType

from ..dependence import EVENT
from ..lower import count_operations
from ..lowered import Lowered
from ..multipliers import solved_for
from ..program import Delays, HybridNote, NameTable, Program, hybrid_of
from ..time_functions import time_functions_of
from .write import Writer


def generate_program(lowered: Lowered) -> Program:
    """A program of the numpy target."""
    space = lowered.space
    writer = Writer(lowered)
    source = _text(writer)
    module = load_module(space.name, source)
    note = hybrid_note(lowered)
    tables = dict(name_tables(lowered))

    def names(heading: str) -> NameTable:
        rows = tables[heading]
        return NameTable(tuple(r[0] for r in rows), tuple(r[1] for r in rows))

    return Program(
        space.name, source, names("STATES"), names("UNKNOWNS"), names("OUTPUTS"), names("INPUTS"), names("PARAMETERS"), module.DEFAULTS, module.INPUT_DEFAULTS,
        module.constants, module.start, module.nominal, module.derivative,
        module.PATTERN,
        module.jacobian_entries, module.jacobian, module.output, module.claims,
        names("DEPENDENTS"), module.dependent, module.SENSITIVITY_PATTERN, module.sensitivities, module.forced, module.signals, module.powers, module.instants,
        module.crossings, module.switches, module.periods, tuple(limit.note for limit in lowered.limits), module.holds, module.limit_values,
        names("INVARIANTS"), module.invariant, module.INVARIANT_PATTERN, module.invariant_slopes, *of_invariants(lowered),
        module.solved if lowered.solved is not None else None,
        count_operations(lowered.rates), lowered.differentiated, None, None if note is None else hybrid_of(note, vars(module)),
        module.bends if lowered.bends else None,
        Delays(len(lowered.lags), module.lags, module.delayed) if lowered.lags else None,
        module.stored_energy if lowered.energy else None, time_functions_of(lowered, writer.constants),
        {row.name: getattr(module, row.name) for row, _ in writer.functions},
    )  # fmt: skip


def hybrid_note(lowered: Lowered) -> HybridNote | None:
    """Data of the events that depend on states; None if there are none."""
    events = lowered.events
    if not events.present:
        return None
    variables = [lowered.space.variables[d.variable] for d in lowered.space.discretes]
    modes = NameTable(tuple(v.name for v in variables), tuple(v.unit for v in variables))
    conditions = tuple(item.note for item in events.located)
    switched = any(lowered.dependence(signal) & EVENT for signal in lowered.signals)
    return HybridNote(events.size, modes, tuple(events.timed), conditions, events.events, events.junctions, switched)


def of_invariants(lowered: Lowered) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """For each constraint: index of its multiplier among the unknowns, of its rate among the invariants, of its part among the parameters.

    The index is -1 if there is none. A fourth tuple holds the unknowns that the program solves for.
    """
    invariants = lowered.space.invariants
    unknowns = {u.variable: i for i, u in enumerate(lowered.space.unknowns)}
    parameters = {v: i for i, v in enumerate(lowered.parameters)}
    rates, row = [], len(invariants)
    for invariant in invariants:
        rates.append(-1 if invariant.velocity is None else row)
        row += invariant.velocity is not None
    return (
        tuple(-1 if i.multiplier is None else unknowns[i.multiplier] for i in invariants),
        tuple(rates),
        tuple(-1 if i.part is None else parameters[i.part] for i in invariants),
        tuple(unknowns[v] for v in solved_for(lowered.space)),
    )


def _text(writer: Writer) -> str:
    lowered = writer.lowered
    mode = "mode_at(0.0, x, INPUT_DEFAULTS, c)" if lowered.events.present else "switches(0.0, c)"
    note = (
        f"{lowered.space.name}: generated from a bond graph; needs numpy alone.\n\n"
        f"c = constants(DEFAULTS); x = start(c); derivative(0.0, x, INPUT_DEFAULTS, c, {mode}).\n"
        "All quantities are in SI; arrays may have leading axes (batches). Both sides of an `if` are evaluated: where that warns of\n"
        "a division by zero, `with numpy.errstate(all='ignore')` around the call keeps it quiet.\n"
    )
    return writer.module(name_tables(lowered), note)


def name_tables(lowered: Lowered) -> list[tuple[str, list[tuple[str, str]]]]:
    """Heading, names and units of each array of a program."""
    variables = lowered.space.variables

    def rows(numbers: object) -> list[tuple[str, str]]:
        return [(variables[v].name, variables[v].unit) for v in numbers]  # type: ignore[attr-defined]

    outputs = [(name, variables[v].unit) for name, v in lowered.space.outputs.items()]
    invariants = [(i.name, variables[i.position].unit) for i in lowered.space.invariants]
    rates = [
        (f"rate of {i.name}", variables[i.velocity].unit) for i in lowered.space.invariants if i.velocity is not None
    ]
    return [
        ("STATES", rows([s.variable for s in lowered.space.states])),
        ("UNKNOWNS", rows([u.variable for u in lowered.space.unknowns])),
        ("DEPENDENTS", rows([d.quantity for d in lowered.space.dependents])),
        ("OUTPUTS", outputs),
        ("INPUTS", rows(lowered.inputs)),
        ("PARAMETERS", rows(lowered.parameters)),
        ("INVARIANTS", [*invariants, *rates]),
    ]


class _Generated(InspectLoader):
    """Loader of a module from its generated text."""

    def __init__(self, source: str) -> None:
        self.source = source

    def get_source(self, fullname: str) -> str:
        return self.source


def load_module(name: str, source: str) -> ModuleType:
    """Module of a generated text."""
    full = f"bondgraph_program_{name}"
    spec = importlib.machinery.ModuleSpec(full, _Generated(source), origin=f"<{name}>")
    module = importlib.util.module_from_spec(spec)
    assert spec.loader is not None
    spec.loader.exec_module(module)
    return module
