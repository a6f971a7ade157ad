"""Stepping in machine code against the same source over numpy: the same steps, the same errors, the same words; and bit by bit as it is."""

from __future__ import annotations

import signal
import threading
import time as clock
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("llvmlite")

import bondgraph
from bondgraph.compiled_scene import HIDDEN
from bondgraph.errors import RunFailed, UsageError
from bondgraph.results.result import Result
from bondgraph.simulation.integrators import exponential
from bondgraph.simulation.integrators.compiled import fields, pilot_run, sources
from bondgraph.simulation.integrators.compiled import run as compiled
from bondgraph.simulation.integrators.compiled.advance import advance, begin
from bondgraph.simulation.integrators.compiled.plain import Plain, functions_of
from bondgraph.simulation.integrators.linear_algebra.sparse import FINE, Pattern, real_back, real_factors
from bondgraph.simulation.integrators.methods import SHARED
from bondgraph.simulation.integrators.projection.projection import ProjectionWorkspace
from bondgraph.simulation.integrators.workspace import IntegratorWorkspace
from bondgraph.simulation.phases import tolerances
from tests.codegen.test_module import MODELS_OF_FILES
from tests.compiling import MODELS

pytestmark = pytest.mark.machine_code
STILL = {"drag.bg": ("Ball",), "feed_forward.bg": ("InverseKinematics",), "flexure.bg": ("WorldFlexure", "BodyFlexure")}
LONG = {"side_instability.bg"}  # as `end_stops.bg`
RUNNING = [
    (path, name) for path, name in MODELS_OF_FILES if name not in STILL.get(path.name, ()) and path.name not in LONG
]
# Where the law has a kink, or rounding (of a singular value, too) decides once whether a Jacobian is kept, step sequences part; both hold the tolerance.
# What moves has no mass, or nothing is done to it: its work is the error of a quadrature, or of rounding.
RESTING = {"inverse_kinematics.bg", "gyroscope.bg"}
# So they do where thousands of steps follow what rings in a stop that is met at some instant, and where a look ahead finds multipliers less closely
# (other ones where a constraint is redundant): then its magnitudes are others, and tolerances.
PARTING = {
    "duffing.bg": 0.05, "rectifier.bg": 0.05, "spatial_slider_crank.bg": 0.25, "inverse_kinematics.bg": 0.05, "end_stops.bg": 0.05, "crank_linkage.bg": 0.05,
}  # fmt: skip
REJECTING = {"sweep.bg"}  # a step more, by a difference of one unit in the last place


@pytest.fixture(autouse=True)
def nothing_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Linear models take steps too, as those with more states do."""
    monkeypatch.setattr(exponential, "linear_form", lambda *_: None)


def both(path: Path, name: str | None = None, **settings: Any) -> tuple[Result, Result]:
    model = bondgraph.load(path, name)
    return tuple(model.simulate(target=target, **settings) for target in ("native", "numpy"))  # type: ignore[return-value]


@pytest.mark.few(16)
@pytest.mark.parametrize("solver", ["radau", "automatic"])
@pytest.mark.parametrize(("path", "name"), RUNNING, ids=lambda x: x if isinstance(x, str) else x.name)
def test_models_take_the_same_steps(path: Path, name: str, solver: str) -> None:
    model = bondgraph.load(path, name)
    native = model.simulate(target="native", energy=True, solver=solver)
    if solver == "automatic" and native.solver.startswith("Radau IIA 5"):
        return  # these are the steps of the other case
    numpy = model.simulate(target="numpy", energy=True, solver=solver)
    assert native.solver.replace("native", "numpy") == numpy.solver
    if solver == "radau":
        assert native.solver in ("Radau IIA 5, native", "Newton", "none")
    assert native.warnings == numpy.warnings
    scale = np.abs(numpy.values).max(axis=0) + 1e-300
    found = (np.abs(native.values - numpy.values) / scale).max()
    assert native.energy is not None and numpy.energy is not None
    if path.name in PARTING:
        assert native.steps == pytest.approx(numpy.steps, rel=PARTING[path.name]) and found < 1e-3
        return
    assert native.steps == numpy.steps and found < 1e-6
    if numpy.energy.elements:
        rejects_more = 1e-3 if path.name in REJECTING else 0.0
        assert dict(native.evaluations) == pytest.approx(dict(numpy.evaluations), rel=rejects_more, abs=0.0)
    if path.name in RESTING:
        return
    work = max(abs(numpy.energy.supplied), abs(numpy.energy.stored), abs(numpy.energy.dissipated))
    for kind in ("supplied", "stored", "dissipated", "residual"):
        assert getattr(native.energy, kind) == pytest.approx(getattr(numpy.energy, kind), rel=1e-3, abs=1e-9 * work)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_sizes_and_errors_of_all_steps(rtol: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ends of steps and error estimates, one by one.

    The first step behind an instant is so short that its estimate is 1e-4 tolerances. Stiff springs make 1e-5 tolerances of it from states that differ by
    1e-13, by the order of sums: 7 %, but nothing beside the tolerance. Later sizes differ by 1e-4 of themselves for that, and an estimate, of order 4, by
    some times as much.
    """
    seen: dict[str, list[tuple[float, Any]]] = {"native": [], "numpy": []}
    original = compiled.CompiledMethod.advance

    def one(solver: compiled.CompiledMethod, most: int, *through: compiled.Advance | None) -> int:
        answer = original(solver, 1, *through)
        seen["native" if solver.native else "numpy"].append((solver.last_step[1], np.array(solver.error)))
        return answer

    monkeypatch.setattr(compiled.CompiledMethod, "advance", one)
    both(MODELS / "manipulator.bg", rtol=rtol, solver="radau")
    assert len(seen["native"]) == len(seen["numpy"]) > 30
    began = (0.0, 0.0)
    for (here, error), (there, expected) in zip(seen["native"], seen["numpy"], strict=True):
        assert here == pytest.approx(there, rel=1e-5)
        size, largest = there - began[1], np.abs(expected).max()
        apart = (abs(here - there) + abs(here - began[0] - size)) / size
        assert apart < 2e-3
        np.testing.assert_allclose(error, expected, atol=1e-4 * max(5e-2, largest) + 8 * apart * largest)
        began = (here, there)


