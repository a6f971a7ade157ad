"""Inverse, rest and long run of random models whose storages share flows; BONDGRAPH_DISPLACEMENTS=200 in the environment tries more."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest

import bondgraph
from tests.analysis.shared_displacements import CLOSE, agreement, random_text

FLEXURES = """import FoldedFlexure, CombDrive from mems
model Many {{
  input push = 0 V, pull = 0 V
  I m : p = 40 ug*v
  R r : F = {r} [N*s/m]*v
  C soft : F = 0.7 [N/m]*x
  CombDrive comb {{ push = push, pull = pull }}
  1 j : translation
  j -> m, r, soft
{flexures}  comb.shuttle -> j
  output x = flexure_1.way
}}
"""


@pytest.mark.machine_code
def test_inverse_rest_and_run_of_random_models_agree() -> None:
    """To 1e-8; where no input moves the output (a leak beside it), that is said."""
    displacements = int(os.environ.get("BONDGRAPH_DISPLACEMENTS", "16"))
    met = {"agree": 0, "shared": 0, "conserved": 0}
    for seed in range(displacements):
        found = agreement(bondgraph.load(random_text(seed)), "load", "y", 0.35)
        if found.rest is None or found.final is None:
            assert "no inputs were found" in found.told
            continue
        assert found.rest == pytest.approx(0.35, rel=CLOSE), seed
        assert found.final == pytest.approx(0.35, rel=CLOSE), seed
        met["agree"] += 1
        met["shared"] += found.shared
        met["conserved"] += found.conserved
    assert (
        met["agree"] > 0.8 * displacements and met["shared"] > displacements and met["conserved"] > 0.25 * displacements
    )


@pytest.mark.parametrize("gaps", [(2.0, 3.0), (2.5,), (2.0, 2.2, 3.1), (4.0, 2.0)])
def test_flexures_of_the_library_that_hang_on_one_shuttle(gaps: tuple[float, ...]) -> None:
    """Each stores the shuttle's displacement, with a stiffness of its own: the run gives the force of all of them."""
    parts = "".join(
        f"  FoldedFlexure flexure_{i} {{ d = {d} um }}\n  j -> flexure_{i}.ends\n" for i, d in enumerate(gaps, 1)
    )
    model = bondgraph.load(FLEXURES.format(r=2.5e-5 * len(gaps), flexures=parts))
    assert len(model.certificate.following) >= len(gaps)
    found = agreement(model, "push/pull", "x", 1e-6)
    assert found.rest == pytest.approx(1e-6, rel=CLOSE)
    assert found.final == pytest.approx(1e-6, rel=CLOSE)


def chain(count: int, starts: bool) -> str:
    """Capacitors and resistors in a row behind a source, the first nodes without a leak: q1 - q2 - … is kept."""
    lines = [
        "plain model Row {",
        "  input volt = 0",
        "  MSe u : e = volt",
        "  1 a",
        "  R r0 : e = 1*f",
        "  C c0 : e = q/2",
        "  u -> a -> r0",
        "  a -> c0",
    ]
    before = "a"
    for i in range(1, count + 1):
        start = f" {{ start q = {0.1 * i} }}" if starts else ""
        lines += [
            f"  0 n{i}",
            f"  C g{i} : e = q/{i}{start}",
            f"  1 b{i}",
            f"  C s{i} : e = q/{i + 1}",
            f"  R r{i} : e = {i}*f",
        ]
        lines += [f"  {before} -> n{i} -> g{i}", f"  n{i} -> b{i} -> s{i}", f"  b{i} -> r{i}"]
        before = f"b{i}"
    return "\n".join([*lines, f"  output y = s{count}.q, q = c0.q", "}"]) + "\n"


@pytest.mark.parametrize("starts", [False, True])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_charges_of_isolated_nodes_are_held(count: int, starts: bool) -> None:
    """Sums of three charges: against the linear equations of the capacitors alone, the charge of each node as at the start."""
    model = bondgraph.load(chain(count, starts))
    n = 2 * count + 1  # c0, g1, s1, g2, …
    size = np.array([2.0, *(x for i in range(1, count + 1) for x in (i, i + 1.0))])
    begun = np.array([0.0, *(x for i in range(1, count + 1) for x in ((0.1 * i if starts else 0.0), 0.0))])
    rows, right = np.zeros((n + 1, n + 1)), np.zeros(n + 1)  # charges, then the source
    rows[0, [0, 1, n]] = 1 / size[0], 1 / size[1], -1.0
    for i in range(count):
        into, g, out = 2 * i, 2 * i + 1, 2 * i + 2
        rows[1 + i, [into, g, out]] = 1.0, -1.0, -1.0  # what flows in, flows on or stays
        right[1 + i] = begun[into] - begun[g] - begun[out]
        after = [(2 * i + 3, 1.0)] if i + 1 < count else []
        for place, sign in [(g, -1.0), (out, 1.0), *after]:
            rows[1 + count + i, place] = sign / size[place]
    rows[n, n - 1], right[n] = 1.0, 0.25
    truth = np.linalg.solve(rows, right)
    found = model.invert({"y": 0.25}, ["volt"])
    assert found.inputs["volt"] == pytest.approx(truth[n], rel=1e-11)
    rest = model.equilibrium(settings=found.inputs)
    assert (rest["y"], rest["q"]) == (pytest.approx(0.25, rel=1e-11), pytest.approx(truth[0], rel=1e-11))
    branch = model.continuation("volt", 0.0, truth[n], points=3)
    assert branch.outputs["y"][-1] == pytest.approx(0.25, rel=1e-9) and not math.isnan(branch.outputs["q"][-1])
    assert branch.outputs["q"][-1] == pytest.approx(truth[0], rel=1e-9)
