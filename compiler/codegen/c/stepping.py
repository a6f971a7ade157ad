"""A fixed-step loop in C around the functions of a program: structures, `NAME_init`, `NAME_step` and a `main` to try them.

Between events the classical method of Runge and Kutta; samples at their own instants, computed anew from their number; a condition that
changes within a step is located by halving. All loops are bounded, nothing is allocated or global.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..lowered import Lowered
from ..numpy.names import Identifiers

_KEYWORDS = re.compile(
    r"auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|inline|int|long|register|restrict|return|short|signed|"
    r"sizeof|static|struct|switch|typedef|union|unsigned|void|volatile|while"
)


_NOTHING = """static inline void NAME_nothing(double time, const double *state, const double *inputs, const double *constants, const double *mode, double *out)
{
    (void)time; (void)state; (void)inputs; (void)constants; (void)mode; (void)out;
}

"""  # in the place of functions that a model without events has not


def obstacle(lowered: Lowered) -> str | None:
    """The first thing of a model for which the loop has no method, as the subject of a sentence; None if there is none."""
    space, names = lowered.space, lowered.space.variables
    if space.switches:
        return f"the junction `{space.switches[0].junction}`, which goes on and off"
    if space.delays:
        return f"the delayed signal `{names[space.delays[0].variable].name}`"
    if space.forced:
        return f"the rate of `{names[space.forced[0].variable].name}`, which may jump"
    if space.invariants:
        return f"the closed loop at `{space.invariants[0].name}`"
    if space.unknowns:
        return f"the algebraic loop of `{names[space.unknowns[0].variable].name}`"
    if space.claims:
        return f"the start of `{names[space.claims[0].variable].name}`, which is computed from states"
    computed = [s.words for event in lowered.events.events for s in event.settings if s.kind == "computed"]
    return f"`{computed[0]}`, which an event sets and states compute" if computed else None


def stepping(lowered: Lowered, prefix: str) -> str:
    """Text of the loop."""
    template = Path(__file__).with_name("stepping.c").read_text(encoding="utf-8")
    values = _values(lowered) | {"NAME": prefix}
    return re.sub(r"@(\w+)@", lambda match: values[match[1]], template).replace("NAME", prefix)


def _values(lowered: Lowered) -> dict[str, str]:
    """Text of each place of the template."""
    events, variables = lowered.events, lowered.space.variables
    inputs = c_fields([variables[v].name.removeprefix(f"{lowered.space.name}.") for v in lowered.inputs])
    outputs = c_fields(list(lowered.space.outputs))
    settings = [(i, s) for i, event in enumerate(events.events) for s in event.settings]
    sampled = [i for i, event in enumerate(events.events) if event.sampled]
    conditions = [c.note for c in events.located]
    lists = {
        "timed": events.timed, "counted": [c.position for c in events.counts],
        "places": [c.position for c in conditions], "strict": [int(c.strict) for c in conditions],
        "sampled": sampled, "late": [int(e.late) for e in events.events], "owner": [i for i, _ in settings],
        "checks": [*(i for i, x in enumerate(lowered.limits) if x.note.kind == "start"), -1],
        "position": [s.position for _, s in settings], "is_mode": [int(s.kind == "mode") for _, s in settings],
    }  # fmt: skip
    counts = {
        "states": len(lowered.space.states), "modes": events.size, "discrete": len(events.starts), "conditions": len(conditions),
        "counts": len(events.counts),
        "timed": len(events.timed), "events": len(events.events), "samples": len(sampled), "settings": len(settings),
        "limits": len(lowered.limits), "periods": len(lowered.periods), "inputs": len(inputs), "outputs": len(outputs),
    }  # fmt: skip
    return {
        "input_fields": _lines(f"double {name};" for name in inputs) or "    int none;",
        "output_fields": _lines(f"double {name};" for name in outputs) or "    int none;",
        "checks": ", ".join(x.note.words for x in lowered.limits if x.note.kind == "start") or "none",
        "nothing": "" if events.present else _NOTHING, "counts": "NAME_counts" if events.present else "NAME_nothing",
        "sizes": _lines(f"NAME_n_{word} = {count}," for word, count in counts.items()),
        "lists": "\n".join(f"static const int NAME_{name}[] = {{{', '.join(map(str, [*v, 0]))}}};" for name, v in lists.items()),
        "inputs_default": _lines(f"in->{name} = NAME_input_defaults[{i}];" for i, name in enumerate(inputs)) or "    in->none = 0;",
        "inputs_in": _lines(f"model->inputs[{i}] = in->{name};" for i, name in enumerate(inputs)) or "    (void)in;",
        "outputs_out": _lines(f"out->{name} = value[{i}];" for i, name in enumerate(outputs)) or "    out->none = 0;",
        "ahead": "1e-6 * model->step" if conditions else "0.0",
        "mode_start": "    NAME_mode_start(0, 0, 0, model->constants, 0, model->mode);" if events.present else "    (void)model;",
        "roots": "NAME_roots" if events.present else "NAME_nothing",
        "triggers": "NAME_triggers" if events.present else "NAME_nothing",
        "values": "NAME_values" if events.present else "NAME_nothing",
        "sampling": "NAME_sampling" if events.present else "NAME_nothing",
        "printed": _lines(f'printf(",%.17g", (double)out.{name});' for name in outputs),
    }  # fmt: skip


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)


def c_fields(names: Sequence[str]) -> list[str]:
    """Return a name of C for each of the author's names."""
    identifiers = Identifiers()
    return [identifiers.of(f"v_{name}" if _KEYWORDS.fullmatch(name) else name) for name in names]
