"""Events as equations: a condition that is 1 or 0, and for each target a variable with its new value.

If a storage is set by another variable than the stored one (`mass.v = …`), its law converts the value if it can be solved. Otherwise,
and for variables computed from states, the variable is the target, and the states follow at the event.
"""

from __future__ import annotations

from ..algebra.expression import Expression, Symbol, substitute
from ..algebra.formula import leaf
from ..graph.network import Action, Element, Event, PortVariable, Quantity
from .builder import EquationBuilder
from .laws import solved
from .system import EventAssignment, EventRow, JunctionSwitch


def event_equations(to: EquationBuilder) -> None:
    """Write the conditions and values of all events, and the conditions of switched junctions."""
    graph = to.graph
    elements = {n.name: n for n in graph.nodes if isinstance(n, Element)}
    for event in graph.events:
        to.events.append(_event(event, elements, to))
    for switch in graph.switches:
        condition = to.variable(f"{switch.junction} is active", "computed", "1")
        to.apply(condition, switch.active, switch.span, switch.junction)
        to.switches.append(JunctionSwitch(switch.junction, condition, switch.span))


def _event(event: Event, elements: dict[str, Element], to: EquationBuilder) -> EventRow:
    condition = to.variable(f"{'every' if event.sampling else 'when'} {event.words}", "computed", "1")
    to.apply(condition, event.condition, event.span, event.name or "when")
    settings = tuple(_setting(action, elements, to) for action in event.actions)
    values = () if event.sampling is None else event.sampling.values()
    sampling = [0.0 if x is None else to.static(to.folded(x), f"every {event.words}", event.span) for x in values]
    return EventRow(condition, settings, event.name, event.words, event.span, tuple(sampling), event.stops, event.late)


def _setting(action: Action, elements: dict[str, Element], to: EquationBuilder) -> EventAssignment:
    target = action.target
    value = to.held(to.folded(action.value), f"new {action.words}", "", action.span)
    if isinstance(target, Quantity):
        number = to.quantity(target.name)
        assert isinstance(number, int)
        return EventAssignment(number, value, action.words, action.span)
    element = elements.get(target.node)
    if element is not None and len(element.ports) == 1 and target.variable != element.stored[0]:
        found = _through_law(element, value, to)
        if found is not None:
            stored = to.reading(target._replace(variable=element.stored[0]))
            number = to.held(found, f"new {element.name}.{element.stored[0]}", "", action.span)
            return EventAssignment(stored, number, action.words, action.span)
    return EventAssignment(to.reading(target), value, action.words, action.span)


def _through_law(element: Element, value: int, to: EquationBuilder) -> Expression | None:
    """Stored quantity of a one-port storage from the value of its other variable; None if its law cannot be solved for it."""
    found = solved(element.law, (PortVariable(0, element.stored[0]),))
    if found is None:
        return None

    def put(symbol: Symbol) -> Expression:
        return (
            Symbol(value) if isinstance(symbol.key, PortVariable) else leaf(to.reference(element.arguments[symbol.key]))
        )

    return substitute(found[0], put)
