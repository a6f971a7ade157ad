"""Units of the author: the one behind the colon of a quantity, else that of the first number of the same kind."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction

from compiler.api import CompilationFailed, Scale, Source, read_unit, tree

from .compiled_model import CompiledModel

_WORD = r"[^\W\d]\w{0,8}"
_NUMBERS = re.compile(
    rf"(\d+(?:\.\d+)?(?:[eE][-+]?\d{{1,3}})?) ?(?:\[([^\]\n]{{1,40}})\]|({_WORD}|%)((?:[*/]{_WORD}|\^-?\d)*))"
)
_LAST = re.compile(r"(^|[*/^])[^*/^]*$")
_NAMES = re.compile(r"[^\W\d]\w*")


def quantities_in(text: str) -> Iterator[tuple[Fraction, str, Scale]]:
    """Yield all numbers of a text that have a unit, with it: as much behind the number as is one."""
    for number, bracketed, plain, more in _NUMBERS.findall(text):
        words = bracketed or plain + more
        while words:
            try:
                yield Fraction(number), words, read_unit(Source("unit", words))
                break
            except CompilationFailed:
                words = _LAST.sub("", words)  # a name, as `x` in `10 N/m*x`


def author_units(model: CompiledModel, units: Mapping[str, str]) -> dict[str, tuple[str, Scale]]:
    """Return the author's unit for each name of parameters, inputs and sweeps with its unit in SI; that unit where there is no other."""
    written: dict[str, tree.Item | tree.SweepSyntax] = {}
    for statement in model.compilation().tree.models[model.name].statements:
        if isinstance(statement, tree.Quantities):
            written |= {item.name: item for item in statement.items}
        elif isinstance(statement, tree.Experiment):
            for step in statement.steps:
                if isinstance(step, tree.SweepSyntax):
                    written.setdefault(step.path.span.words, step)
    return {name: _unit(name.partition("[")[0], unit, written) for name, unit in units.items()}


def _unit(name: str, unit: str, written: Mapping[str, tree.Item | tree.SweepSyntax]) -> tuple[str, Scale]:
    """Return the unit that a quantity has in its own text, else in that of one from which it is computed."""
    own = read_unit(Source("unit", unit))
    named = _NAMES.findall(written[name].span.words) if name in written else []
    for item in (written[n] for n in (name, *named) if n in written):
        text = item.span.words if item.unit is None else f"1 [{item.unit.span.words}]"
        value = getattr(written[name], "value", None)
        reckoned = written[name].unit is None and not isinstance(value, tree.Literal | tree.Negative | None)
        for _, words, scale in quantities_in(text):
            if scale.dimension == own.dimension and not (reckoned and scale.offset):  # 30 degC - 20 degC are 10 K
                return words, scale
    return "" if unit == "1" else unit, own
