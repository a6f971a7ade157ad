"""Solvers of other programs over the state equations that the compiler prints: scipy's, CVODE of SUNDIALS by scikit-sundae and by CasADi, and diffsol."""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from inspect import getmembers, isfunction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from compiler.api import Array, CompilationFailed

from ..analysed_model import AnalysedModel
from ..errors import RunFailed, UsageError
from ..results.result import Result
from ..simulation.run_options import RunRequest

SCIPY = ("DOP853", "Radau", "LSODA", "BDF")
PACKAGES = {"SUNDIALS CVODE": "scikit-sundae", "CasADi CVODES": "casadi", "diffsol BDF": "pydiffsol"}
# functions of the printed equations that these solvers know nothing of
REFUSED = {"reset", "on", "delayed", "constraints", "initial", "discrete_start"}
MOST_STEPS = 1_000_000
Run = Callable[[float], "Result"]


def peers_of(model: AnalysedModel, run: RunRequest, reference: Result) -> tuple[dict[str, Run], dict[str, str]]:
    """Return runs of other programs over the experiment's equations by name, and the reasons of those that there are not."""
    scene = model.scene(run.experiment, run.settings, (), reference.names)
    try:
        equations = _module(model.compilation(scene).text("numpy"))
    except (CompilationFailed, UsageError) as failed:
        return {}, {"scipy": str(failed).splitlines()[0]}
    extra = {name for name, _ in getmembers(equations, isfunction)} & REFUSED
    missing = set(reference.names) - {name for name, _ in equations.OUTPUTS}
    if extra or missing or reference.events or not hasattr(equations, "derivative"):
        reason = "the printed equations have events, switched junctions, delays, constraints or start conditions, or no states"
        return {}, {"scipy": reason}
    problem = _Problem(equations, reference)
    runs = {f"scipy {method}": problem.by_scipy(method) for method in SCIPY}
    if find_spec("sksundae") is not None:
        runs["SUNDIALS CVODE"] = problem.by_cvode
    reasons = {}
    if find_spec("casadi") is not None:
        try:
            runs["CasADi CVODES"] = problem.by_casadi(_module(model.compilation(scene).text("casadi")))
        except (CompilationFailed, UsageError) as failed:
            reasons["CasADi CVODES"] = str(failed).splitlines()[0]
    if find_spec("pydiffsol") is not None:
        try:
            runs["diffsol BDF"] = problem.by_diffsol(model.compilation(scene).text("diffsl"))
        except (CompilationFailed, UsageError) as failed:
            reasons["diffsol BDF"] = str(failed).splitlines()[0]
    return runs, {peer: f"{name} is not installed" for peer, name in PACKAGES.items() if peer not in runs} | reasons


