"""Conflict of two demands: the place where they meet, and the bonds along which each of them gets there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..fast_dataclass import dataclass
from ..graph.elements import Kind
from ..graph.network import Element, Junction
from ..source import Span
from .errors import StrokeConflict
from .strokes import Contradiction, Stroke, StrokeReason, Strokes

SHOWN = 6  # demands that a message names at most


@dataclass(frozen=True, slots=True)
class Chain:
    """A demand, and the bonds along which it determines a variable that another one determines too."""

    node: int
    because: StrokeReason
    bonds: tuple[int, ...]  # from the demanding node to where the chains meet


def conflict_of(strokes: Strokes, demand: Stroke, contradiction: Contradiction) -> StrokeConflict:
    """Diagnostic for a demand that failed, while the strokes still contain its consequences."""
    stroke = contradiction.stroke
    place = contradiction.node
    if place is None and stroke.reason.because is StrokeReason.FOLLOWS:
        place = stroke.reason.node
    if place is None:  # a demand on a bond that already has a stroke
        reason = strokes.reasons[stroke.bond]
        assert reason is not None
        if reason.because is not StrokeReason.FOLLOWS:
            chains = [Chain(reason.node, reason.because, (stroke.bond,)), Chain(demand.node, demand.reason.because, ())]
            return _message(strokes, demand, None, chains, True)
        place = reason.node
        decides = {stroke.bond: not stroke.effort}
    else:
        decides = {}
    bonds = strokes.graph.incident[place]
    deciding = [b for b in bonds if _decides(strokes, b, place, decides)]
    several = len(deciding) > 1
    chains = []
    for bond in deciding if several else bonds:
        found = [Chain(demand.node, demand.reason.because, (bond,))] if bond in decides else _chains(strokes, bond)
        chains += [c for c in found if all(c != other for other in chains)]
    return _message(strokes, demand, place, chains, several)


def no_strokes(strokes: Strokes, met: Iterable[int]) -> StrokeConflict:
    """Diagnostic for junctions that have fewer bonds than they need, for every choice of strokes."""
    graph = strokes.graph
    nodes = sorted(v for v in met if v < len(graph.nodes))
    junctions = [n for n in nodes if isinstance(graph.nodes[n], Junction)] or nodes
    chains: list[Chain] = []
    for node in nodes:
        for bond in graph.incident[node]:
            if strokes.effort_from[bond] is not None:
                chains += [c for c in _chains(strokes, bond) if all(c.node != other.node for other in chains)]
    names = _list([graph.nodes[n].name for n in junctions])
    what = f"No strokes fit around {names}: whichever way they are put, one junction is decided twice or not at all"
    hint = (
        f"Put a resistor or a storage on {'one of these junctions' if len(junctions) > 1 else names}: it decides there."
    )
    return StrokeConflict(graph.nodes[junctions[0]].span, what, hint, _related(strokes, chains, None, None))


def bond_to_itself(strokes: Strokes, bond: int) -> StrokeConflict:
    """Diagnostic for a bond from a junction to the same junction."""
    ends = strokes.graph.bonds[bond]
    name = f"`{strokes.graph.nodes[ends.tail.node].name}`"
    what = f"A bond leads from {name} to {name}: nothing decides what it carries"
    return StrokeConflict(ends.span, what, "Remove it, or put an element between its ends.", ())


def _decides(strokes: Strokes, bond: int, node: int, demanded: dict[int, bool]) -> bool:
    """Return True if a bond determines the variable that the bonds of a node share: at a 0 the effort, else the flow."""
    effort = demanded[bond] if bond in demanded else strokes.decides_effort(bond, node)
    kind = strokes.graph.nodes[node].kind
    return effort is (kind is not Kind.ZERO)


def _chains(strokes: Strokes, bond: int) -> list[Chain]:
    """Demands from which a stroke follows, each with the fewest bonds between."""
    after: dict[int, int | None] = {bond: None}
    queue, found = [bond], []
    for current in queue:
        reason = strokes.reasons[current]
        assert reason is not None
        if reason.because is not StrokeReason.FOLLOWS:
            path, here = [], current
            while here is not None:
                path.append(here)
                following = after[here]
                if following is None:
                    break
                here = following
            found.append(Chain(reason.node, reason.because, tuple(path)))
        for cause in _causes(strokes, current, reason.node, reason.bond):
            if cause not in after:
                after[cause] = current
                queue.append(cause)
    return found


def _causes(strokes: Strokes, bond: int, node: int, follows: int | None) -> Sequence[int]:
    """Strokes at a node that imply the one on a bond: the determining one, or all others if they do not determine."""
    if follows is None:
        return ()
    if isinstance(strokes.graph.nodes[node], Junction) and _decides(strokes, bond, node, {}):
        return [b for b in strokes.graph.incident[node] if b != bond]
    return (follows,)


# ---------------------------------------------------------------- words


def _message(strokes: Strokes, demand: Stroke, place: int | None, chains: list[Chain], several: bool) -> StrokeConflict:
    nodes = strokes.graph.nodes
    chains = sorted(chains, key=lambda c: c.node)
    if all(c.node != demand.node for c in chains):
        chains.append(Chain(demand.node, demand.reason.because, ()))
    ends = list(dict.fromkeys(c.node for c in chains))
    names = _list([nodes[n].name for n in ends])
    decide = {1: f"{names} decides", 2: f"{names} both decide"}.get(len(ends), f"{names} all decide")
    if place is None:
        what = f"{names} both decide the {'effort' if demand.effort else 'flow'} of the bond between them"
        hint = "Put a junction with a resistor or a storage between them, or let one of them decide the other variable."
    else:
        what, hint = _words(strokes, place, decide, names, several)
    if any(c.because is StrokeReason.MECHANISM for c in chains):
        hint = "Bodies and frames take efforts and give flows: push with an Se, put a spring or damper on a 0-junction between, or drive a joint."
    for chain in chains:
        if chain.because is StrokeReason.REQUIRED:
            hint += f" Or leave out the `require` of `{nodes[chain.node].name}`."
            break
    related = _related(strokes, chains, demand.node, place)
    return StrokeConflict(nodes[demand.node].span, what, hint, related)


def _words(strokes: Strokes, place: int, decide: str, names: str, several: bool) -> tuple[str, str]:
    """Description of the conflict where the chains meet, and the advice."""
    node = strokes.graph.nodes[place]
    name, alone = f"`{node.name}`", decide.endswith(" decides")
    if isinstance(node, Element):
        kind = "transformer" if node.kind is Kind.TRANSFORMER else "gyrator"
        hint = f"Put a resistor or a storage beside {name}, or make one of the sources the other kind."
        return f"{decide} what the {kind} {name} makes of one side for the other", hint
    number, shared, other = ("0", "effort", "flow") if node.kind is Kind.ZERO else ("1", "flow", "effort")
    if several:
        beside = "in series (a 1-junction with an R or I)" if number == "0" else "between (a 0-junction with an R or C)"
        last = "." if alone else ", or make one of them the other kind of source."
        twice = " by two ways" if alone else ""
        return (
            f"The {number}-junction {name} takes its {shared} from one bond, but {decide} it{twice}",
            f"Put a resistor or a storage {beside}{last}",
        )
    storage = "C" if number == "0" else "I"
    hint = f"Put an R or {storage} on {name}{'' if alone else f', or let one of them decide the {shared}'}."
    only = f"{names} decide{'s' if alone else ''} {other}s only"
    return f"Nothing is left to decide the {shared} of the {number}-junction {name}: {only}", hint


def _related(
    strokes: Strokes, chains: list[Chain], demand: int | None, place: int | None
) -> tuple[tuple[Span, str], ...]:
    """Places of each demand, of the bonds along which it comes, and of the node where they meet, with notes."""
    nodes = strokes.graph.nodes
    related = []
    for chain in chains[:SHOWN]:
        if chain.node == demand and len(chain.bonds) < 2:
            continue
        way = _way(strokes, chain)
        related.append((nodes[chain.node].span, f"`{nodes[chain.node].name}`: {chain.because.value}{way}"))
    if place is not None:
        related.append((nodes[place].span, "here they meet"))
    return tuple(related)


def _way(strokes: Strokes, chain: Chain) -> str:
    """Nodes along a chain."""
    names, here = [strokes.graph.nodes[chain.node].name], chain.node
    for bond in chain.bonds:
        ends = strokes.graph.bonds[bond]
        here = ends.head.node if ends.tail.node == here else ends.tail.node
        names.append(strokes.graph.nodes[here].name)
    if len(names) < 3:
        return ""
    if len(names) > 9:
        names = [*names[:4], "…", *names[-4:]]
    return f" (by way of {', '.join(f'`{n}`' if n != '…' else n for n in names[1:])})"


def _list(names: Sequence[str]) -> str:
    """`a`, `b` and `c`."""
    quoted = [f"`{n}`" for n in names[:SHOWN]] + (["others"] if len(names) > SHOWN else [])
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"
