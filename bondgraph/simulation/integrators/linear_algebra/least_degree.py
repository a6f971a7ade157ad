"""Fill-reducing order for sparse factors, in the subset that becomes machine code: nodes of least degree are eliminated first.

Approximate degrees of Amestoy, Davis and Duff (SIAM J. Matrix Anal. Appl. 17, 1996): an eliminated node is not filled in but stored as an element, a
list of the nodes that it joins; elements within another one are absorbed, nodes with equal neighbours are eliminated together, and nodes shared
by two elements are counted twice in a degree. A node with very many neighbours, which each of them would search, comes last.
"""

from __future__ import annotations

from math import sqrt

from compiler.api import Ints, Record, sized

NOBODY = -1
DENSE, FEW = 10.0, 16.0  # nodes with more neighbours than DENSE sqrt(n), and than FEW, come last


class Quotient(Record):
    """Quotient graph of n nodes: some wait for elimination, others have become elements.

    The list of a node has its elements first, then other neighbours; the list of an element has the nodes that it joins.
    """

    n: int
    left: int  # number of nodes still to be eliminated
    at: int  # number of nodes eliminated
    least: int  # lower bound of the degrees of waiting nodes
    mark: int  # greater than all earlier marks
    free: int  # start of the free part of `lists`
    room: int  # its length: n more than all neighbours
    lists: Ints = sized("room")
    spare: Ints = sized("room")
    start: Ints  # n
    length: Ints  # n
    joined: Ints = sized("n")  # number of elements in a list
    weight: Ints = sized("n")  # number of nodes that one represents; 0: none any more; less than 0: joined by the pivot
    degree: Ints = sized("n")
    first: Ints = sized("n", plus=1)  # first node of each degree
    after: Ints = sized("n")  # the next node of the same degree
    before: Ints = sized("n")
    bucket: Ints = sized("n", plus=1)  # first of the nodes that may be equal
    seen: Ints = sized("n")  # marks; 0: an element that is absorbed
    member: Ints = sized("n")  # the next node with the same representative
    last: Ints = sized("n")  # the last of these
    order: Ints = sized("n")  # eliminated nodes, in this order


def least_degree(q: Quotient) -> None:
    """Compute the order from `start`, `length` and `lists` of a symmetric pattern without its diagonal; all other fields must be zero at first."""
    all_wait(q)
    while q.left > 0:
        while q.first[q.least] == NOBODY:
            q.least += 1
        pivot = q.first[q.least]
        unchain(q, pivot)
        join(q, pivot)
        outside(q, pivot)
        shrink(q, pivot)
        unite(q, pivot)
        put_back(q, pivot)


def all_wait(q: Quotient) -> None:
    """Let all nodes wait, except those with very many neighbours, which are put at the end."""
    n = q.n
    dense = max(FEW, DENSE * sqrt(float(n)))
    for i in range(n):
        q.first[i] = NOBODY
        q.bucket[i] = NOBODY
        q.member[i] = NOBODY
        q.last[i] = i
        q.weight[i] = 1 if float(q.length[i]) <= dense else 0
    q.first[n] = NOBODY
    q.bucket[n] = NOBODY
    q.left = n
    q.mark = 2
    for i in range(n - 1, -1, -1):
        if q.weight[i] == 0:
            q.left -= 1
            q.order[q.left] = i
            q.length[i] = 0
        else:
            for k in range(q.start[i], q.start[i] + q.length[i]):
                q.degree[i] += q.weight[q.lists[k]]
            chain(q, i, q.degree[i])


def chain(q: Quotient, i: int, degree: int) -> None:
    """Insert a node into the list of its degree."""
    other = q.first[degree]
    q.degree[i] = degree
    q.after[i] = other
    q.before[i] = NOBODY
    if other != NOBODY:
        q.before[other] = i
    q.first[degree] = i
    q.least = min(q.least, degree)


def unchain(q: Quotient, i: int) -> None:
    """Remove a node from the list of its degree."""
    other = q.after[i]
    if other != NOBODY:
        q.before[other] = q.before[i]
    if q.before[i] != NOBODY:
        q.after[q.before[i]] = other
    else:
        q.first[q.degree[i]] = other


def join(q: Quotient, pivot: int) -> None:
    """Make the pivot an element: its list has all waiting neighbours of it and of its elements."""
    if q.free + q.degree[pivot] > q.room:
        tidy(q)
    q.left -= q.weight[pivot]
    q.weight[pivot] = -q.weight[pivot]
    own = q.start[pivot]
    elements = q.joined[pivot]
    begins = q.free
    q.degree[pivot] = 0
    for k in range(own, own + elements):
        element = q.lists[k]
        gather(q, pivot, q.start[element], q.length[element])
        q.seen[element] = 0
        q.length[element] = 0
    gather(q, pivot, own + elements, q.length[pivot] - elements)
    q.start[pivot] = begins
    q.length[pivot] = q.free - begins
    q.joined[pivot] = 0
    q.seen[pivot] = 1


