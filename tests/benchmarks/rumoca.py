"""rumoca over Modelica text made of the same equations."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from tests.benchmarks.peers import PATIENCE, Done, Run, _symbolic, there
from tests.benchmarks.scenes import POINTS, Scene


def modelica(scene: Scene) -> str:
    """The scene as a Modelica model."""
    import sympy

    t, y, pieces = _symbolic(scene)
    names = [f"y{i}" for i in range(len(y))]
    lines = ["model Scene"]
    lines += [f"  Real {n}(start={x!r}, fixed=true);" for n, x in zip(names, scene.start, strict=True)]
    right = [sympy.sympify(r) for r in pieces[-1]]
    if scene.stops:
        from tests.benchmarks import equations

        force = sympy.Symbol("force", real=True)
        right = [sympy.sympify(r) for r in getattr(equations, scene.hand)(sympy, t, y, force)]
        lines.append("  Real force;")
    lines.append("equation")
    if scene.stops:
        from tests.benchmarks import equations

        rises = _text(equations.rising(sympy.Symbol("time")))
        lines.append(f"  force = if time < {scene.stops[0]!r} then {rises} else 30e-6;")
    left = [f"der({n})" for n in names]
    if scene.mass is not None:
        left = [
            " + ".join(f"({c!r})*der({n})" for c, n in zip(map(float, row), names, strict=True) if c) or "0"
            for row in scene.mass
        ]
    lines += [f"  {a} = {_text(r)};" for a, r in zip(left, right, strict=True)]
    return "\n".join([*lines, "end Scene;", ""])


def _text(x: Any) -> str:
    import sympy

    return str(sympy.sympify(x).subs(sympy.Symbol("t", real=True), sympy.Symbol("time"))).replace("**", "^")


def run(scene: Scene, magnitude: Any) -> Run | None:
    """Run with its own solver and this tolerance; it takes one absolute tolerance for all variables."""
    if not there("rumoca") or not scene.hand:
        return None
    import rumoca

    model = rumoca.Session().loads(modelica(scene), model="Scene")

    def once(rtol: float) -> Done:
        absolute = min(scene.absolute) if scene.absolute else rtol * float(np.min(magnitude))
        config = rumoca.SimConfig(
            solver="bdf", rtol=rtol, atol=absolute, dt=scene.stop / (POINTS - 1), max_wall_seconds=PATIENCE
        )
        began = time.thread_time()
        found = model.simulate(t=(0.0, scene.stop), config=config)
        took = time.thread_time() - began
        values = np.stack([np.asarray(found[f"y{i}"], dtype=float) for i in range(len(scene.start))], axis=-1)
        times = np.asarray(found["time"], dtype=float)  # at an event twice
        near = np.clip(np.searchsorted(times, scene.instants - 1e-9 * scene.stop), 0, len(times) - 1)
        reached = np.abs(times[near] - scene.instants).max() < 1e-6 * scene.stop
        return Done(values[near] if reached else None, took)

    return once
