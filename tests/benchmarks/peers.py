"""Other programs on the same equations. Each is a function that makes a run of a scene: rtol -> values at the instants, and seconds of this thread.

A peer that is not installed is `None`, which is reported.
"""

from __future__ import annotations

import ctypes
import importlib.util
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import cache
from glob import glob
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from tests.benchmarks import equations
from tests.benchmarks.scenes import Scene

HAND = Path(__file__).parent / "hand"
PATIENCE = 20.0  # s, after which a run counts as stuck
FLAGS = ["-O2", "-march=native", "-std=gnu11", "-shared", "-fPIC"]


class Done(NamedTuple):
    """The states at the instants, shape (points, n); None where a run was given up."""

    values: Any
    seconds: float
    steps: int = 0


Run = Callable[[float], Done]


def there(package: str) -> bool:
    return importlib.util.find_spec(package) is not None


@cache
def compiled(name: str, libraries: tuple[str, ...] = (), flags: tuple[str, ...] = ()) -> ctypes.CDLL:
    """A file of `hand/` by gcc."""
    folder = Path(tempfile.mkdtemp(prefix="bondgraph-bench-"))
    paths = [f"-Wl,-rpath,{Path(x).parent}" for x in libraries[:1]]
    command = [
        "gcc",
        *FLAGS,
        *flags,
        str(HAND / f"{name}.c"),
        "-o",
        str(folder / f"{name}.so"),
        *libraries,
        *paths,
        "-lm",
    ]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(folder / f"{name}.so"))


def by_hand() -> ctypes.CDLL:
    """The equations in C."""
    library = compiled("equations")
    library.manipulator_begin()
    return library


def address(library: ctypes.CDLL, name: str) -> ctypes.c_void_p:
    return ctypes.cast(getattr(library, name), ctypes.c_void_p)


# ---------------------------------------------------------------- SUNDIALS
def sundials(scene: Scene, magnitude: Any, order: int) -> Run | None:
    """CVODE, for M y' = f IDA: backward differentiation up to an order, dense, over C."""
    if not there("sksundae") or not scene.hand:
        return None
    import sksundae

    folder = Path(sksundae.__file__).parents[1] / "scikit_sundae.libs"
    words = ("cvode", "ida", "core", "nvecserial", "sunlinsoldense", "sunmatrixdense")
    driver = compiled("sundials", tuple(glob(str(folder / f"libsundials_{w}-*"))[0] for w in words))
    library = by_hand()
    f, j = address(library, f"{scene.hand}_f"), address(library, f"{scene.hand}_j")
    start, instants = np.array(scene.start), np.ascontiguousarray(scene.instants)
    stops = np.array(scene.stops)
    n, count = len(start), len(instants)
    number, pointer, whole = ctypes.c_double, ctypes.c_void_p, ctypes.c_int
    slope = np.zeros(n)
    if scene.mass is not None:
        right = np.zeros(n)
        getattr(library, f"{scene.hand}_f")(number(0.0), pointer(start.ctypes.data), pointer(right.ctypes.data))
        slope = np.linalg.pinv(scene.mass) @ right
    mass = None if scene.mass is None else np.asfortranarray(scene.mass)

    def run(rtol: float) -> Done:
        absolute = np.array(scene.absolute) if scene.absolute else rtol * magnitude
        out, steps, failed = np.zeros((count, n)), ctypes.c_long(), whole()
        tail = (number(PATIENCE), pointer(out.ctypes.data), ctypes.byref(steps), ctypes.byref(failed))
        if mass is None:
            driver.run_cvode.restype = number
            took = driver.run_cvode(
                f, j, n, order, number(rtol), pointer(absolute.ctypes.data), pointer(start.ctypes.data), count, pointer(instants.ctypes.data),
                len(stops), pointer(stops.ctypes.data), *tail,
            )  # fmt: skip
        else:
            kinds = np.ones(n)
            driver.run_ida.restype = number
            took = driver.run_ida(
                f, j, pointer(mass.ctypes.data), pointer(kinds.ctypes.data), n, order, number(rtol), pointer(absolute.ctypes.data),
                pointer(start.ctypes.data), pointer(slope.ctypes.data), count, pointer(instants.ctypes.data), *tail,
            )  # fmt: skip
        return Done(None if failed.value else out, took, steps.value)

    return run