def _module(text: str) -> ModuleType:
    """Return a printed module, imported."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bondgraph_equations.py"
        path.write_text(text, encoding="utf-8")
        spec = spec_from_file_location(path.stem, path)
        assert spec is not None and spec.loader is not None
        module = module_from_spec(spec)
        sys.modules[path.stem] = module  # dataclasses look themselves up there
        try:
            spec.loader.exec_module(module)
        finally:
            del sys.modules[path.stem]
    return module


class _Problem:
    """An initial value problem of printed equations, and the results of its solvers in the form of the reference."""

    def __init__(self, equations: ModuleType, reference: Result) -> None:
        self.equations, self.reference = equations, reference
        self.parameters = equations.Parameters()
        self.start: Array = equations.start(self.parameters)
        self.places = [[name for name, _ in equations.OUTPUTS].index(n) for n in reference.names]
        # magnitudes for absolute tolerances: of a rough run, as those of the states are not in the reference
        self.magnitude: Any = None

    def by_scipy(self, method: str) -> Run:
        """Return the runs by a method of `scipy.integrate.solve_ivp`."""

        def run(rtol: float) -> Result:
            solution = self._solved(method, rtol, rtol * self._magnitude())
            return self._result(f"scipy {method}", solution.y.T, rtol, 0, solution.nfev)

        return run

    def by_cvode(self, rtol: float) -> Result:
        """Run CVODE, backward differentiation of orders 1 to 5, with the exact Jacobian."""
        from sksundae.cvode import CVODE

        equations, p = self.equations, self.parameters

        def rates(t: float, x: Array, out: Array) -> None:
            out[:] = equations.derivative(t, x, p)

        def slopes(t: float, x: Array, rate: Array, out: Array) -> None:
            out[:] = equations.jacobian(t, x, p)

        jacobian = {"jacfn": slopes} if hasattr(equations, "jacobian") else {}
        solver = CVODE(rates, rtol=rtol, atol=rtol * self._magnitude(), max_num_steps=MOST_STEPS, **jacobian)
        with np.errstate(all="ignore"):
            solution = solver.solve(self.reference.time, self.start)
        _check("CVODE", solution)
        return self._result("SUNDIALS CVODE", solution.y, rtol, 0, solution.nfev)

    def by_casadi(self, functions: ModuleType) -> Run:
        """Return the runs by CasADi's CVODES over its own expressions and derivatives; states are scaled, as it has one absolute tolerance for all."""

        @lru_cache
        def integrator(rtol: float) -> Any:
            casadi, dae, time = functions.ca, functions.dae, self.reference.time
            magnitude = self._magnitude()
            scaled = casadi.SX.sym("z", len(magnitude))
            values = functions.DEFAULTS + functions.INPUT_DEFAULTS
            rates = casadi.substitute(
                dae["ode"], casadi.vertcat(dae["x"], dae["p"]), casadi.vertcat(scaled * magnitude, casadi.DM(values))
            )
            options = {"reltol": rtol, "abstol": rtol, "max_num_steps": MOST_STEPS}
            problem = {"t": dae["t"], "x": scaled, "ode": rates / magnitude}
            return casadi.integrator("run", "cvodes", problem, time[0], time[1:], options)

        def run(rtol: float) -> Result:
            solver, magnitude = integrator(rtol), self._magnitude()
            try:
                states = np.array(solver(x0=self.start / magnitude)["xf"]).T * magnitude
            except RuntimeError as failed:
                raise _gave_up("CasADi", str(failed).splitlines()[-1]) from None
            statistics = solver.stats()
            steps, evaluations = (int(statistics.get(name, 0)) for name in ("nsteps", "nfevals"))
            return self._result("CasADi CVODES", np.vstack([self.start, states]), rtol, steps, evaluations)

        return run

    def by_diffsol(self, text: str) -> Run:
        """Return the runs by diffsol's BDF over its own text, in states divided by their magnitudes."""

        defaults = np.array(re.findall(r"^  p\d+ = (\S+),", text, re.MULTILINE), dtype=float)

        @lru_cache
        def integrator() -> Any:
            import pydiffsol

            scaled = text
            for place, magnitude in enumerate(self._magnitude()):
                scaled = scaled.replace(f"\nscale{place} {{ 1.0 }}", f"\nscale{place} {{ {float(magnitude)!r} }}")
            return pydiffsol.Ode(scaled, matrix_type=pydiffsol.nalgebra_dense, ode_solver=pydiffsol.bdf)

        def run(rtol: float) -> Result:
            solver = integrator()
            solver.rtol = solver.atol = rtol
            try:
                solution = solver.solve_dense(defaults, self.reference.time)
            except RuntimeError as failed:
                raise _gave_up("diffsol", str(failed).splitlines()[-1]) from None
            return self._reported("diffsol BDF", np.array(solution.ys).T, rtol, 0, 0)

        return run

    def _magnitude(self) -> Any:
        if self.magnitude is None:
            values = np.abs(self._solved("LSODA", 1e-3, 1e-9).y).max(axis=1)
            self.magnitude = np.where(values > 0, values, values[values > 0].min(initial=1.0))
        return self.magnitude

    def _solved(self, method: str, rtol: float, atol: Any) -> Any:
        from scipy.integrate import solve_ivp

        time = self.reference.time
        has_slopes = method != "DOP853" and hasattr(self.equations, "jacobian")
        slopes = {"jac": self.equations.jacobian} if has_slopes else {}
        with np.errstate(all="ignore"):
            solution = solve_ivp(
                self.equations.derivative, (time[0], time[-1]), self.start, method, time, rtol=rtol, atol=atol, args=(self.parameters,), **slopes
            )  # fmt: skip
        _check(method, solution)
        return solution

    def _result(self, solver: str, states: Array, rtol: float, steps: int, evaluations: int) -> Result:
        """Return the outputs at the reference's instants as a result; `steps` is 0 where a solver does not report them."""
        values = np.array(
            [self.equations.outputs(t, x, self.parameters) for t, x in zip(self.reference.time, states, strict=True)]
        )
        return self._reported(solver, values, rtol, steps, evaluations)

    def _reported(self, solver: str, values: Array, rtol: float, steps: int, evaluations: int) -> Result:
        """Return values (instants, outputs of the printed equations) as a result."""
        return replace(
            self.reference, values=values[:, self.places], solver=solver, steps=steps, rtol=rtol, evaluations={"derivative": evaluations}
        )  # fmt: skip


def _check(method: str, solution: Any) -> None:
    if not solution.success:
        raise _gave_up(method, solution.message)


def _gave_up(method: str, why: str) -> RunFailed:
    return RunFailed("BR493", f"{method} gave up: {why}")
