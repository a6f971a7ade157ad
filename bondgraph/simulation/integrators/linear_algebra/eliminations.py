"""Symbolic factorisation of a symmetric pattern by its elimination tree, in the subset that becomes machine code."""

from __future__ import annotations

from compiler.api import Ints, Record, sized

NOBODY = -1


class Eliminations(Record):
    """n pivots in an order, with the elimination tree (Liu, ACM Trans. Math. Software 12, 1986): the parent of a pivot is the first one that it updates."""

    n: int
    start: Ints  # n + 1: of the neighbours of each node
    neighbours: Ints
    order: Ints  # n: nodes as they are eliminated
    place: Ints = sized("n")  # where each node comes in that
    above: Ints = sized("n")  # pivots
    reached: Ints = sized("n")
    child: Ints = sized("n")  # the first one below
    sibling: Ints = sized("n")
    stack: Ints = sized("n")
    count: Ints = sized("n")  # rows of each column of L, without its diagonal
    number: Ints = sized("n")  # those of each column of U
    lower: Ints
    upper: Ints
    wide: Ints = sized("n")  # columns of one pattern from there on, but for their own rows


def plan_eliminations(e: Eliminations) -> None:
    """Compute from an order: the elimination tree, a postorder of it, in which columns of equal pattern are adjacent, and the lengths of the columns."""
    for k in range(e.n):
        e.place[e.order[k]] = k
    grow_tree(e)
    go_through_tree(e)
    for k in range(e.n):
        e.stack[e.number[k]] = e.order[k]
    for k in range(e.n):
        e.order[k] = e.stack[k]
        e.place[e.order[k]] = k
    grow_tree(e)
    measure_columns(e)


def grow_tree(e: Eliminations) -> None:
    """Compute the elimination tree."""
    for k in range(e.n):
        e.above[k] = NOBODY
        e.reached[k] = NOBODY
        i = e.order[k]
        for p in range(e.start[i], e.start[i + 1]):
            r = e.place[e.neighbours[p]]
            while r != NOBODY and r < k:
                further = e.reached[r]
                e.reached[r] = k
                if further == NOBODY:
                    e.above[r] = k
                r = further


def go_through_tree(e: Eliminations) -> None:
    """Number the pivots in postorder: all descendants of a pivot come right before it."""
    n = e.n
    for k in range(n):
        e.child[k] = NOBODY
    for k in range(n - 1, -1, -1):
        if e.above[k] != NOBODY:
            e.sibling[k] = e.child[e.above[k]]
            e.child[e.above[k]] = k
    number = 0
    for root in range(n):
        if e.above[root] != NOBODY:
            continue
        e.stack[0] = root
        depth = 1
        while depth > 0:
            k = e.stack[depth - 1]
            below = e.child[k]
            if below != NOBODY:
                e.child[k] = e.sibling[below]
                e.stack[depth] = below
                depth += 1
            else:
                e.number[k] = number
                number += 1
                depth -= 1


def measure_columns(e: Eliminations) -> None:
    """Count the rows of each column of L: a row has entries at the pivots on the tree paths between its neighbours and itself."""
    for k in range(e.n):
        e.count[k] = 0
        e.number[k] = 0
    for k in range(e.n):
        e.reached[k] = k
        i = e.order[k]
        for p in range(e.start[i], e.start[i + 1]):
            r = e.place[e.neighbours[p]]
            while r < k and e.reached[r] != k:
                e.reached[r] = k
                e.count[r] += 1
                e.number[k] += 1
                r = e.above[r]
    for k in range(e.n - 1, -1, -1):
        alike = k + 1 < e.n and e.above[k] == k + 1 and e.count[k] == e.count[k + 1] + 1
        e.wide[k] = e.wide[k + 1] + 1 if alike and e.count[k] > 0 else 1


def put_rows(e: Eliminations) -> None:
    """Store the rows of the columns of L and of U, rising. `count` and `number` hold the starts of the columns at first, and their ends afterwards."""
    for k in range(e.n):
        e.reached[k] = k
        i = e.order[k]
        for p in range(e.start[i], e.start[i + 1]):
            r = e.place[e.neighbours[p]]
            while r < k and e.reached[r] != k:
                e.reached[r] = k
                e.lower[e.count[r]] = k
                e.count[r] += 1
                r = e.above[r]
    begin = 0
    for k in range(e.n):
        for p in range(begin, e.count[k]):
            e.upper[e.number[e.lower[p]]] = k
            e.number[e.lower[p]] += 1
        begin = e.count[k]