# ---------------------------------------------------------------- scipy
def _symbolic(scene: Scene) -> tuple[Any, list[Any], list[list[Any]]]:
    """Time, states, and the right side on each stretch between bends, in sympy."""
    import sympy

    t, y = sympy.Symbol("t", real=True), list(sympy.symbols(f"y0:{len(scene.start)}", real=True))
    rates = getattr(equations, scene.hand)
    pieces = [rates(sympy, t, y, equations.rising(t)), rates(sympy, t, y)] if scene.stops else [rates(sympy, t, y)]
    return t, y, pieces


def scipy_radau(scene: Scene, magnitude: Any) -> Run | None:
    """scipy's Radau with right side and Jacobian by sympy's lambdify."""
    if not scene.hand or scene.mass is not None:
        return None
    import sympy
    from scipy.integrate import solve_ivp

    t, y, pieces = _symbolic(scene)
    made = [
        (sympy.lambdify((t, *y), piece, cse=True), sympy.lambdify((t, *y), sympy.Matrix(piece).jacobian(y), cse=True))
        for piece in pieces
    ]
    edges = [0.0, *scene.stops, scene.stop]
    instants = scene.instants

    def run(rtol: float) -> Done:
        began, x, parts, steps = time.thread_time(), np.array(scene.start), [], 0
        for number, (f, j) in enumerate(made):
            a, b = edges[number : number + 2]
            at = instants[(instants >= a if number == 0 else instants > a) & (instants <= b)]
            found = solve_ivp(
                lambda t, x, f=f: f(t, *x), (a, b), x, "Radau", np.append(at, b) if not len(at) or at[-1] < b else at,
                jac=lambda t, x, j=j: j(t, *x), rtol=rtol, atol=scene.absolute or rtol * magnitude,
            )  # fmt: skip
            if not found.success:
                return Done(None, time.thread_time() - began)
            parts.append(found.y.T[: len(at)])
            x, steps = found.y[:, -1], steps + found.nfev // 6
        return Done(np.concatenate(parts), time.thread_time() - began, steps)

    return run


# ---------------------------------------------------------------- casadi
def casadi_cvodes(scene: Scene, magnitude: Any) -> Run | None:
    """casadi's CVODES over its own expressions, in scaled states."""
    if not there("casadi") or not scene.hand or scene.mass is not None:
        return None
    import casadi

    n, scale = len(scene.start), np.array(magnitude)
    rates = getattr(equations, scene.hand)
    functions = SimpleNamespace(sin=casadi.sin, cos=casadi.cos, exp=casadi.exp)
    edges, instants = [0.0, *scene.stops, scene.stop], scene.instants

    def made(rtol: float) -> list[tuple[Any, int]]:
        found = []
        for number in range(len(edges) - 1):
            a, b = edges[number : number + 2]
            z, t = casadi.SX.sym("z", n), casadi.SX.sym("t")
            y = [z[i] * scale[i] for i in range(n)]
            right = (
                rates(functions, t, y, equations.rising(t)) if scene.stops and number == 0 else rates(functions, t, y)
            )
            at = [x for x in instants if a < x <= b]
            grid = at if at and at[-1] == b else [*at, b]
            absolute = min(np.array(scene.absolute) / scale) if scene.absolute else rtol
            options = {"reltol": rtol, "abstol": absolute, "max_num_steps": 2_000_000}
            problem = {"x": z, "t": t, "ode": casadi.vertcat(*[r / s for r, s in zip(right, scale, strict=True)])}
            found.append((casadi.integrator("F", "cvodes", problem, a, grid, options), len(at)))
        return found

    def run(rtol: float) -> Done:
        solvers = made(rtol)
        began, x, parts = time.thread_time(), np.array(scene.start) / scale, [np.array(scene.start)[None]]
        try:
            for solver, count in solvers:
                states = np.array(solver(x0=x)["xf"]).T
                parts.append(states[:count] * scale)
                x = states[-1]
        except RuntimeError:
            return Done(None, time.thread_time() - began)
        return Done(np.concatenate(parts), time.thread_time() - began)

    return run


