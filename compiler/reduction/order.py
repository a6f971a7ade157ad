"""Graph algorithms on integers: needed nodes, dependence, strongly connected blocks (Tarjan, SIAM J. Comput. 1, 1972)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from heapq import heapify, heappop, heappush


def needed(targets: Iterable[int], inputs: Sequence[Sequence[int]], known: set[int] | None = None) -> set[int]:
    """All nodes that the targets depend on, with the targets. They are added to `known`, whose dependences are complete already."""
    seen: set[int] = set() if known is None else known
    stack = list(targets)
    while stack:
        node = stack.pop()
        if node not in seen:
            seen.add(node)
            stack.extend(inputs[node])
    return seen


def blocks(nodes: Iterable[int], inputs: Sequence[Sequence[int]]) -> list[list[int]]:
    """Strongly connected blocks, each after all that it depends on."""
    number: dict[int, int] = {}
    low: dict[int, int] = {}
    on_stack: set[int] = set()
    stack: list[int] = []
    result: list[list[int]] = []
    for root in nodes:
        if root in number:
            continue
        work = [(root, 0)]
        while work:
            node, position = work.pop()
            if position == 0:
                number[node] = low[node] = len(number)
                stack.append(node)
                on_stack.add(node)
            for i in range(position, len(inputs[node])):
                other = inputs[node][i]
                if other not in number:
                    work += [(node, i + 1), (other, 0)]
                    break
                if other in on_stack:
                    low[node] = min(low[node], number[other])
            else:
                if low[node] == number[node]:
                    block = []
                    while True:
                        member = stack.pop()
                        on_stack.discard(member)
                        block.append(member)
                        if member == node:
                            break
                    result.append(block[::-1])
                if work:
                    parent = work[-1][0]
                    low[parent] = min(low[parent], low[node])
    return result


def tear(block: Sequence[int], inputs: Sequence[Sequence[int]]) -> tuple[list[int], list[int]]:
    """Members to cut so that the rest can be computed in order: `(cut, rest in order)`; greedy, by most dependents."""
    members = set(block)
    waiting = {m: {i for i in inputs[m] if i in members} for m in block}
    users: dict[int, list[int]] = {m: [] for m in block}
    for member, sources in waiting.items():
        for source in sources:
            users[source].append(member)
    cut: list[int] = []
    order: list[int] = []
    ready = [m for m in block if not waiting[m]]
    left = set(block)
    reads = {m: list(waiting[m]) for m in block}
    dependents = {m: len(users[m]) for m in block}  # remaining ones
    most = [(-dependents[m], place, m) for place, m in enumerate(block)]  # its count may be too high, never too low
    heapify(most)

    def leave(member: int) -> None:
        left.remove(member)
        for source in reads[member]:
            dependents[source] -= 1
        for user in users[member]:
            waiting[user].discard(member)
            if not waiting[user] and user in left:
                ready.append(user)

    while left:
        while ready:
            member = ready.pop()
            if member not in left:
                continue
            leave(member)
            order.append(member)
        if left:
            count, place, member = heappop(most)
            while member not in left or -count != dependents[member]:
                if member in left:
                    heappush(most, (-dependents[member], place, member))
                count, place, member = heappop(most)
            leave(member)
            cut.append(member)
    return cut, order
