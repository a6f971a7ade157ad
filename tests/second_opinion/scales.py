"""Models in other units: random networks and mechanisms, `models/`, the examples of the library. No unit changes any physics.

`python tests/second_opinion FOLDER --scales N` runs each at powers of ten of its units, through two solvers and both back-ends; a model at scale 1 is its
own witness. A refusal of what runs at scale 1 counts as a disagreement.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import bondgraph
from bondgraph.catalogue import example_of, parts_of
from bondgraph.errors import RunFailed
from compiler.api import CompilationFailed, Source, scene_of
from compiler.metamorphosis.printing import text_of
from compiler.metamorphosis.renaming import parsed
from compiler.metamorphosis.scaling import Powers
from tests.compiling import LIBRARY, MODELS
from tests.second_opinion.random_models import Example, mechanism, network
from tests.second_opinion.trial import TooLong, limited

SCALES = (
    (1e-15, 1e-15, 1.0), (1e9, 1e9, 1.0), (1e-12, 1e9, 1.0), (1e9, 1e-12, 1.0), (1.0, 1.0, 1e-15), (1.0, 1.0, 1e9), (1e-15, 1e-6, 1e-12),
    (1e-6, 1e-15, 1e6),
)  # fmt: skip
"""Units of effort, flow and time."""
POWERS: tuple[dict[str, int], ...] = (
    {"length": -6}, {"length": 6}, {"mass": -12}, {"time": -8}, {"time": 6}, {"charge": -14}, {"charge": 8},
    {"length": -6, "mass": -12, "time": -4, "charge": -10}, {"length": 4, "mass": 6, "time": 4, "charge": 6},
)  # fmt: skip
"""Powers of ten of the units of texts."""
WAYS: tuple[dict[str, str], ...] = ({"target": "numpy"}, {}, {"solver": "rodas"})
WIDE, SURE = (
    1e-4,
    1e-9,
)  # of the magnitudes: difference of runs that is looked at again; outputs of one unit that count as rounding
CLOSER = 1e-9  # relative tolerance of that
INSTANTS = 1e-5  # of a run: difference of the instants of an event
UNITS = {"e": "s_e", "f": "s_f", "q": "(s_f*s_t)", "p": "(s_e*s_t)", "x": "(s_f*s_t)", "y": "(s_f*s_t)"}
SIZES = {"s_e": "V", "s_f": "A", "s_t": "s"}


def _in_units(text: str, bare: str = "efqp") -> str:
    """An expression whose quantities are divided by their units."""
    text = re.sub(r"(?<![\w.])time\b", "(time/s_t)", text)
    text = re.sub(r"\b(\w+)\.([efqp])\b", lambda m: f"({m[1]}.{m[2]}/{UNITS[m[2]]})", text)
    return re.sub(rf"(?<![\w.])([{bare}])([12]?)(?![\w.])", lambda m: f"({m[0]}/{UNITS[m[1]]})", text)


def _set(text: str) -> str:
    """An assignment of an event."""
    left, right = text.split("=", 1)
    unit = UNITS[left.strip()[-1]] + "*" if "." in left else ""
    return f"{left.strip()} = {unit}({_in_units(right, 'Z')})"


def _line(line: str) -> str:
    """A line of a plain model as one of an electric model."""
    line = line.strip()
    if found := re.fullmatch(
        r"((?:R|C|I|MR|TF|GY|Se|Sf|MSe|MSf) \w+(?:\(x, y\))?) : (\w+) = (.*?)(?: \{ start ([qp]) = (.*) \})?", line
    ):
        head, left, law, start, value = found.groups()
        field = head.endswith("(x, y)")
        factor = "s_e*s_f*s_t" if left == "energy" else UNITS[left[0]]
        begin = f" {{ start {start} = {UNITS[start]}*{value} }}" if start else ""
        head = head.replace("(x, y)", "(x: electric, y: electric)")
        return f"{head} : {left} = {factor}*({_in_units(law, 'xy' if field else 'efqp')}){begin}"
    if found := re.fullmatch(r"()([01]) (\w+)(?: \{ active = (.*) \})?", line):
        active = f" {{ active = {_in_units(found[4], 'Z')} }}" if found[4] else ""
        return f"{found[1]}{found[2]} {found[3]} : electric{active}"
    if found := re.fullmatch(r"(when .*?) \{ (.*) \}", line):
        return f"{_in_units(found[1], 'Z')} {{ {'; '.join(map(_set, found[2].split(';')))} }}"
    if found := re.fullmatch(r"every ([\d.]+)((?: \w+ [\d.]+)*) \{ (.*) \}", line):
        timing = re.sub(r"([\d.]+)", r"\1*s_t", found[2])
        return f"every {found[1]}*s_t{timing} {{ {'; '.join(map(_set, found[3].split(';')))} }}"
    if found := re.fullmatch(r"signal (\w+) = integral\((.*), 0\)", line):
        return f"signal {found[1]} = integral(({_in_units(found[2], 'Z')})/s_t, 0)"
    if line.startswith(("signal", "output")):
        return _in_units(line, "Z")
    return re.sub(r"((?:Friction|Valve) \w+)(?: \{ (.*) \})?", r"\1 { s_e = s_e; s_f = s_f; s_t = s_t; \2 }", line)


def with_units(example: Example) -> str:
    """A random network as an electric one, whose units of effort, flow and time are parameters; its outputs have none."""
    declared = "".join(f"  parameter {n}: {u} = 1\n" for n, u in SIZES.items())
    text = example.written(example.first or example.parameters).replace("plain model", "model")
    lines = [
        _line(line) if not line.strip().startswith("experiment") else ""
        for line in text.replace("{ 0", "{ 0").splitlines()
    ]
    found = []
    for line in lines:
        found.append(line.replace(": untyped", ": electric"))
        if re.match(r"model (Friction|Valve|Random)", line):
            found.append(declared.rstrip())
    return "\n".join(found) + "\n"


def in_other_units(text: str, powers: Mapping[str, int]) -> tuple[str, Powers]:
    """A text with units, each number with a dimension multiplied by its power of ten."""
    own = Powers(0)
    own.powers = {**dict.fromkeys(own.powers, 0), **powers}
    own.powers["current"] = own.powers["charge"] - own.powers["time"]
    return text_of(own.scaled(parsed(text))), own


# ---------------------------------------------------------------- runs
def scaled_run(model: bondgraph.Model, example: Example, scale: tuple[float, float, float], **options: Any) -> Any:
    """The run of a network in other units of effort, flow and time."""
    settings = {**example.settings, **dict(zip(SIZES, scale, strict=True))}
    return model.simulate(settings=settings, to=example.span * scale[2], points=9, **options)


def unscaled(unit: str) -> float:
    """Factor of the outputs of a network, which have no units."""
    return 1.0


def difference(base: Any, other: Any, factor: Callable[[str], float], second: float) -> str:
    """What differs in two runs beyond their tolerance, "" if nothing."""
    values = other.values / np.array([factor(c.unit) for c in base.columns])
    if values.shape != base.values.shape:
        return f"{values.shape} values for {base.values.shape}"
    largest = np.abs(base.values).max(axis=0)
    units = [c.unit for c in base.columns]
    beside = np.array([max(x for x, u in zip(largest, units, strict=True) if u == unit) for unit in units])
    share = np.abs(values - base.values).max(axis=0) / np.maximum(np.maximum(largest, SURE / WIDE * beside), 1e-300)
    if not (share <= WIDE).all():
        return f"{base.names[int(np.nan_to_num(share, nan=np.inf).argmax())]} differs by {np.nanmax(share):.2g}"
    ours, theirs = ([e.time / s for e in r.events] for r, s in ((base, 1.0), (other, second)))
    if len(ours) != len(theirs):
        return f"{len(ours)} events, and {len(theirs)}"
    return "" if np.allclose(ours, theirs, rtol=0, atol=INSTANTS * float(base.time[-1])) else "events at other instants"


def compared(base: Callable[..., Any], other: Callable[..., Any], factor: Callable[[str], float], second: float) -> str:
    """Difference of two runs at the usual tolerance; if there is one, at a fine one."""
    found = ""
    for options in ({}, {"rtol": CLOSER}):
        first = base(**options)
        try:
            found = difference(first, other(**options), factor, second)
        except (RunFailed, CompilationFailed) as failed:
            found = f"refused: {str(failed)[:300]}"
        if not found:
            return ""
    return found


def network_cases(seed: int) -> Iterator[tuple[str, str]]:
    """Each scale and way of a random network, with what differs."""
    example = network(seed)
    model = bondgraph.load(with_units(example))
    for way in WAYS:
        for scale in SCALES:
            yield (
                f"network {seed} {way} {scale}",
                compared(
                    lambda way=way, **more: scaled_run(model, example, (1.0, 1.0, 1.0), **way, **more),
                    lambda way=way, scale=scale, **more: scaled_run(model, example, scale, **way, **more),
                    unscaled,
                    scale[2],
                ),
            )


def text_cases(name: str, text: str, path: Path | None = None) -> Iterator[tuple[str, str]]:
    """Each change of units of a text with units, with what differs."""
    model = bondgraph.load(path or text)
    first = model.simulate(points=9)
    scene = scene_of(Source(name, text, path), LIBRARY, (first.model, first.experiment), first.names, {})
    for powers in () if scene.plain else POWERS:
        changed, own = in_other_units(scene.text, powers)
        other = bondgraph.load(changed, model=scene.model)
        yield (
            f"{name} {powers}",
            compared(
                lambda **more: model.simulate(points=9, **more),
                lambda other=other, **more: other.simulate(first.experiment, points=9, **more),
                own.of_unit,
                own.of_unit("s"),
            ),
        )


def texts() -> Iterator[tuple[str, str, Path | None]]:
    """`models/`, and the examples of the library."""
    for path in sorted(MODELS.rglob("*.bg")):
        yield path.stem, path.read_text(encoding="utf-8"), path
    for file in sorted(LIBRARY.glob("*.bg")):
        for part in parts_of(file):
            example = example_of(part, parts_of(file))
            if example:
                yield f"{file.stem}.{part.name}", re.sub(r'from "(\w+).bg"', r"from \1", example), None


def campaign(numbers: range, seconds: int) -> Iterator[tuple[str, str]]:
    """All cases that could be tried, with what differs: networks and mechanisms by number, then texts if the numbers begin with 0."""
    cases: list[Callable[[], Iterator[tuple[str, str]]]] = [lambda n=n: network_cases(n) for n in numbers]
    for n in numbers:
        own = mechanism(n)
        cases.append(lambda n=n, own=own: text_cases(f"mechanism {n}", own.written(own.parameters)))
    if 0 in numbers:
        cases += [lambda given=given: text_cases(*given) for given in texts()]
    for case in cases:
        try:
            with limited(seconds):
                yield from case()
        except (TooLong, RunFailed, CompilationFailed, bondgraph.UsageError):
            continue
