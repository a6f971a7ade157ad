"""Errors of the equations as a whole: BG5xx."""

from __future__ import annotations

from ..errors import Diagnostic, WordedDiagnostic
from ..source import Span


class SingularLoop(Diagnostic):
    code = "BG502"
    title = "The algebraic loop through {members} has no unique solution"
    advice = (
        "Nothing in it decides its flow or its effort: no loss, no storage, or they add up to nothing, or no node has a potential. "
        "Put a resistor or a storage into it; a circuit that floats needs an earth, `Se earth : u = 0 V`. "
        "Of signals one follows from the others: look for a sign. The equations of a `solve` read all that it looks for."
    )
    members: str


class SingularField(Diagnostic):
    code = "BG509"
    title = "The matrix of {members} is singular: some combination of its flows or efforts stores nothing"
    advice = "Write what is left: two coils with all flux in common are a `TF` and one `I` on a side of it, two plates one `C` on the `1` between them."
    members: str


class ForcedByInput(Diagnostic):
    code = "BG503"
    title = "`{element}` is forced by the input `{source}`, so its flow needs the derivative of what comes from outside"
    advice = "Give `{source}` as an expression of time (`set` in an experiment), or put a resistor between the two."
    element: str
    source: str


class DerivativeWithoutEnd(Diagnostic):
    code = "BG504"
    title = "`{element}` is in derivative form, but nothing decides `{variable}`: it would depend on its own derivatives without end"
    advice = (
        "Let one of the storages that hang together be in integral form: remove its `require`. If none has one, a law reads an effort "
        "or a flow that hangs on this derivative: let it read what a storage holds instead, or put a small resistor between them."
    )
    element: str
    variable: str


class NothingToCompute(Diagnostic):
    code = "BG505"
    title = "The model has no output and no state"
    advice = "Name what you want to see: `output x = spring.x`."


class NoRate(WordedDiagnostic):
    code = "BG506"


_UNKNOWN = {
    "input": (
        "what comes from outside by the input `{name}`",
        "Give `{name}` as an expression of time (`set` in an experiment), give its rate as another input, or filter it: "
        "`(u - y)/T` with `signal y = integral((u - y)/T, 0)`.",
    ),
    "delayed": ("the past, `{name}`", "Delay the rate instead: `delay(der(x), 1 ms)`."),
    "mode": (
        "the mode `{name}`, which an event sets at once",
        "Differentiate what the mode chooses from, `der(a) if on else der(b)`; or let an `integral` follow the mode.",
    ),
}


def no_rate(span: Span, role: str, name: str) -> NoRate:
    """Error for the rate of an input, a delayed signal or a mode."""
    what, hint = _UNKNOWN[role]
    return NoRate(
        span, f"`{span.words}` needs the rate of {what.format(name=name)}: nothing knows it", hint.format(name=name)
    )


class RateJumps(Diagnostic):
    code = "BG507"
    title = "`{words}` is the rate of what jumps, by {what} in line {line}: it would be an impulse"
    advice = (
        "Let it change within a time or a distance: `ramp` or `smoothstep3` for `step`, `tanh(x/width)` for `sign`, a `cubic` table for a `linear` "
        "one; or differentiate on each side, `der(a) if x > 0 else der(b)`."
    )
    words: str
    what: str
    line: int


def rate_jumps(span: Span, operator: str, place: Span) -> RateJumps:
    """Error for `der` of an expression with a sign, a whole number, or a choice between two numbers."""
    stairs = "`floor`, `ceil`, `mod`, `stairs` or `pwm`"
    kinds = {"select": "a step or `if`", "floor": stairs, "ceil": stairs}
    what = kinds.get(operator) or (f"`{operator}`" if operator == "sign" else f"the derivative of `{operator}`,")
    return RateJumps(span, span.words, what, place.line)


class RateWithoutEnd(Diagnostic):
    code = "BG508"
    title = "`{words}` depends on its own derivatives without end: nothing else decides what it differentiates"
    advice = (
        "Let something store it: an `integral(…)` of its rate, or a C or I in place of the law that reads the rate. "
        "A force `m*der(v)` is an `I` on the same junction."
    )
    words: str
