"""Linear algebra of a run has one thread, and afterwards as many as before."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest

import bondgraph
from bondgraph.numerics import threads
from bondgraph.simulation.phase import Phase
from tests.compiling import MODELS

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or not threads._libraries(False), reason="no library whose threads can be counted"
)


@pytest.fixture
def counts():  # type: ignore[no-untyped-def]
    """The function that counts the threads of each library, which are two outside of a run."""
    np.linalg.solve(np.eye(2), np.ones(2))
    libraries = threads._libraries("scipy.linalg" in sys.modules)
    before = [get() for get, _ in libraries]
    for _, put in libraries:
        put(2)
    yield lambda: [get() for get, _ in libraries]
    for (_, put), count in zip(libraries, before, strict=True):
        put(count)


def test_a_small_order_is_held_and_a_large_one_is_not(counts) -> None:  # type: ignore[no-untyped-def]
    outside = counts()
    with threads.OneThread(threads.LARGE):
        assert set(counts()) == {1}
        with threads.OneThread(3):
            assert set(counts()) == {1}
        assert set(counts()) == {1}
    assert counts() == outside
    with threads.OneThread(threads.LARGE + 1):
        assert counts() == outside
    with pytest.raises(ZeroDivisionError), threads.OneThread(1):
        raise ZeroDivisionError
    assert counts() == outside


def test_contexts_of_several_threads_overlap(counts) -> None:  # type: ignore[no-untyped-def]
    outside, meeting = counts(), Barrier(3)

    def enter(_: int) -> set[int]:
        with threads.OneThread(1):
            meeting.wait()
            seen = set(counts())
            meeting.wait()
        return seen

    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(enter, range(3))) == [{1}] * 3
    assert counts() == outside


def test_a_run_has_one_thread(counts, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    seen = []
    go = Phase.go
    monkeypatch.setattr(Phase, "go", lambda phase: (seen.append(counts()), go(phase))[1])
    bondgraph.load(MODELS / "oscillator.bg").simulate()
    assert seen and set(seen[0]) == {1} and set(counts()) != {1}


@pytest.mark.parametrize("large", [False, True])
def test_an_analysis_has_one_thread_unless_it_is_large(counts, monkeypatch: pytest.MonkeyPatch, large: bool) -> None:  # type: ignore[no-untyped-def]
    import scipy.linalg  # noqa: F401  # brings a library of its own, which the fixture counts if it is there

    from bondgraph.analysis import equilibrium

    libraries = threads._libraries(True)
    before = [get() for get, _ in libraries]
    for _, put in libraries:
        put(2)
    seen, verdict = [], equilibrium._verdict
    monkeypatch.setattr(
        equilibrium, "_verdict", lambda *found: (seen.append([get() for get, _ in libraries]), verdict(*found))[1]
    )
    monkeypatch.setattr(threads, "LARGE", 1 if large else threads.LARGE)
    bondgraph.load(MODELS / "oscillator.bg").equilibrium()
    assert set(seen[0]) == {2 if large else 1} and {get() for get, _ in libraries} == {2}
    for (_, put), count in zip(libraries, before, strict=True):
        put(count)