# ---------------------------------------------------------------- diffsol
def diffsol(scene: Scene, magnitude: Any, method: str) -> Run | None:
    """diffsol with LLVM over DiffSL text, in scaled states."""
    if not there("pydiffsol") or not scene.hand:
        return None
    import pydiffsol

    code = diffsl(scene, np.array(magnitude))
    instants = np.ascontiguousarray(scene.instants)

    def run(rtol: float) -> Done:
        backend = getattr(pydiffsol, "llvm", None) or pydiffsol.default_enabled_jit_backend()
        ode = pydiffsol.Ode(code, matrix_type=pydiffsol.nalgebra_dense, jit_backend=backend)
        ode.ode_solver = getattr(pydiffsol, method)
        ode.rtol = rtol
        ode.atol = float(min(np.array(scene.absolute) / magnitude)) if scene.absolute else rtol
        began = time.thread_time()
        found = ode.solve_dense(np.zeros(0), instants)
        took = time.thread_time() - began
        return Done(np.array(found.ys).T * magnitude, took)

    return run


def diffsl(scene: Scene, magnitude: Any) -> str:
    """The scene in DiffSL: shared subexpressions have lines of their own."""
    import sympy

    t, y, pieces = _symbolic(scene)
    scaled = {s: sympy.Symbol(f"z{i}", real=True) * m for i, (s, m) in enumerate(zip(y, magnitude, strict=True))}
    right = [sympy.sympify(r) for r in pieces[-1]]
    force: Any = None
    if scene.stops:  # the force rises until there, and stays
        force = sympy.Symbol("force", real=True)
        right = [sympy.sympify(r) for r in getattr(equations, scene.hand)(sympy, t, y, force)]
    mass = np.eye(len(y)) if scene.mass is None else np.array(scene.mass)
    per_row = magnitude if scene.mass is None else np.ones(len(y))
    shared, rest = sympy.cse(
        [r.subs(scaled) / p for r, p in zip(right, per_row, strict=True)], sympy.numbered_symbols("s")
    )
    lines = [
        "u_i {",
        *(f"  z{i} = {x / m!r}," for i, (x, m) in enumerate(zip(scene.start, magnitude, strict=True))),
        "}",
    ]
    if scene.mass is not None:
        lines += ["dudt_i {", *(f"  d{i} = 0," for i in range(len(y))), "}"]
        rows = [
            " + ".join(f"{mass[i, k] * magnitude[k]!r} * d{k}" for k in range(len(y)) if mass[i, k]) or "0"
            for i in range(len(y))
        ]
        lines += ["M_i {", *(f"  {r}," for r in rows), "}"]
    if force is not None:
        stop = scene.stops[0]
        rises = _text(equations.rising(sympy.Symbol("t")))
        lines.append(f"force {{ heaviside({stop} - t) * ({rises}) + heaviside(t - {stop}) * 30e-6 }}")
    lines += [f"{name} {{ {_text(x)} }}" for name, x in shared]
    return "\n".join([*lines, "F_i {", *(f"  {_text(r)}," for r in rest), "}"]).replace("np.float64(", "(")


def _text(x: Any) -> str:
    """An expression in DiffSL: powers as products."""
    import sympy

    if isinstance(x, sympy.Pow) and x.exp.is_Integer and abs(int(x.exp)) < 8:
        product = " * ".join([f"({_text(x.base)})"] * abs(int(x.exp)))
        return f"({product})" if x.exp > 0 else f"(1.0 / ({product}))"
    if isinstance(x, sympy.Add):
        return "(" + " + ".join(map(_text, x.args)) + ")"
    if isinstance(x, sympy.Mul):
        return "(" + " * ".join(map(_text, x.args)) + ")"
    if isinstance(x, sympy.Function):
        return f"{x.func.__name__}({_text(x.args[0])})"
    return repr(float(x)) if x.is_number else str(x)
