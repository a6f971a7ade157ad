"""Magnitudes of states that have not moved, in a step of a pilot run: link by link from those that have."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from bondgraph.simulation.integrators.pilot.step import follow_links


class Counted(list[float]):
    """Numbers that count how often one of them is read."""

    reads = 0

    def __getitem__(self, place: Any) -> Any:
        self.reads += 1
        return super().__getitem__(place)


def links(matrix: Any, scale: Any) -> tuple[list[float], int]:
    """The scales behind `follow_links`, and how many entries it has read."""
    rows, columns = matrix.nonzero()
    begins = np.append(0, np.bincount(columns, minlength=len(scale)).cumsum()).tolist()
    entries, by_column = Counted(matrix[rows, columns].tolist()), np.argsort(columns, kind="stable").tolist()
    e: Any = SimpleNamespace(
        n=len(scale), size=0.5, rows=rows.tolist(), jacobian=entries, by_column=by_column, begins=begins, scale=scale.tolist(),
        reached=[0.0] * len(scale), queue=[0] * len(scale),
    )  # fmt: skip
    follow_links(e)
    return e.scale, entries.reads


def in_rounds(matrix: Any, scale: Any) -> Any:
    """The same by definition: in each round the states next to those that have a scale."""
    scale = scale.copy()
    for _ in scale:
        brought = (np.abs(0.5 * matrix) * scale).max(axis=1)
        scale = np.where(scale == 0, brought, scale)
    return scale


def test_links_of_any_network_are_followed_as_in_rounds() -> None:
    random = np.random.default_rng(1)
    for size in (1, 5, 12):
        for _ in range(20):
            matrix = np.where(random.random((size, size)) < 1.5 / size, random.standard_normal((size, size)), 0.0)
            scale = np.where(random.random(size) < 0.3, random.random(size), 0.0)
            assert links(matrix, scale)[0] == in_rounds(matrix, scale).tolist()


def test_each_link_of_a_long_ladder_is_followed_once() -> None:
    """In rounds the entries would be read 500 times."""
    matrix = np.diag(np.full(499, 1.9), -1) - np.diag(np.full(499, 1.9), 1) - np.eye(500)
    scale, reads = links(matrix, np.append(1.0, np.zeros(499)))
    assert reads == np.count_nonzero(matrix) and min(scale) > 0
