"""`prefer = derivative` is a wish: it gives way where nothing else would decide what the storage holds, and says so."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from tests.compiling import compiled, mistake

ALONE = "plain model A {\n  1 j\n  Se s : e = 1\n  R r : e = f\n  I i : p = f { prefer = derivative }\n  s -> j -> r, i\n  output y = i.f\n}\n"


def test_a_wish_that_would_leave_no_state() -> None:
    """f' = 1 - f."""
    compilation = compiled(ALONE)
    assert compilation.given_way == ("i",)
    (note,) = compilation.certificate.notes
    assert "`i` is in integral form" in note
    run = bondgraph.load(ALONE).simulate(to=3, points=7, rtol=1e-9)
    assert run["y"] == pytest.approx(1 - np.exp(-run.time), rel=1e-8)


def test_the_dual() -> None:
    """A capacitor beside a resistor: q' = -q/2."""
    text = "plain model A {\n  R r : e = 2*f\n  0 j\n  C c : q = e { prefer = derivative, start q = 1 }\n  j -> c, r\n  output y = c.e\n}\n"
    run = bondgraph.load(text).simulate(to=2, points=5, rtol=1e-9)
    assert run["y"] == pytest.approx(np.exp(-0.5 * run.time), rel=1e-8)


def test_a_wish_that_can_be_kept_is_kept() -> None:
    """Two inertias on one flow: the one that likes the derivative form has it, and there is nothing to say."""
    text = ALONE.replace("  s -> j -> r, i", "  I m : p = 2*f\n  s -> j -> r, i, m")
    compilation = compiled(text)
    assert compilation.given_way == () and compilation.certificate.notes == ()
    assert [
        s.name for s in (compilation.state_space.variables[x.variable] for x in compilation.state_space.states)
    ] == ["m.p"]


def test_only_what_has_to_give_way_does() -> None:
    """Of two wishes on parts that have nothing to do with each other one can be kept."""
    text = ALONE.replace(
        "  output",
        "  1 k\n  I a : p = f { prefer = derivative }\n  I b : p = 3*f\n  R t : e = 2*f\n  k -> a, b, t\n  output",
    )
    assert compiled(text, everything=True).given_way == ("i",)


def test_what_is_required_does_not_give_way() -> None:
    text = ALONE.replace("prefer", "require").replace("R r : e = f", "R r : f = e")
    assert "`i`" in mistake(text, "BG504").sentence
