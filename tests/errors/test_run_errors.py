"""Codes of the errors outside a text: each stands for one sentence, lies in the range of its room, and is on the page `errors.md`."""

from __future__ import annotations

import ast
import inspect
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import BondgraphError
from tests.compiling import ROOT
from tests.conftest import Golden

RANGES = {  # folder (the deepest that holds a file counts) -> first digit of its codes, and the subject
    "analysis": (2, "equilibria, linear models, modes, responses, sensitivities, branches"),
    "analysis/inversion": (3, "inversion"),
    "studies": (4, "sweeps, Monte Carlo studies, fits, setpoints, workers"),
    "builder": (5, "models by calls"),
    "": (6, "values with units, files, targets"),
    "simulation": (7, "runs: the start, solvers, steps, events"),
    "reproduction": (8, "published values beside computed ones"),
    "results": (9, "results, plots, diagrams, pages"),
    "presentation": (9, "results, plots, diagrams, pages"),
}
PAGE = ROOT / "bondgraph" / "errors.md"


def names(error: type[BondgraphError]) -> Iterator[str]:
    """Names of a class of errors and of those derived from it."""
    yield error.__name__
    for derived in error.__subclasses__():
        yield from names(derived)


@cache
def raised() -> list[tuple[Path, ast.Call]]:
    """Calls that make an error outside the text of a model, file by file."""
    errors, raising = set(names(BondgraphError)) | {"CannotCompile"}, []
    for path in sorted((ROOT / "bondgraph").rglob("*.py")):
        calls = (c for c in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(c, ast.Call))
        for call in sorted(calls, key=lambda c: (c.lineno, c.col_offset)):
            if isinstance(call.func, ast.Name) and call.func.id in errors:
                raising.append((path.relative_to(ROOT / "bondgraph"), call))
    return raising


