"""Small models around one part of the library, and the tolerance that a run's own rtol allows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

import bondgraph

LIBRARY = Path(bondgraph.__file__).with_name("library")
RTOL = 1e-9
MARGIN = 100  # a solver holds rtol step by step; what a run adds up to is allowed a hundred times that


def text(library: str, parts: str, body: str) -> str:
    """A model `Bench` with parts of one library; `body` may import further ones in its first lines."""
    imports = [line for line in body.splitlines() if line.strip().startswith("import ")]
    rest = [line for line in body.splitlines() if not line.strip().startswith("import ")]
    return "\n".join(
        [f"import {parts} from {library}", *(line.strip() for line in imports), "model Bench {", *rest, "}"]
    )


def run(
    library: str, parts: str, body: str, to: float, *, points: int = 101, settings: Mapping[str, str | float] | None = None,
    rtol: float = RTOL, energy: bool = False,
) -> bondgraph.Result:  # fmt: skip
    """The run of a bench from 0 to `to` seconds."""
    model = bondgraph.load(text(library, parts, body), "Bench")
    return model.simulate(to=to, points=points, settings=settings, rtol=rtol, energy=energy)


def near(found: Any, expected: Any, rtol: float = RTOL, scale: float = 0.0, margin: float = MARGIN) -> None:
    """Equal to `margin` times rtol of the larger of the expected magnitude (over all instants) and `scale`."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    magnitude = max(float(np.max(np.abs(expected))), scale)
    worst = float(np.max(np.abs(found - expected)))
    assert worst <= margin * rtol * magnitude, (
        f"off by {worst:.3g}, {worst / magnitude:.3g} of {magnitude:.6g}: {found} against {expected}"
    )


def exact(found: Any, expected: Any) -> None:
    """Equal up to rounding: both sides are one algebraic relation, and no integration lies between them."""
    near(found, expected, rtol=1e-12, margin=1)


def linear(a: Any, b: Any, start: Any, times: Any) -> Any:
    """x' = A x + b from a start, by the matrix exponential; shape (times, states)."""
    a, b, start = np.asarray(a, dtype=float), np.asarray(b, dtype=float), np.asarray(start, dtype=float)
    n = len(start)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = a, b
    return np.array([(expm(whole * t) @ np.append(start, 1.0))[:n] for t in times])
