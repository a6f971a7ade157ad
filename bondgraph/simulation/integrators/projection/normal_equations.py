"""Normal equations: pattern of J J' and of its factors for the active rows of constraints, chosen once, by least degree."""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np

from compiler.api import IntArray


def square(rows: IntArray, columns: IntArray, chosen: IntArray, lengths: list[bool]) -> dict[str, Any]:
    """Return the fields of a `projection.NormalEquations` for some of the rows of a pattern; `lengths`: mask of the rows that are lengths."""
    entries: dict[int, list[int]] = {int(i): [] for i in chosen}
    for k, row in enumerate(rows):
        if int(row) in entries:
            entries[int(row)].append(k)
    near = _near(entries, columns)
    order, fill = _least_degree(near)
    place = {row: k for k, row in enumerate(order)}
    reached = [sorted(place[i] for i in fill[row]) for row in order]
    start = np.concatenate([[0], np.cumsum([len(r) for r in reached])]).astype(int)
    below = {(i, k): int(start[k]) + t for k, r in enumerate(reached) for t, i in enumerate(r)}
    update = [below[j, i] for r in reached for t, i in enumerate(r) for j in r[t + 1 :]]
    kept = [k for row in order for k in entries[row]]
    pairs = _pairs(order, entries, columns, below)
    count, own = len(order), np.array(kept, dtype=int)
    # loading the random generator takes time
    fresh = np.random.default_rng(0).normal(size=count) if count else np.zeros(0)
    norm = float(np.linalg.norm(fresh)) or 1.0
    room = {name: np.zeros(count) for name in ("pivot", "own", "size", "right", "vector")}
    return room | {
        "rows": count, "invariant": order, "length": [int(lengths[i]) for i in order], "below": len(below),
        "entry_start": np.concatenate([[0], np.cumsum([len(entries[row]) for row in order])]), "entry": own,
        "column": np.asarray(columns, dtype=int)[own], "pair_start": np.concatenate([[0], np.cumsum([len(p) for p in pairs])]),
        "pair_one": [a for p in pairs for a, _ in p], "pair_other": [b for p in pairs for _, b in p], "l_start": start,
        "l_row": [i for r in reached for i in r], "update": update, "value": np.zeros(len(kept)), "lower": np.zeros(len(below)),
        "weakest": 1.0, "fresh": fresh / norm,
    }  # fmt: skip


def _near(entries: dict[int, list[int]], columns: IntArray) -> dict[int, set[int]]:
    """Return for each row the other rows with a common column."""
    sharing: dict[int, list[int]] = {}
    for row, places in entries.items():
        for k in places:
            sharing.setdefault(int(columns[k]), []).append(row)
    near: dict[int, set[int]] = {row: set() for row in entries}
    for those in sharing.values():
        for row in those:
            near[row].update(those)
    for row, others in near.items():
        others.discard(row)
    return near


def _least_degree(near: dict[int, set[int]]) -> tuple[list[int], dict[int, list[int]]]:
    """Return the elimination order (Tinney and Walker, Proc. IEEE 55, 1967), and the rows that each pivot updates."""
    heap = [(len(others), row) for row, others in near.items()]
    heapq.heapify(heap)
    order: list[int] = []
    fill: dict[int, list[int]] = {}
    while heap:
        degree, k = heapq.heappop(heap)
        if k in fill or degree != len(near[k]):
            continue
        order.append(k)
        fill[k] = sorted(near[k])
        for i in fill[k]:
            near[i].discard(k)
            near[i].update(j for j in fill[k] if j != i)
            heapq.heappush(heap, (len(near[i]), i))
    return order, fill


def _pairs(
    order: list[int], entries: dict[int, list[int]], columns: IntArray, below: dict[tuple[int, int], int]
) -> list[list[tuple[int, int]]]:
    """Return the products that add up to each entry of the square: those below the diagonal, then the diagonal."""
    pairs: list[list[tuple[int, int]]] = [[] for _ in range(len(below) + len(order))]
    met: dict[int, list[tuple[int, int]]] = {}
    number = 0
    for place, row in enumerate(order):
        for k in entries[row]:
            for other, at in met.setdefault(int(columns[k]), []):
                pairs[below[place, other]].append((number, at))
            met[int(columns[k])].append((place, number))
            pairs[len(below) + place].append((number, number))
            number += 1
    return pairs