def gather(q: Quotient, pivot: int, start: int, count: int) -> None:
    """Add the waiting nodes of a part of `lists` that are not joined yet to the pivot's list."""
    for k in range(start, start + count):
        i = q.lists[k]
        if q.weight[i] > 0:
            unchain(q, i)
            q.degree[pivot] += q.weight[i]
            q.weight[i] = -q.weight[i]
            q.lists[q.free] = i
            q.free += 1


def tidy(q: Quotient) -> None:
    """Compact the lists: remove the gaps between them."""
    to = 0
    for i in range(q.n):
        start = q.start[i]
        q.start[i] = to
        for k in range(start, start + q.length[i]):
            q.spare[to] = q.lists[k]
            to += 1
    for k in range(to):
        q.lists[k] = q.spare[k]
    q.free = to


def outside(q: Quotient, pivot: int) -> None:
    """Mark elements by the number of their nodes that the pivot does not join."""
    for p in range(q.start[pivot], q.start[pivot] + q.length[pivot]):
        i = q.lists[p]
        for k in range(q.start[i], q.start[i] + q.joined[i]):
            element = q.lists[k]
            if q.seen[element] >= q.mark:
                q.seen[element] += q.weight[i]
            elif q.seen[element] != 0:
                q.seen[element] = q.degree[element] + q.mark + q.weight[i]


def shrink(q: Quotient, pivot: int) -> None:
    """Remove from the lists of joined nodes the entries that the pivot covers; a node with no other entries is eliminated with it."""
    for p in range(q.start[pivot], q.start[pivot] + q.length[pivot]):
        i = q.lists[p]
        at = q.start[i]
        to = at
        beyond = 0
        key = 0
        for k in range(at, at + q.joined[i]):
            element = q.lists[k]
            more = q.seen[element] - q.mark
            if more > 0:
                beyond += more
                key += element
                q.lists[to] = element
                to += 1
            else:  # the element lies within the pivot, or was absorbed before
                q.seen[element] = 0
                q.length[element] = 0
        elements = to - at
        for k in range(at + q.joined[i], at + q.length[i]):
            other = q.lists[k]
            if q.weight[other] > 0:
                beyond += q.weight[other]
                key += other
                q.lists[to] = other
                to += 1
        if beyond == 0:
            q.degree[pivot] += q.weight[i]
            q.left += q.weight[i]
            stand_for(q, pivot, i)
            continue
        q.lists[to] = q.lists[at + elements]  # the pivot comes first: at least one entry was removed
        q.lists[at + elements] = q.lists[at]
        q.lists[at] = pivot
        q.joined[i] = elements + 1
        q.length[i] = to - at + 1
        q.degree[i] = min(q.degree[i], beyond)
        key %= q.n
        q.before[i] = key
        q.after[i] = q.bucket[key]
        q.bucket[key] = i
    q.mark += q.n + 1


def stand_for(q: Quotient, i: int, other: int) -> None:
    """Let one node represent another from now on."""
    q.weight[other] = 0
    q.length[other] = 0
    q.member[q.last[i]] = other
    q.last[i] = q.last[other]


def unite(q: Quotient, pivot: int) -> None:
    """Merge nodes with equal lists."""
    for p in range(q.start[pivot], q.start[pivot] + q.length[pivot]):
        if q.weight[q.lists[p]] == 0:
            continue
        key = q.before[q.lists[p]]
        i = q.bucket[key]
        q.bucket[key] = NOBODY
        while i != NOBODY:
            for k in range(q.start[i], q.start[i] + q.length[i]):
                q.seen[q.lists[k]] = q.mark
            previous = i
            other = q.after[i]
            while other != NOBODY:
                if are_equal(q, i, other):
                    q.weight[i] += q.weight[other]
                    stand_for(q, i, other)
                    q.after[previous] = q.after[other]
                else:
                    previous = other
                other = q.after[other]
            q.mark += 1
            i = q.after[i]


def are_equal(q: Quotient, i: int, other: int) -> bool:
    """Return True if the list of another node equals that of this one, which is marked."""
    if q.length[other] != q.length[i] or q.joined[other] != q.joined[i]:
        return False
    for k in range(q.start[other], q.start[other] + q.length[other]):
        if q.seen[q.lists[k]] != q.mark:
            return False
    return True


def put_back(q: Quotient, pivot: int) -> None:
    """Let joined nodes wait again, with their new degrees; the pivot and all nodes that it represents get their places."""
    begins = q.start[pivot]
    to = begins
    for p in range(begins, begins + q.length[pivot]):
        i = q.lists[p]
        weight = -q.weight[i]
        if weight != 0:
            q.weight[i] = weight
            chain(q, i, min(q.degree[i] + q.degree[pivot] - weight, q.left - weight))
            q.lists[to] = i
            to += 1
    q.length[pivot] = to - begins
    q.free = to
    place = pivot
    while place != NOBODY:
        q.order[q.at] = place
        q.at += 1
        place = q.member[place]
    q.weight[pivot] = 0
