"""Words of the language, one table: what colours, completion and hover texts say of each of them.

Words of the grammar, kinds of elements, parts, domains, functions, units and analysis steps are the compiler's own tables; only sentences on them stand here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from compiler import api


@dataclass(frozen=True, slots=True)
class Keyword:
    """A word that begins a statement, or stands within one. `place`: file, model, experiment, mechanism, sampling, attribute or expression."""

    word: str
    place: str
    snippet: str
    text: str


_ROWS = (
    Keyword("import", "file", "import ${1:Name} from ${2:library}", "Models of a library, `from electric`, or of a file beside this one, `from \"parts.bg\"`."),
    Keyword("model", "file", "model ${1:Name} {\n  $0\n}", "A model: quantities, elements, bonds, experiments."),
    Keyword("plain", "file", "plain model ${1:Name} {\n  $0\n}", "`plain model` has bare numbers only, without units."),
    Keyword("parameters", "file", "parameters ${1:Name} {\n  $0\n}", "Named values, which an instance takes at once: `Beam b { parameters = Steel }`."),
    Keyword("constant", "file model", "constant ${1:name} = ${0:1}", "A value that is not to be set from outside."),
    Keyword("function", "file model", "function ${1:f}(${2:x}) = $0", "A name for an expression of its arguments."),
    Keyword("parameter", "model", "parameter ${1:name} = ${0:1}", "A value known before the run, which an instance, an experiment or `--set` may set."),
    Keyword("input", "model", "input ${1:name} = ${0:0}", "A signal from outside; the value is what holds without it."),
    Keyword("signal", "model", "signal ${1:name} = $0", "A name for an expression that may change during a run."),
    Keyword("output", "model", "output ${1:name} = $0", "A signal that runs report."),
    Keyword("mode", "model", "mode ${1:on} = ${0:false}", "A number, a truth or one of several words, which only events change; the value is its start."),
    Keyword("solve", "model", "solve ${1:x^3 + x} = ${2:1} for ${3:x} = ${0:1}", "A number that makes an equation true; the value is a guess near it."),
    Keyword("port", "model", "port ${1:name}: ${2:translation}", "A port of the model, through which it is bonded where it is used."),
    Keyword("multibody", "model", "multibody ${1:name} : ${2|planar,spatial|} {\n  $0\n}", "A mechanism of bodies and joints."),
    Keyword("for", "model mechanism", "for ${1:i} in 1..${2:3} {\n  $0\n}", "Repeats what stands in its braces."),
    Keyword("when", "model", "when ${1:condition} { ${2:name} = $0 }", "An event: when the condition becomes true, the assignments are made."),
    Keyword("every", "model", "every ${1:1 ms} { ${2:name} = $0 }", "Assignments at each multiple of a time."),
    Keyword("offset", "sampling", "offset ${0:0.2 ms}", "So much later than the multiples of the period."),
    Keyword("delay", "sampling", "delay ${0:0.2 ms}", "Time of the computation: what a sample assigns holds so much later."),
    Keyword("jitter", "sampling", "jitter ${0:10 us}", "Each sample is late by a random time of up to so much."),
    Keyword("seed", "sampling", "seed ${0:1}", "Which random numbers the jitter takes."),
    Keyword("require", "model", "require ${1:condition} \"${0:why}\"", "A condition under which the model is valid; a run says when it fails."),
    Keyword("experiment", "model", "experiment ${1:name} {\n  $0\n}", "What a run sets, simulates and reports."),
    Keyword("set", "experiment", "set ${1:name} = $0", "A value, or a signal of time, for a parameter or an input."),
    Keyword("start", "experiment attribute", "start ${1:name} = $0", "Where what is stored, or a coordinate, begins."),
    Keyword("simulate", "experiment", "simulate 0 .. ${0:1 s}", "A run over time; in braces `rtol`, `points`, `solver`, `tolerance`."),
    Keyword("report", "experiment", "report ${1:name} in ${0:unit}", "Outputs, or anything that can be read, in units."),
    Keyword("sweep", "experiment", "sweep ${1:name} = $0", "Values that a parameter, or a name of the experiment, takes one after the other."),
    Keyword("stop", "experiment", "stop when ${0:condition}", "Ends the run when the condition becomes true."),
    Keyword("bandwidth", "experiment", "bandwidth ${0:1 kHz}", "Modes that ring faster need not be followed."),
    Keyword("nominal", "attribute", "nominal ${1:x} = $0", "A typical magnitude, for tolerances."),
    Keyword("prefer", "attribute", "prefer = ${0|integral,derivative,effort,flow|}", "What the element should decide if there is a choice."),
    Keyword("require", "attribute", "require = ${0|integral,derivative,effort,flow|}", "What the element must decide; an error if it cannot."),
    Keyword("active", "attribute junction", "active = $0", "A junction that is on while this holds."),
    Keyword("gravity", "mechanism", "gravity = (0, -9.81 [m/s^2])", "Acceleration of free fall."),
    Keyword("rtol", "simulate", "rtol = ${0:1e-8}", "Relative tolerance."),
    Keyword("atol", "simulate", "atol = $0", "Absolute tolerance."),
    Keyword("accuracy", "simulate", "accuracy = ${0:1e-6}", "The tolerance is chosen so that outputs have this error."),
    Keyword("points", "simulate", "points = ${0:101}", "Number of reported instants."),
    Keyword("solver", "simulate", "solver = ${0:automatic}", "Integration method."),
    Keyword("tolerance", "simulate", "tolerance ${1:state} = $0", "Absolute tolerance of one state."),
    Keyword("from", "import", "from", "The library or the file of an import."),
    Keyword("to", "words", "to", "What a joint joins; what an analysis looks for."),
    Keyword("in", "words", "in", "The unit of a report; the range of a `for`."),
    Keyword("over", "words", "over", "The range of an analysis."),
    Keyword("if", "expression", "if", "`a if condition else b`."),
    Keyword("else", "expression", "else", "`a if condition else b`."),
    Keyword("and", "expression", "and", "Both conditions hold."),
    Keyword("or", "expression", "or", "One of the conditions holds."),
    Keyword("not", "expression", "not", "The condition does not hold."),
    Keyword("true", "value", "true", "A condition that holds."),
    Keyword("false", "value", "false", "A condition that does not hold."),
    Keyword("time", "value", "time", "Time of the run, in s."),
    Keyword("pi", "value", "pi", "3.14159…"),
    Keyword("ground", "value", "ground", "The world of a mechanism, to which joints may fix bodies."),
)  # fmt: skip
_ANALYSES = {
    "equilibrium": "Where the model is at rest.",
    "modes": "Eigenmodes at rest: frequencies, dampings, where their energy is.",
    "bode": "Frequency responses of all inputs and outputs.",
    "response": "Frequency response: `response volt to u over 1 Hz .. 10 kHz`.",
    "linearize": "A, B, C, D at rest: `linearize volt to x`.",
    "sensitivity": "Exact derivatives by parameters: `sensitivity k, gap`.",
    "continue": "Rest against a parameter, around folds: `continue volt over 0 V .. 5 V`.",
    "invert": "Inputs that hold outputs at values or lead them along a path: `invert volt to x = 1 um`.",
    "montecarlo": "Tolerances: `montecarlo k = normal(8 [N/m], 0.2 [N/m])`.",
    "fit": 'Parameters from measured data: `fit k = 1 [N/m] .. 20 [N/m] to "pulls.csv"`.',
}
KEYWORDS: tuple[Keyword, ...] = (
    *_ROWS,
    *(Keyword(word, "experiment", word, _ANALYSES.get(word, "An analysis.")) for word in api.ANALYSIS_STEPS),
)

_KINDS = {
    "Se": "Source of effort: its law gives the effort, in numbers, parameters and time.",
    "Sf": "Source of flow: its law gives the flow.",
    "C": "Stores displacement: a spring, a capacitor.",
    "I": "Stores momentum: a mass, an inductor.",
    "IC": "Storage field: ports that store displacement beside ports that store momentum.",
    "R": "Dissipates: its law relates effort and flow.",
    "RS": "As R; its last port, a thermal one, gives what the others lose.",
    "Mem": "Memristor: as R, with its own displacement or momentum in its law.",
    "TF": "Transformer: relates two efforts or two flows; power gives the other equation.",
    "GY": "Gyrator: relates an effort and a flow; power gives the other equation.",
}
JUNCTIONS = {
    "0": "0-junction: one effort for all bonds; the flows add up to zero.",
    "1": "1-junction: one flow for all bonds; the efforts add up to zero.",
    "splitter": "A multibond on one side, its bonds one by one on the other.",
}


def kind_text(kind: str) -> str:
    """A sentence on a kind of element, with an example of its law; empty for other words."""
    row = api.ELEMENTS.get(kind)
    if row is None:
        return JUNCTIONS.get(kind, "")
    more = " Its law also reads signals, inputs and other elements." if kind != row.letters else ""
    return f"{_KINDS[row.letters]}{more}\n\n`{kind} name : {row.example}`"


def classes() -> Mapping[str, tuple[str, ...]]:
    """All words by their class, for colours: `keyword`, `operator`, `value`, `timing`, `attribute`, `kind`, `domain` and `function`.

    A word may have two classes, as `delay`, and none of them is reserved for it.
    """
    operators = ("if", "else", "and", "or", "not", "in", "to", "over")
    values = ("true", "false", "time", "pi", "ground")
    timing = ("offset", "delay", "jitter", "seed")
    joints = dict.fromkeys([*api.kinds_of(True), *api.kinds_of(False)])
    return {
        "keyword": tuple(w for w in api.grammar_words() if w not in (*operators, *timing, *values)), "operator": operators, "value": values,
        "timing": timing, "attribute": _attributes(), "kind": (*api.ELEMENTS, "splitter", *joints),
        "domain": (*api.DOMAINS, "planar", "spatial"), "function": (*USAGES, "correlation"),  # of two chances
    }  # fmt: skip


def _attributes() -> tuple[str, ...]:
    """Names left of `=` in braces: those of the table above, of parts of mechanisms, of analysis steps."""
    words = [k.word for k in KEYWORDS if k.place.split()[0] in ("attribute", "simulate", "mechanism")]
    words += [w for planar in (True, False) for kind in api.kinds_of(planar) for w in api.attributes_of(kind, planar)]
    for step in api.ANALYSIS_STEPS.values():
        words += [*(name for name, _, _ in step.counts), *step.truths, *step.named]
    return tuple(dict.fromkeys(words))


USAGES: Mapping[str, str] = {
    **{name: usage for name, (_, usage, _) in {**api.FUNCTIONS, **api.VECTORS}.items()},
    **api.MEMORIES,
    **api.TABLE_USAGES,
}
FUNCTION_TEXTS: Mapping[str, str] = {
    "step": "0 before the argument is zero, 1 from then on.",
    "pulse": "1 from the second argument to the third, else 0.",
    "ramp": "From 0 to 1, straight, between the second argument and the third.",
    "chirp": "sin(2 pi (f0 t + (f1 - f0) t^2/(2 t1))).",
    "integral": "A signal with memory: the integral of its rate over time, from its start.",
    "delay": "The signal so long ago; the time is known before the run.",
    "der": "The exact rate of an expression: its derivative by time.",
    "hysteresis": "A relay with memory: true from above the second limit on, false from below the first.",
    "linear": "A curve through points, straight between them.",
    "cubic": "A smooth curve through points.",
    "monotone": "A smooth curve through points without overshoot.",
    "column": "A column of a file of numbers, as a list.",
    "noise": "Reproducible random numbers between -1 and 1.",
    "polar": "A point by its distance and its angle.",
    "rotate": "A point turned by an angle.",
    "log": "The natural logarithm, as `ln`.",
    **{f"smoothstep{n}": f"From 0 to 1 by a polynomial of degree {n}." for n in (3, 5, 7, 9)},
}
