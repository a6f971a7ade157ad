"""The product's run of a text beside the second opinion on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import bondgraph
from bondgraph.errors import RunFailed
from compiler.errors import CompilationFailed
from compiler.scene import Scene
from compiler.semantics import build_graph
from compiler.source import Source
from compiler.syntax import parse
from tests.compiling import LIBRARY, override
from tests.second_opinion.assembly import System, system
from tests.second_opinion.solution import Opinion, Undecided, opinion
from tests.second_opinion.writer import NotHeld

FACTOR = 10  # times both errors
BLUR = 16.0  # how much longer an impulse lasts, and how much later an event is found, to see what depends on it
NOTHING = 1e-20  # of any output: the numbers of random models are near one
CLOSER = {"goal": 1e-8, "most": 2048, "budget": 100_000}  # for what disagrees
SAME = 3e-6  # of the magnitude: what agrees so well with the coarsest run is right


@dataclass(frozen=True)
class Verdict:
    """`kind`: agreed, refused, disagreed, undecided or not held; `words` say more."""

    kind: str
    words: str = ""
    code: str = ""
    events: int = 0


@lru_cache(maxsize=2)
def _built(text: str | Path, overrides: tuple[tuple[str, float], ...] = ()) -> Any:
    path = text if isinstance(text, Path) else None
    source = Source(str(path or "text.bg"), path.read_text(encoding="utf-8") if path else str(text), path)
    return build_graph(parse(source), Scene(overrides=tuple(override(n, v) for n, v in overrides)), LIBRARY)


@lru_cache(maxsize=2)
def _system(text: str | Path, settings: tuple[tuple[str, float], ...], fixed: tuple[str, ...] = ()) -> System:
    """The system of a text; all settings but the `fixed` ones may be others later."""
    built = _built(text, tuple((n, v) for n, v in settings if n in fixed))
    return system(built.graph, {n: v for n, v in settings if n not in fixed})


@lru_cache(maxsize=2)
def _loaded(text: str | Path) -> bondgraph.Model:
    return bondgraph.load(text)


def second(
    text: str | Path,
    span: float | None = None,
    points: int = 5,
    settings: Mapping[str, float] | None = None,
    **options: Any,
) -> Opinion:
    """The second opinion on a text or file, over the first `span` seconds. Raises `NotHeld`, `Undecided`, `CompilationFailed`."""
    plan = _built(text).plan
    if plan.equilibrium:
        raise NotHeld("a start at rest")
    if span is None:
        if plan.stop is None:
            raise NotHeld("no simulation")
        span = plan.stop - plan.start
    given = tuple(sorted((settings or {}).items()))
    own = _system(text, tuple((n, 1.0) for n, _ in given)) if given else _system(text, ())
    if own.assembly.fixed:
        own = _system(text, given, tuple(sorted(own.assembly.fixed)))
    own.assembly.p[:] = [v for n, v in given if n in own.assembly.free]
    try:
        return opinion(own, plan.start, list(np.linspace(plan.start, plan.start + span, points)), **options)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        raise Undecided(f"{type(error).__name__}: {error}") from None


def compared(
    text: str | Path,
    span: float | None = None,
    *,
    points: int = 5,
    rtol: float = 1e-7,
    settings: Mapping[str, float] | None = None,
    witness: str | None = None,
    structure: Mapping[str, Any] | None = None,
    target: str | None = None,
    **options: Any,
) -> Verdict:
    """Run both, the second opinion on the `witness` if there is one; `structure`: settings of the product alone. A refusal by the product is listed together with the second opinion's ability to run the text."""
    product, refusal, code = None, "", ""
    try:
        model = _loaded(text)
        begin = model.compilation(Scene(None, "")).plan.start
        to = None if span is None else begin + span
        given = {**(settings or {}), **(structure or {})}
        product = model.simulate(to=to, points=points, rtol=rtol, settings=given, target=target)
    except CompilationFailed as failed:
        code = " ".join(sorted({d.code for d in failed.diagnostics}))
        refusal = f"{code} {failed.diagnostics[0].sentence}"
    except (RunFailed, bondgraph.UsageError) as failed:
        code, refusal = "run", str(failed)
    text = witness or text
    try:
        own = second(text, span, points, settings, same=_same(product), **options)
    except NotHeld as lack:
        return Verdict("not held", str(lack), code)
    except CompilationFailed as failed:
        return Verdict("refused", refusal or str(failed), code)
    except Undecided as lack:
        return Verdict("undecided" if product is not None else "refused by both", f"{refusal} | {lack}", code)
    if product is None:
        return Verdict("refused", refusal, code, len(own.events))
    verdict = _judged(product, own, rtol)
    if (
        verdict.kind == "disagreed"
    ):  # two runs may be near one another by chance: the estimate of the error is then too small
        try:
            own = second(text, span, points, settings, **{**options, **CLOSER})
        except Undecided as lack:
            return Verdict("undecided", str(lack), code)
        verdict = _judged(product, own, rtol)
    if verdict.kind == "disagreed" and own.events:  # by less than the events' own blur may do: no disagreement
        try:
            other = second(text, span, points, settings, blur=BLUR, **options)
        except Undecided as lack:
            return Verdict("undecided", str(lack), code)
        own.error[:] += np.abs(other.values - own.values)
        verdict = _judged(product, own, rtol)
    return verdict


def _same(product: Any) -> Any:
    """Test whether values of a coarse run agree with the product's already: two independent results that agree need no estimate of the error."""
    if product is None:
        return None

    def same(names: Sequence[str], values: Any) -> bool:
        for name, here in zip(names, values, strict=True):
            if name in product.names:
                there = np.asarray(product[name])
                scale = max(float(np.abs(there).max()), float(np.abs(here).max(initial=0.0)))
                if not float(np.abs(there[1:] - here).max(initial=0.0)) <= SAME * scale + NOTHING:
                    return False
        return True

    return same


def _judged(product: Any, own: Opinion, rtol: float) -> Verdict:
    worst, words = 0.0, ""
    rounding = 1e-12 * float(np.abs(own.values).max(initial=0.0)) + NOTHING  # of outputs that are nothing
    for i, name in enumerate(own.names):
        if name not in product.names:
            continue
        there, here = np.asarray(product[name])[1:], own.values[i]
        scale = max(float(np.abs(product[name]).max()), float(np.abs(here).max()))
        error = own.error[i].max() + rtol * scale * 10 + rounding
        gap = float(np.abs(there - here).max(initial=0.0))
        if not np.isfinite(there).all():
            return Verdict("disagreed", f"{name} is no number", events=len(own.events))
        if error > 0 and gap / error > worst:
            worst = gap / error
            words = f"{name}: {there.tolist()} but {here.tolist()} +- {own.error[i].max():.2g} ({worst:.3g} times both errors)"
    if worst > FACTOR:
        return Verdict("disagreed", words, events=len(own.events))
    loose = any(
        own.error[i].max() > 1e-2 * np.abs(own.values[i]).max(initial=0.0) + rounding for i in range(len(own.names))
    )
    return Verdict("undecided" if loose else "agreed", words, events=len(own.events))
