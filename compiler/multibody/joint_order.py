"""Ranks of joints by their kinds and bodies, not by their names or the order of declarations: they decide where loops are cut.

Colour refinement of B. Weisfeiler and A. Leman (1968): groups of bodies differ if their own data or their joints differ, or the
groups behind these. If all are equal, as the legs of a symmetrical mechanism, the order of declarations decides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any

from ..algebra.formula import Bound
from ..graph.mechanism import GROUND, Body, Joint

ROUNDS = 12  # of refinement: joints that far away still tell two groups apart
Ranks = Mapping[str, int]


def joint_ranks(
    joints: Sequence[Joint],
    members: Mapping[str, Sequence[Body]],
    group_of: Callable[[str], str],
    kept_in: Sequence[Set[str]],
) -> tuple[Ranks, Ranks]:
    """Rank of each joint by its name, and of each group of bodies; equal ones share it.

    `kept_in`: sets of joints that should not close a loop, the most important first.
    """
    kinds = {
        j.name: (*(j.name not in kept for kept in kept_in), len(j.freedoms), j.kind, *map(_words, _vectors(j)))
        for j in joints
    }
    joint_rank = _ranked(kinds)
    ends = {j.name: (group_of(j.first), group_of(j.second)) for j in joints}
    groups = dict.fromkeys([*members, *(g for pair in ends.values() for g in pair)])
    rank = _ranked({g: (g != GROUND, *sorted(map(_data, members.get(g, ())))) for g in groups})
    for _ in range(ROUNDS):
        around: dict[str, list[tuple[int, int]]] = {g: [] for g in groups}
        for name, pair in ends.items():
            for near, far in (pair, pair[::-1]):
                around[near].append((joint_rank[name], rank[far]))
        finer = _ranked({g: (rank[g], sorted(around[g])) for g in groups})
        if finer == rank:
            break
        rank = finer
    return _ranked({n: (joint_rank[n], sorted(rank[g] for g in ends[n])) for n in joint_rank}), rank


def _ranked(keys: Mapping[str, Any]) -> dict[str, int]:
    """Position of each key among the distinct ones, in sorted order."""
    distinct = sorted({repr(key): key for key in keys.values()}.values())
    places = {repr(key): place for place, key in enumerate(distinct)}
    return {name: places[repr(key)] for name, key in keys.items()}


def _vectors(joint: Joint) -> tuple[Bound, ...]:
    return (*joint.position, *joint.axis, *joint.other_axis, joint.ratio)


def _data(body: Body) -> tuple[str, ...]:
    """Mass, position and inertia zz of a body."""
    return tuple(map(_words, (body.mass, *body.position, body.inertia.zz)))


def _words(bound: Bound) -> str:
    """Form of an expression with its numbers, without the names of its symbols."""
    return repr(bound.formula.expression)