def words(node: ast.expr) -> str:
    """A sentence with `…` for what is filled in."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    assert isinstance(node, ast.JoinedStr), ast.dump(node)
    return "".join(str(v.value) if isinstance(v, ast.Constant) else "…" for v in node.values)


def rows() -> dict[str, set[tuple[str, ...]]]:
    """Sentence and advice by code."""
    found = defaultdict(set)
    for _, call in raised():
        code, *rest = call.args
        assert isinstance(code, ast.Constant), ast.dump(code)
        found[str(code.value)].add(tuple(words(w) for w in rest))
    return found


def page() -> str:
    lines = ["# Errors outside the text of a model", ""]
    lines += [
        "`error.code`, `error.sentence` and `error.advice` of what the calls raise; `language.md` has the codes of texts.",
        "",
    ]
    for digit, subject in sorted(set(RANGES.values())):
        lines += [f"## BR{digit}xx: {subject}", "", "| code | sentence | advice |", "|---|---|---|"]
        for code, told in sorted(rows().items()):
            if code.startswith(f"BR{digit}"):
                ((sentence, *advice),) = told
                cells = (code, sentence.rstrip(":;,."), *(advice or [""]))
                lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
        lines.append("")
    return "\n".join(lines)


def test_a_code_is_of_its_room_and_stands_for_one_sentence() -> None:
    for path, call in raised():
        code = call.args[0]
        folder = next(f for f in sorted(RANGES, key=len, reverse=True) if path.as_posix().startswith(f))
        assert isinstance(code, ast.Constant), (path, call.lineno)
        assert re.fullmatch(rf"BR{RANGES[folder][0]}\d\d", str(code.value)), (path, call.lineno)
    assert all(len(told) == 1 for told in rows().values()), {c: t for c, t in rows().items() if len(t) > 1}


def test_the_page_has_all_codes(golden: Golden) -> None:
    """`--update-golden` renews it."""
    golden(PAGE, page())


def test_an_error_has_code_sentence_and_advice() -> None:
    with pytest.raises(bondgraph.UsageError) as caught:
        bondgraph.load("plain model A { Se s { e = 1 }\nR r { e = f }\ns -> r }").montecarlo({})
    error = caught.value
    assert (error.sentence, error.advice) == ("nothing varies", "name a parameter and its distribution")
    assert str(error) == f"{error.sentence}: {error.advice}" and error.code in rows()


@pytest.mark.parametrize(
    ("call", "hint"),
    [
        (lambda m: m.simulate(experimnt=""), "`simulate` has no option `experimnt`; did you mean `experiment`?"),
        (lambda m: m.sweep({"a": "1, 2"}, tol=1e-3), "`sweep` has no option `tol`; did you mean `rtol`?"),
        (lambda m: m.montecarlo({}, sede=1), "`montecarlo` has no option `sede`; did you mean `seed`?"),
        (lambda m: m.response(stat="start"), "`response` has no option `stat`; did you mean `state`?"),
        (lambda m: m.continuation("a", 0.0, 1.0, branch=True), "`continuation` has no option `branch`; did you mean `branches`?"),
        (lambda m: m.invert({}, (), limit={}), "`invert` has no option `limit`; did you mean `limits`?"),
        (lambda m: bondgraph.Graph("A").experiment("go", 1, xyz=1), "`experiment` has no option `xyz`; it has bandwidth, name, points"),
        (lambda m: bondgraph.Graph("A").multibody("b").slide("s", "ground", "c", along=(1, 0), locks=True), "did you mean `locked`?"),
    ],
)  # fmt: skip
def test_an_unknown_option_is_named_with_the_nearest(call: Callable[[bondgraph.Model], object], hint: str) -> None:
    with pytest.raises(bondgraph.UsageError) as caught:
        call(bondgraph.load("plain model A { parameter a = 1\nSe s { e = a }\nR r { e = f }\ns -> r }"))
    assert caught.value.code == "BR614" and hint in str(caught.value)


WRONG = (3.5, "zzz", ["a"], {"a": [1]}, {"a": None}, {3: 1}, b"x", object())
NAMED = (
    "experiment",
    "settings",
    "to",
    "points",
    "outputs",
    "parameters",
    "inputs",
    "values",
    "vary",
    "state",
    "time",
    "low",
    "rtol",
)


# Slopes by a truth were 0, a branch over it passed "jumps" at 0.5, and a fit found -inf .. inf.
BY_A_TRUTH: list[Callable[[bondgraph.Model], object]] = [
    lambda m: m.sensitivity(["firm"]), lambda m: m.linearize(["firm"]), lambda m: m.continuation("firm", 0, 1), lambda m: m.sensitivity_of_run(["a", "firm"], to=1),
    lambda m: m.montecarlo({"firm": "uniform(0, 1)"}), lambda m: m.response(["firm"], ["x"]), lambda m: m.invert({"x": 1.0}, ["firm"]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("call", "code", "words"),
    [
        (lambda m: m.simulate({"a": 2}), "BR699", "`simulate` expects as `experiment` a text, not {'a': 2}; values by name are its `settings={…}`"),
        (lambda m: m.modes(settings="a=2"), "BR699", "`settings` a dict by name whose values are each a text or a number, not 'a=2'; `help(AnalysedModel.modes)`"),
        (lambda m: m.simulate(settings={"a": np.array([2.0])}), "BR699", "whose values are each a text or a number, not {'a': array([2.])}"),
        (lambda m: m.simulate(settings={"a": 10**400}), "BR699", "a text or a number, not {'a': 1000"), (lambda m: m.simulate(settings={"a": np.complex128(2 + 1j)}), "BR699", "not {'a': np.complex128(2+1j)}"),
        (lambda m: m.simulate(to=np.timedelta64(3, "s")), "BR699", "`to` a text or a number, not np.timedelta64"), (lambda m: m.simulate(rtol=np.array(1e-6)), "BR699", "`rtol` a number, not array(1.e-06)"),
        (lambda m: m.simulate_many({"a": [1, 2]}), "BR699", "a list whose items are each a dict by name"),
        (lambda m: m.simulate("", {}, 1, 11, None, False, False, 3), "BR696", "takes `experiment`, `settings`, `to`, `points`,"),
        (lambda m: m.sweep(), "BR697", "`sweep` needs `values`, a dict by name"),
        (lambda m: m.simulate("", experiment=""), "BR698", "gets `experiment` twice"),
        (lambda m: m.sensitivity(["n"]), "BR276", "`n` decides which parts"), (lambda m: m.linearize(["n"]), "BR276", "`sweep`"),
        (lambda m: m.continuation("n", 1, 3), "BR276", "`n`"), (lambda m: m.sensitivity_of_run(["n"]), "BR276", "`n`"),
        (lambda m: m.sensitivity(["kind"]), "BR277", "one of the words soft, hard"), (lambda m: m.linearize(["kind"]), "BR277", "nothing between them"), (lambda m: m.montecarlo({"kind": "uniform(1, 2)"}), "BR277", "`sweep`"),
        *((call, "BR277", "`firm` is one of the words true, false, and has nothing between them") for call in BY_A_TRUTH),
        (lambda m: m.sweep({"kind": ["soft", "thick"]}), "BR499", "`kind` cannot be `thick`; it can be soft, hard"),
    ],
)  # fmt: skip
def test_a_wrong_kind_of_argument_is_told(call: Callable[[bondgraph.Model], object], code: str, words: str) -> None:
    with pytest.raises(bondgraph.UsageError) as caught:
        call(bondgraph.load(COUNTED))
    assert caught.value.code == code and words in str(caught.value), str(caught.value)


COUNTED = """plain model A {
  parameter a = 1, n = 2, kind: { soft, hard } = soft, firm = true
  I m : p = f { start f = 1 }
  C c : e = a*q*(1 if kind == soft else 9)*(1 if firm else 2)
  1 j
  j -> m, c
  for i in 1..n { R r[i] : e = 0.1*f/n; j -> r[i] }
  output x = c.q
}"""


@pytest.mark.parametrize(
    "name",
    [
        "simulate",
        "sweep",
        "montecarlo",
        "fit",
        "modes",
        "response",
        "invert",
    ],
)
def test_no_argument_of_a_call_ends_in_an_error_of_python(name: str) -> None:
    model = bondgraph.load(COUNTED)
    call = getattr(model, name)
    needed = {
        "values": {"a": [1.0]},
        "vary": {"a": "uniform(1, 2)"},
        "data": "none.csv",
        "parameters": {"a": ""},
        "targets": {"x": 1},
    }
    known = inspect.signature(call).parameters
    for argument in [p for p in NAMED if p in known]:
        for wrong in WRONG:
            values = {n: v for n, v in needed.items() if n in known and known[n].default is inspect.Parameter.empty}
            if name == "invert":
                values["inputs"] = ["a"]
            try:
                call(**values | {argument: wrong})
            except (bondgraph.BondgraphError, bondgraph.CompilationFailed, OSError) as error:
                assert len(str(error)) > 10
            except Exception as error:
                pytest.fail(f"{name}({argument}={wrong!r}): {error!r}")


def test_a_sweep_takes_words_and_counts_have_no_slope_unless_asked() -> None:
    model = bondgraph.load(COUNTED)
    found = model.sweep({"kind": "soft, hard", "n": [1, 2]}, of="modes")
    np.testing.assert_allclose(found.table()[:, 2] * 2 * np.pi, [1, 1, 3, 3], rtol=1e-12)
    assert model.sensitivity().parameters == ("a",)