@pytest.mark.parametrize("method", ["radau", "explicit", "rodas"])
def test_the_same_source_runs_as_python(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit by bit: the compiled code computes the same as the source."""
    made: list[tuple[compiled.CompiledMethod, dict[str, Any]]] = []
    original = compiled.CompiledMethod.begin

    def keep(solver: compiled.CompiledMethod) -> None:
        room = fields.room_of(
            solver.program, solver.method, solver.signal_count, solver.bend_count, 2 * solver.peak_count
        )
        numbers = [
            n for n, kind in IntegratorWorkspace.__annotations__.items() if kind in ("float", "int", "Floats", "Ints")
        ]
        copies = {n: v.copy() if isinstance(v := solver.values[n], np.ndarray) else v for n in numbers}
        closed = solver.values["closed"]  # a pendulum has no constraints, so no equations of them either
        assert closed["constraints"] == 0
        none = SimpleNamespace(rows=0)
        counts = {n: closed[n] for n, kind in ProjectionWorkspace.__annotations__.items() if kind == "int"}
        within = {
            "closed": SimpleNamespace(**counts, positions=none, velocities=none),
            "pattern": solver.values["pattern"].record,
            "selection": SimpleNamespace(slope_count=0),
        }
        made.append((solver, room | copies | within))
        original(solver)

    monkeypatch.setattr(compiled.CompiledMethod, "begin", keep)
    bondgraph.load(MODELS / "pendulum.bg").simulate(to=0.3, target="native", energy=True, points=20, solver=method)
    (solver, values) = made[0]
    python = Plain(IntegratorWorkspace, values | functions_of(IntegratorWorkspace, solver.program)).record
    with np.errstate(all="ignore"):
        begin(python)
        assert advance(python, 10_000) == 0
    assert python.steps == solver.steps > 5
    for name in IntegratorWorkspace.__annotations__:
        mine = getattr(python, name)
        if isinstance(mine, np.ndarray) and name != "reported":
            np.testing.assert_array_equal(mine, solver.values[name], err_msg=name)
        elif isinstance(mine, int | float):
            assert mine == solver.values[name], name


@pytest.mark.parametrize("name", ["manipulator.bg", "rectifier.bg", "crane.bg", "pendulum.bg"])
def test_magnitudes_are_the_same(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The coarse run takes its steps in machine code too."""
    found = []
    original = tolerances.nominal_magnitudes
    monkeypatch.setattr(tolerances, "nominal_magnitudes", lambda *a: found.append(original(*a)) or found[-1])
    both(MODELS / name, points=2)
    np.testing.assert_allclose(found[0].values, found[1].values, rtol=1e-9)
    assert (found[0].stopped, found[0].unknown) == (found[1].stopped, found[1].unknown)


PUSHED = """
model Pushed {{
  Se push : F = 1 N*{push}
  I  mass : p = 1 kg*v
  C  held : F = 100 [N/m]*x
  R  loss : F = {loss}
  push -> 1(mass, held, loss)
  {extra}
  output x = held.x
}}
"""


def pushed(push: str = "1", loss: str = "0.1 [N*s/m]*v", extra: str = "") -> bondgraph.Model:
    return bondgraph.load(PUSHED.format(push=push, loss=loss, extra=extra))


@pytest.mark.parametrize(
    ("model", "word"),
    [
        (pushed(loss="-1 [N*s/m]*v - 5 [N*s^3/m^3]*v^3"), "holds|grows|fell|solved"),
        (pushed(loss="1 N*sqrt(0.05 - v/1 [m/s])"), "the square root of -"),
        (pushed(loss="1 N*linear(v/1 [m/s], (-0.05, 0, 0.05), (-0.01, 0, 0.02))"), "asked"),
    ],
)
def test_failures_are_told_in_the_same_words(model: bondgraph.Model, word: str) -> None:
    told = []
    for target in ("native", "numpy"):
        with pytest.raises(RunFailed, match=word) as failed:
            model.simulate(to=20, target=target)
        told.append(str(failed.value))
    native, numpy = (text.split() for text in told)
    assert len(native) == len(numpy)
    for mine, other in zip(native, numpy, strict=True):
        if mine.startswith("`sqrt(-") and other.startswith("`sqrt(-"):
            continue  # by how little it is negative is rounding
        number = mine.strip("(),;`")
        if number != other.strip("(),;`"):
            # Next to a pole the last step that is found differs by rounding, and what is there with it.
            assert float(number) == pytest.approx(float(other.strip("(),;`")), rel=5e-2, abs=1e-9)


def test_requirements_are_found_at_the_same_instant() -> None:
    model = pushed("sin(time*3 [1/s])", extra='require held.x < 9 mm "short"\nrequire mass.v < 0.02 [m/s] "slow"')
    (native, numpy) = (model.simulate(to=10, target=t, points=11).warnings for t in ("native", "numpy"))
    assert [w.condition for w in native] == [w.condition for w in numpy] and len(native) == 2
    assert [w.time for w in native] == pytest.approx([w.time for w in numpy], rel=1e-9)


def test_tolerances_that_are_held_and_signals_that_must_be_seen() -> None:
    """A tolerance of the author does not grow with the state; a pulse in the middle of nothing is not passed over."""
    model = pushed(
        "exp(-((time - 3 s)/(200 ms))^2)", extra="experiment e {\n simulate 0 .. 6 s { tolerance held.x = 1 pm }\n}"
    )
    native, numpy = (model.simulate(target=t) for t in ("native", "numpy"))
    assert native.steps == pytest.approx(numpy.steps, rel=0.01)
    assert np.abs(native["x"] - numpy["x"]).max() < 1e-3 * np.abs(numpy["x"]).max()
    assert np.abs(native["x"]).max() == pytest.approx(0.0159, rel=0.01)


def test_other_states_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.simulation.test_choice import pair

    model = bondgraph.load(pair("exp(12*sin(time/1 s))"))
    native, numpy = (model.simulate(to=6, points=31, target=t, energy=True) for t in ("native", "numpy"))
    assert native.steps == pytest.approx(numpy.steps, rel=0.02)
    np.testing.assert_allclose(native.values, numpy.values, rtol=1e-4, atol=1e-6 * np.abs(numpy.values).max())


CELLS = """
model Cell {{
  port left: translation, right: translation
  C spring : F = 2 [N/m]*x + 3 [N/m^3]*x^3
  R damper : F = 0.1 [N*s/m]*v
  I mass   : p = 1 kg*v
  left -> 0(1(spring, damper)) -> 1(mass) -> right
}}
model Chain {{
  Sf drive : v = 1 [m/s]*sin(time*1 [1/s])
  for i in 1..{n} {{ Cell cell[i] }}
  drive -> cell[1].left
  for i in 1..{n} - 1 {{ cell[i].right -> cell[i+1].left }}
  Se end : F = 1 N
  cell[{n}].right -> end
  output x = cell[{n}].spring.x, first = cell[1].spring.x
}}
"""


def test_a_large_model_by_sparse_factors() -> None:
    model = bondgraph.load(CELLS.format(n=60), "Chain")
    native, numpy = (model.simulate(to=3, points=11, target=t, solver="radau") for t in ("native", "numpy"))
    assert len(model.states) == 120 and native.solver == "Radau IIA 5, native"
    assert native.steps == numpy.steps
    np.testing.assert_allclose(native.values, numpy.values, rtol=1e-9, atol=1e-12)


def test_sparse_factors_where_the_order_must_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small models by sparse factors; orders are chosen again as pivots become small, and the steps stay those of the reference."""
    monkeypatch.setattr(pilot_run, "is_sparse", lambda program: True)
    monkeypatch.setattr(fields, "is_sparse", lambda program: True)
    monkeypatch.setattr(compiled, "is_sparse", lambda program: True)
    monkeypatch.setattr(compiled, "SMALL", 0.3)
    chosen: list[float] = []
    original = compiled.Ordered.choose
    monkeypatch.setattr(compiled.Ordered, "choose", lambda order, *a: chosen.append(a[0]) or original(order, *a))
    for name in ("manipulator.bg", "rectifier.bg", "van_der_pol.bg"):
        native, numpy = both(MODELS / name, solver="radau")
        assert native.steps == pytest.approx(numpy.steps, rel=PARTING.get(name, 0.0))
        scale = np.abs(numpy.values).max(axis=0)
        assert (np.abs(native.values - numpy.values) / scale).max() < (1e-3 if name in PARTING else 1e-6)
    assert len(chosen) > 5


def test_the_pattern_has_room_for_all_that_comes() -> None:
    """A matrix of other numbers on the same places, zeros among them, is factorised as by LAPACK."""
    generator = np.random.default_rng(5)
    n = 30
    rows, columns = np.unravel_index(np.flatnonzero(generator.random(n * n) < 0.1), (n, n))
    program = bondgraph.load(MODELS / "duffing.bg")
    made = program.compiled_scene(program.scene(), False, "native").program
    order = compiled.Ordered(made, 1e-3)
    order.values.put({name: np.zeros(n) for name in ("diagonal", "scale", "x", "y", "xi", "yi")} | {"n": n})
    order.pattern = (rows, columns, n, n)
    entries = generator.normal(size=len(rows)) * (generator.random(len(rows)) < 0.5)
    assert order.choose(5.0, entries)
    values = {name: order.values[name] for name in Pattern.__annotations__} | {
        "n": n,
        "ready": 1,
        "tolerant": 1,
        "small": 1e-3,
        "scale": np.zeros(n),
        "diagonal": np.zeros(n),
        "x": np.zeros(n),
        "y": np.zeros(n),
    }
    pattern = Pattern(**values)
    for _ in range(5):
        entries = generator.normal(size=len(rows))
        matrix = 5.0 * np.eye(n)
        matrix[rows, columns] -= entries
        assert real_factors(pattern, 5.0, entries) == FINE
        right = generator.normal(size=n)
        found = right.copy()
        real_back(pattern, found)
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-8, atol=1e-10)
        assert not pattern.x.any()  # type: ignore[attr-defined]


def test_targets(monkeypatch: pytest.MonkeyPatch) -> None:
    model = pushed()
    assert model.simulate(to=1).solver == "Dormand-Prince 8, native"
    assert model.simulate(to=1, target="numpy").solver == "Dormand-Prince 8, numpy"
    with pytest.raises(UsageError, match="targets are native, numpy"):
        model.simulate(to=1, target="fortran")
    monkeypatch.setenv(HIDDEN, "1")
    assert model.simulate(to=1).solver == "Dormand-Prince 8, numpy"
    with pytest.raises(UsageError, match="llvmlite"):
        model.simulate(to=1, target="native")


def test_a_run_can_be_interrupted() -> None:
    """Machine code comes back often enough for Python to see that somebody pressed Ctrl-C."""
    model = pushed("sin(time*1e6 [1/s])")
    model.simulate(to=1e-5)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background ignores it
    try:
        threading.Timer(0.5, signal.raise_signal, (signal.SIGINT,)).start()
        began = clock.perf_counter()
        with pytest.raises(KeyboardInterrupt):
            model.simulate(to=1e5, points=3)
    finally:
        signal.signal(signal.SIGINT, before)
    assert clock.perf_counter() - began < 5


def test_files_with_vectors_are_files_of_the_source() -> None:
    """A file of another name would be compiled without vectors, and long models would run more slowly without a word."""
    folder = Path(compiled.__file__).parent.parent
    assert {p.stem for p in folder.rglob("*.py")} >= sources.VECTORS
    assert {f.__name__ for f in sources.APART} == {"radau_step", "rodas_step", "energy_step", *SHARED}
