"""Lines as users of 20-sim, Modelica, SPICE, MATLAB and Python write them, with the line that is meant here."""

from __future__ import annotations

import re

_ARROW = "A bond is an arrow that points where power counts as positive:"
_START = "A start is an attribute of its element, or a step of an experiment:"
_TYPE = "(?:[Rr]eal|[Ff]loat|[Dd]ouble|[Ii]nt(?:eger)?)"
_TYPED = (
    "A parameter has a unit instead of a type, `parameter {a} = 3 [N/m]`; what changes is a signal, `signal {a} = …`"
)
_NAMED = f"{_TYPED}, what events change a mode,"
_PLACE = r"[\w.\[\]]+"
_SETTINGS = "rtol|atol|reltol|abstol|tolerance|accuracy|points|solver|method|bandwidth"
_END_OF_RUN = "run|sim|simulate|stop|duration|until|time|end|[Tt]_?(?:end|stop)|[Ss]top_?[Tt]ime"
# Pattern of what is written, advice with its groups. The first row that covers the place of the error counts.
_IN_AN_EXPERIMENT = (
    (
        r"\bsimulate\s+(?P<a>[\d.e]+)\s*:(?:[^:;{}]+:)?\s*(?P<b>[\d.e]+)[^;{}]*",
        "A run goes from a time to a time: `simulate {a} .. {b} s`.",
    ),
    (
        r"\bsimulate\s+(?P<a>[^.;{}]+?)\s+to\s+(?P<b>[^;{}]+)",
        "A run goes from a time to a time: `simulate {a} .. {b}`.",
    ),
    (r"\b(?:run|sim|time|tspan)\b\s*=?\s*(?P<a>[^=;{}]+?\.\.[^;{}]+)", "A run is `simulate {a}`."),
    (
        rf"(?:^|[;{{])\s*(?:{_END_OF_RUN})\b\s*(?:for\b|time\b|until\b)?\s*=?\s*(?P<a>\d(?:(?!\.\.)[^,;{{}}])*?)\s*(?=[;}}]|$)",
        "A run goes from a time to a time: `simulate 0 .. {a}`.",
    ),
    (
        r"\bsimulate\b[^;{}]*\s(?:step|dt)\b.*",
        "The solver chooses its steps; `--points 501` chooses how many instants are reported.",
    ),
    (
        r"\bsimulate\b[^;{}]*\s(?P<a>report|set|modes|sweep)\b.*",
        "Steps of an experiment stand on lines of their own, or `;` is between them: `; {a} …`.",
    ),
    (
        rf"(?:^|[,;{{])\s*(?P<a>{_SETTINGS})\b[^;{{}}]*",
        "Settings of a run stand in braces behind it: `simulate 0 .. 1 s {{ rtol = 1e-8, points = 501 }}`.",
    ),
    (r"\b(?:plot|show|save|print|log|output|record)\s+(?P<a>[^;{}]+)", "Results are chosen by `report {a}`."),
    (r"\breport\s+(?P<a>\S+)\s+(?:as|unit)\s+(?P<b>\S+)", "A unit follows the word `in`: `report {a} in {b}`."),
    (
        r"\bsweep\s+(?P<a>[\w.\[\]]+)\s*(?:=|from|in)\s*(?P<b>[^;{},]+?)\s*(?:\.\.|to)\s*(?P<c>[^;{},]+)",
        "The values of a sweep are listed, each with its unit: `sweep {a} = {b}, {c}`.",
    ),
    (r"(?:^|[;{])\s*(?:initial|init)\s+(?P<a>[\w.\[\]]+\s*=\s*[^;{}]+)", "Where a run begins is told by `start {a}`."),
    (
        r"(?:^|[;{])\s*(?:(?:parameter|param|input|let)\s+)?(?P<a>[\w.\[\]]+\s*=\s*[^=;{}]+)",
        "A step of an experiment sets parameters and inputs by `set {a}`, and where a run begins by `start`.",
    ),
)
_ROWS = (
    (r"\bstart\s+(?P<a>-?\d[^;{},]*)", "A start names what it is of: `start x = {a}`."),
    (r"^\s*output\s+(?P<a>\w+)\s*=\s*(?P<b>.+?)\s+in\s+(?P<c>\S+)$", "The unit stands behind the name: `output {a}: {c} = {b}`."),
    (r"\((?P<a>[^()]*)\)\s*(?P<b>[a-z]{1,2})\b(?!\s*[=(])", "Each item of a list has its unit: `({a} {b})`."),
    (
        r"^\s*(?:[Ss]tring|(?:parameter|constant)(?=[^\"]*'))\s+(?P<a>\w+)\s*=\s*[\"'](?P<b>[^\"']*).*",
        "A parameter that is a text has it in quotation marks: `parameter {a} = \"{b}\"`.",
    ),
    (r"^\s*[01]\s+\w+\s*:\s*(?:three|3)\b.*", "Three phases are a bond of width three: `0 node : electric[3]`."),
    (r"^\s*(?:/\*|\*|--|%|;).*|//", "A comment begins with `#`."),
    (r"^\s*simulate\b.*", "It belongs into an experiment: `experiment run {{ simulate 0 .. 1 s }}`."),
    (r"^\s*when\b.*\b(?P<a>offset|delay|jitter|seed)\b.*", "A `when` acts at the instant at which its condition becomes true; `{a}` is a word of `every`."),
    (r"^\s*solve\s+(?P<a>\w+)\s*:\s*(?P<b>.+)", "The unknown stands behind its equation, with a guess: `solve {b} for {a} = 0`."),
    (r":=", "An equation is written `=`."),
    (r"^\s*\.tran\s+\S+\s+(?P<a>\d+)(?P<b>[munp]?)s?\b.*", "A run is a step of an experiment: `experiment run {{ simulate 0 .. {a} {b}s }}`."),
    (r"^\s*\.(?:ac|op|dc)\b.*", "An analysis is a step of an experiment: `response`, `modes`, `equilibrium`."),
    (r"^\s*\.param\s+(?P<a>\w+)\s*=\s*(?P<b>\S+).*", "A number with a name is declared: `parameter {a} = {b}`."),
    (r"^\s*\.(?:ic)\b.*", f"{_START} `{{{{ start u = 0 V }}}}`."),
    (r"^\s*\.(?:print|plot|probe|save)\b.*", "What is to be seen is an output, `output u = load.u`, and an experiment reports it: `report u in mV`."),
    (r"^\s*\.\w+.*", "Statements stand between the braces of `model Name {{ … }}`; elements have laws: `R wire : u = 10 [kohm]*i`."),
    (r"^\s*[VI]\d+\s+\w+\s+\w+\s+\S+.*", "A source has a kind, a name and a law, `Se supply : u = 5 V*sin(2*pi*50 Hz*time)`; bonds join it: `supply -> node`."),
    (r"^\s*[RCLDQMX]\d+\s+\w+\s+\w+\s+\S+.*", "An element has a kind, a name and a law, `R wire : u = 10 [kohm]*i`; bonds join it: `node -> wire`."),
    (r"<>|~=", "Two numbers are compared by `!=`."),
    (r"~(?=\s*[\w(])", "A negation is the word `not`: `not (a > b)`."),
    (r"\.[*/^]", "Operators have no point before them: `a*b`, `a^2`, on each item of a list too."),
    (r"\+\+|--\s*$|^\s*\w+\s*[-+*/]=.*", "What counts is a `mode` that an event sets: `mode n = 0; when x > 1 {{ n = n + 1 }}`."),
    (r"^\s*(?:variables|parameters|constants)\s+real\b(?:\s+global)?\s*(?P<a>\w+).*", f"{_TYPED}."),
    (r"^\s*(?:parameter|constant)\s+[A-Z]\w*(?:\.\w+)+\s+(?P<a>\w+).*", "A parameter has a unit instead of a type: `parameter {a} = 3 [N/m]`."),
    (
        r"^\s*(?:discrete\s+)?[Bb]ool(?:ean)?\s+(?P<a>\w+).*",
        "A truth that events change is a mode, `mode {a} = false`; one that follows from others a signal, `signal {a} = x > 1`.",
    ),
    (
        rf"(?:^\s*{_TYPE}\s+(?:global\s+)?|^\s*)(?P<a>\w+)\s*=\s*\{{?\s*(?P<b>[\w.+-]+)\s*(?:\{{|,\s*')(?P<unit>[^'{{}}]+)['}}].*",
        "A number has its unit in brackets behind it: `parameter {a} = {b} [{unit}]`.",
    ),
    (
        rf"^\s*{_TYPE}\s+(?:global\s+)?(?P<a>\w+)\s*=\s*(?P<b>.+)",
        "A number with a name is declared, `parameter {a} = {b}`; what changes is a signal, `signal {a} = …`.",
    ),
    (rf"^\s*(?:discrete\s+)?{_TYPE}\s+(?P<a>\w+)\s*(?:[;(].*)?$", f"{_NAMED} `mode {{a}} = 0`."),
    (r"^\s*(?:flow|stream)\s+\w+.*", "Effort and flow belong to a port: `port a: electric`."),
    (r"^\s*(?:replaceable|redeclare)\s+(?P<a>\w+)\s+(?P<b>\w+).*", "A model that can be replaced is a slot: `parameter Kind: model = {a}`, then `Kind {b}`."),
    (r"^\s*(?:inner|outer)\s+\w+.*", "What all models of a file share is a `constant` of the file."),
    (r"^\s*extends\s+(?P<a>\w+).*", "A model contains others: an instance is declared as `{a} part`, and its ports are bonded."),
    (r"^\s*(?:disp|f?printf?)\s*\(.*", "What is to be seen is an output, `output y = mass.v`, and an experiment reports it."),
    (r"^\s*\[.*\]\s*=\s*ode\w+\s*\(.*", "A run is a step of an experiment: `experiment run {{ simulate 0 .. 5 s }}`."),
    (r"^\s*while\b.*", "What goes on until something happens is a `when`: `when x > 1 {{ … }}`; an experiment ends by `stop when x > 1`."),
    (r"^\s*else?\s*if\b.*", "Conditional parts are `if n > 1 {{ … }} else if n > 0 {{ … }} else {{ … }}`."),
    (r"^\s*function\s+\w+\s*=.*|^\s*\w+\s*=\s*@\s*\(.*", "A function is one expression: `function f(x) = 2*x`."),
    (r"(?P<a>\w+)\{\s*(?P<b>\d+)\s*\}", "An item of an array has an index in brackets: `{a}[{b}]`."),
    (r"^\s*every\s+[^{]*\{?", "The words of an `every` are `offset`, `delay`, `jitter` and `seed`: `every 1 ms offset 0.2 ms {{ … }}`."),
    (r"^\s*when\b.*(?:\bthen\b|:).*", "An event is `when condition {{ name = value }}`; it sets what elements store, modes and integrals."),
    (r"(?:=\s*if\b|\bif\b.*\bthen\b|\?).*", "A choice is `a if condition else b`."),
    (r"\breinit\s*\(\s*(?P<a>[\w.]+)\s*,\s*(?P<b>[^;]*)\)", "An event sets by an equation, whose right side reads the values before it: `{a} = {b}`."),
    (r"^\s*\}?\s*else?when\b.*", "Each condition has a `when` of its own: `when x > 1 {{ … }}`."),
    (r"[&|].*", "Conditions are joined by `and` and `or`, and `not` negates one."),
    (rf"^\s*(?P<a>{_PLACE})\s*<-+\s*(?P<b>{_PLACE})", f"{_ARROW} `{{b}} -> {{a}}`."),
    (rf"^\s*(?P<a>{_PLACE})\s*(?:<->|<=>|-+)\s*(?P<b>{_PLACE})\s*$", f"{_ARROW} `{{a}} -> {{b}}`."),
    (
        rf"^\s*(?P<a>{_PLACE})\s+-+\s+(?P<b>{_PLACE})(?:\s+-+\s+{_PLACE})+\s*$",
        f"{_ARROW} `{{a}} -> {{b}}`; what shares a flow stands at a 1-junction, `{{a}} -> 1({{b}}, …)`.",
    ),
    (rf"(?:^|[;{{])\s*\w+\s+\w+\s*:\s*(?P<a>{_PLACE})\s*(?:<?-+>?|,|and)\s*(?P<b>{_PLACE}).*", "A joint leads from one body to another: `{a} to {b}`."),
    (rf"^\s*connect\b[\s(]*(?P<a>{_PLACE})\s*,?\s*(?P<b>{_PLACE}).*", f"{_ARROW} `{{a}} -> {{b}}`."),
    (r"(?P<a>[A-Z]\w*)'", "A transposed matrix is `transpose({a})`."),
    (
        r"^\s*der\s*\(\s*(?P<a>\w+)\s*\)\s*=\s*(?P<b>[^;]+).*",
        "What has a rate of its own is a signal, `signal {a} = integral({b}, start)`, or in an element: `I mass : p = m*v`, `C spring : F = k*x`.",
    ),
    (
        r"^\s*(?P<c>[\w.]+)\s*\*\s*der\s*\(\s*(?P<a>\w+)\s*\)\s*=\s*(?P<b>[^;]+).*",
        "What has a rate of its own is in an element, `I mass : p = {c}*{a}`, or a signal, `signal {a} = integral(({b})/{c}, start)`.",
    ),
    (r"^\s*der\s*\(.*|\w'", "Rates are read from elements: the flow of a C is the rate of its displacement, the effort of an I that of its momentum."),
    (r"^\s*(?:equation|algorithm|begin|end|annotation|protected|public)\b.*", "Statements stand between the braces of `model Name {{ … }}`, in any order."),
    (r"^\s*(?:initial|start|init)\s+\w+\.(?P<b>\w+)\s*=\s*(?P<c>.+)", f"{_START} `{{{{ start {{b}} = {{c}} }}}}`."),
    (r"\b\w+\.(?P<b>\w+)\s*\(0\)\s*=.*", f"{_START} `{{{{ start {{b}} = … }}}}`."),
    (r"^\s*p\d?\.[ef]\s*=.*", "An element has its law in its own variables behind a colon: `C spring : e = k*q`, `R damper : e = r*f`."),
    (r"^\s*M?(?:TF|GY)\s+(?P<a>\w+)\s*:[^;]*;.*", "One equation says it, `GY {a} : e1 = K*f2` or `TF {a} : f1 = n*f2`; power gives the other one."),
    (r"^\s*\w+\.(?P<b>\w+)\s*=.*", f"What drives is a source, `Se` or `Sf`. {_START} `{{{{ start {{b}} = … }}}}`."),
    (r"^\s*(?P<a>[01])\s*-?\s*[Jj]unction\s+(?P<b>\w+)", "A junction is declared by its number: `{a} {b}`."),
    (r"^\s*[A-Za-z]\w*(?:\s+\d+){2,}.*", "An element has a kind, a name and a law, `R wire : u = 10 [kohm]*i`; bonds join it: `node -> wire`."),
    (
        r"^\s*(?:def\s+|function\s+)(?P<a>\w+\s*\([^)]*\))\s*[:={]+\s*(?:return\s+)?(?P<b>[^}\s][^}]*?)\s*\}?\s*$",
        "A function is one expression: `function {a} = {b}`.",
    ),
    (r"^\s*(?:def\s+|function\s+)(?P<a>\w+\s*\([^)]*\)).*", "A function is one expression: `function {a} = 2*x`."),
    (r"^\s*for\s*\(?\s*(?P<a>\w+)\s*(?:=|in)\s*(?P<b>\w+)\s*(?::|\.\.|\bto\b)\s*(?P<c>\w+).*", "A loop is `for {a} in {b}..{c} {{ … }}`."),
    (r"^\s*for\s*\(?\s*(?P<a>\w+)\s+in\s+range\s*\(\s*(?P<b>\w+)\s*\).*", "A loop counts from one number to another: `for {a} in 1..{b} {{ … }}`."),
    (r"(?P<a>[\w.]+)\s*\\\s*(?P<b>[\w.]+|[\[(].*?[\])])", "A linear system is solved by `solve({a}, {b})`."),
    (r"\[[^\[\]]*;.*", "The rows of a matrix stand in brackets of their own: `[[1, 2], [3, 4]]`."),
    (
        r"^\s*(?P<a>[A-Za-z]\w*)\s*=\s*[\[{].*",
        "A list or matrix is a parameter, with commas, its rows in brackets of their own: `parameter {a} = [[1, 2], [3, 4]]`.",
    ),
    (r"=\s*[\[{].*", "A list stands in parentheses or brackets, with commas: `(1, 2, 3)`, `[1, 2, 3]`; a matrix is a list of rows, `[[1, 2], [3, 4]]`."),
    (r"(?<![\w.(])(?P<a>\d+),(?P<b>\d+)", "A number has a point: `{a}.{b}`."),
    (r"\b(?:Math|math|np|numpy|Modelica)\.(?P<a>\w+)\s*\(", "A function stands alone: `{a}(…)`."),
    (r"(?<![\w.])(?P<a>\d+)(?P<b>[A-Za-z_]\w*\.\w+)", "A product is written with `*`: `{a}*{b}`."),
    (r"^\s*(?P<a>[\w\[\]]+)\s*:\s*(?P<b>Se|Sf|C|I|R|TF|GY)\b\s*:?\s*(?P<c>.*)", "The kind comes first: `{b} {a} : {c}`."),
    (r"^\s*(?P<a>\w+)\s*:\s*(?P<b>[A-Z]\w*).*", "The part comes first: `{b} {a}`; its parameters stand in braces, `{b} {a} {{ r = 10 ohm }}`."),
    (r"^\s*(?P<a>M?Se|M?Sf|C|I|R|TF|GY)\s+(?P<b>\w+)\s*=.*", "An element has a law behind a colon: `Se {b} : u = 5 V`, `I {b} : p = m*v`."),
    (rf"^\s*parameter\s+{_TYPE}\s+(?P<a>\w+)", "A parameter has a unit instead of a type: `parameter {a} = 100 [N/m]`."),
    (r"^\s*(?P<c>[A-Z]\w*)\s+(?P<a>\w+)\s*\(\s*(?P<b>\w+\s*=\s*[^(),]+).*", "Parameters of a part stand in braces: `{c} {a} {{ {b} }}`."),
    (r"^\s*(?P<c>[A-Z]\w*)\s+(?P<a>\w+)\s*\(\s*[\d.].*", "Parameters of a part stand in braces, with their names: `{c} {a} {{ r = 10 ohm }}`."),
    (r"(?P<a>[\d.]+)\s*(?P<b>[A-Za-z]\w*)\.(?P<c>[A-Za-z]\w*)", "A product of units is written with `*`: `{a} {b}*{c}`."),
    (r"^\s*(?:component|submodel|class|block)\s+(?P<a>\w+).*", "It is written `model {a} {{ … }}`."),
    (
        r"^\s*(?:nodes|inputs|outputs|variables|parameters|equations?)\s*$",
        "Each line says itself what it is: `port a: electric`, `input u = 0`, `parameter k = 100 [N/m]`, `signal y = …`; laws "
        "stand behind their elements.",
    ),
    (r"^\s*(?P<a>\w+)\s*=\s*foundation\..*", "Where parts meet is a port, with its domain: `port {a}: translation`."),
    (
        r"^[^=]*=\s*(?:tf|zpk|ss)\s*\(.*",
        "A transfer function is a part, `import TransferFunction2 from control`, a state space a signal, `signal x = integral(A*x + B*u, x_0)`.",
    ),
    (
        r"^\s*(?i:source|resistor|inductor|capacitor|inertia|mass|spring|damper|gyrator|transformer)\s+(?P<b>\w+)\s*=.*",
        "An element has its letters, a name, and a law behind a colon: `Se {b} : u = 5 V`, `R {b} : u = 2 ohm*i`, `I {b} : p = 3 kg*v`.",
    ),
    (r"^\s*(?P<a>parameter|constant|output|signal|input)\s+(?P<b>[\w\[\]]+)\s+in\s+(?P<c>[^\s=]+)", "A unit stands behind a colon: `{a} {b}: {c}`."),
    (r"(?<![\w.])(?P<a>[01])\s+\(", "A junction in place has no blank before its bracket: `{a}(spring, damper)`."),
    (r"^\s*const(?:ants?)?\s+(?P<a>\w+)\s*=\s*(?P<b>.*)", "It is written `constant {a} = {b}`."),
    (
        rf"^\s*(?:(?:param(?:eter)?s?|{_TYPE}|[Vv]ar(?:iable)?s?|let)\s+)?(?P<a>\w+)\s*=(?=\s*(?P<b>[^={{}}]+)$)",
        "A number with a name is declared, `parameter {a} = {b}`; what changes is a signal, `signal {a} = …`.",
    ),
)  # fmt: skip
LONGEST = 400  # characters of a line that is looked at


def advice_on(line: str, column: int, in_experiment: bool) -> str:
    """Return the advice for a line with an error at a column (from 0), if it is written as in another language; else an empty text."""
    text = line[:LONGEST].partition("#")[0].rstrip()
    for pattern, advice in (
        *_IN_AN_EXPERIMENT * in_experiment,
        *_ROWS,
    ):  # which `re` compiles at the first error, and keeps
        for match in re.finditer(pattern, text):
            if match.start() <= column <= match.end() + 1:
                words = {name: text.strip() for name, text in match.groupdict("").items()}
                return advice.format(**words | {"unit": words.get("unit", "").replace(".", "*")})
    return ""
