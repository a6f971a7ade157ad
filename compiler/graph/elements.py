"""Table of element kinds: all that the compiler and the product know of each of them, one row per kind.

Words of the text, variables of the law, stored quantity, causality, class, ports, advice and places in drawings are read from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from itertools import groupby
from typing import Literal

from ..fast_dataclass import dataclass


class Kind(Enum):
    """Kind of a node; the values are the textbook's letters."""

    EFFORT_SOURCE = "Se"
    FLOW_SOURCE = "Sf"
    CAPACITOR = "C"
    INERTIA = "I"
    STORAGE_FIELD = "IC"
    RESISTOR = "R"
    TRANSFORMER = "TF"
    GYRATOR = "GY"
    ZERO = "0"
    ONE = "1"
    MECHANISM = "multibody"


Group = Literal["source", "storage", "loss", "transducer"]


@dataclass(frozen=True, slots=True)
class ElementKind:
    """A row: an element as it is written. `e`, `f`, `q` and `p` are effort, flow, displacement and momentum."""

    letters: str  # as written, without a prefix
    node: Kind  # its node in the graph
    group: Group
    variables: str  # that a law may relate, at each port
    example: str  # a law
    relates: str = "efforts and flows"  # by its law, in messages
    advice: str = "Write the equation in these."  # for a law that reads other variables; `{}` is the variable
    of_value: tuple[str, ...] = ()  # laws with a value in place of `{}`, in letters of all domains
    modulated: bool = False  # True if there is a kind with the prefix M, whose law reads other elements
    given: str = ""  # of a source: the variable that it gives
    stored: str = ""  # of a storage: quantities that its ports may store
    stored_words: str = ""
    remembered: str = ""  # integrals of its own flow or effort that the law of a kind that stores no energy may read
    readable: str = "ef"  # variables of a single port that others may read
    sides: bool = False  # True if its ports are 1 and 2 where it lists none
    least_ports: int = 1
    ports_advice: str = ""
    gives_heat: bool = False  # True if the last port delivers what the other ports lose
    receives: bool = True  # True if power counts as positive into it, so that arrows end there
    places: str = ""  # preferred sides in a drawing, best first, of `UDLR`: up, down, left, right


_ROWS = (
    ElementKind(
        "Se", Kind.EFFORT_SOURCE, "source", "e", "F = 1 N", "its effort alone",
        "It gives its effort whatever its flow is; what depends on `{}` belongs in an R beside it.",
        modulated=True, given="e", receives=False, places="LUDR",
        of_value=("e = {}",),
    ),
    ElementKind(
        "Sf", Kind.FLOW_SOURCE, "source", "f", "v = 1 [m/s]", "its flow alone",
        "It gives its flow whatever its effort is; what depends on `{}` belongs in an R beside it.",
        modulated=True, given="f", receives=False, places="LUDR",
        of_value=("f = {}",),
    ),
    ElementKind(
        "C", Kind.CAPACITOR, "storage", "eq", "F = k*x", "effort and displacement",
        "Its flow is the rate of the displacement: `F = k*x`, `q = 2 [uF]*u`. Loss belongs in an R beside it, mass in an I.",
        stored="q", stored_words="displacement", readable="efq", places="UDRL",
        of_value=("q = {}*e", "e = {}*q"),
    ),
    ElementKind(
        "I", Kind.INERTIA, "storage", "fp", "p = m*v", "flow and momentum",
        "Its effort is the rate of the momentum: `p = m*v`, `lambda = L*i`. Loss belongs in an R beside it, stiffness in a C.",
        stored="p", stored_words="momentum", readable="efp", places="UDRL",
        of_value=("p = {}*f",),
    ),
    ElementKind(
        "IC", Kind.STORAGE_FIELD, "storage", "efqp", "e = …", stored="qp", stored_words="displacements and momenta",
        least_ports=2, ports_advice="With one port it is a C or an I.",
    ),
    ElementKind(
        "R", Kind.RESISTOR, "loss", "ef", "F = r*v", "effort and flow",
        "What depends on displacement belongs in a C, or in an MR that reads it.", modulated=True, places="DURL",
        of_value=("e = {}*f",),
    ),
    ElementKind(
        "RS", Kind.RESISTOR, "loss", "ef", "e = …", least_ports=2, ports_advice="An RS has a port for what it loses: `RS pad(shaft, heat)`.",
        gives_heat=True, modulated=True, receives=False,
    ),
    ElementKind(
        "Mem", Kind.RESISTOR, "loss", "ef", "u = (R_0 + a*q)*i", "effort and flow, and its own displacement or momentum",
        remembered="qp", ports_advice="A memristor has one port, and its law reads what has passed: `u = (R_0 + a*q)*i`. Without that it is an R.",
        places="DURL",
    ),
    ElementKind("TF", Kind.TRANSFORMER, "transducer", "ef", "F2 = n*F1", modulated=True, sides=True, receives=False, of_value=("e2 = {}*e1",)),
    ElementKind("GY", Kind.GYRATOR, "transducer", "ef", "u1 = K*omega2", modulated=True, sides=True, receives=False, of_value=("e1 = {}*f2",)),
)  # fmt: skip


def _words() -> dict[str, ElementKind]:
    """Rows by their words in a text: kinds that can be modulated stand together, then the same with the prefix M."""
    found: dict[str, ElementKind] = {}
    for modulated, rows in groupby(_ROWS, lambda row: row.modulated):
        listed = tuple(rows)
        found |= {row.letters: row for row in listed}
        found |= {f"M{row.letters}": row for row in listed if modulated}
    return found


ELEMENTS: Mapping[str, ElementKind] = _words()
OF_NODE: Mapping[Kind, ElementKind] = {row.node: row for row in reversed(_ROWS)}  # the first row of each kind of node
STORAGES = frozenset(row.node for row in _ROWS if row.group == "storage")
TRANSDUCERS = frozenset(row.node for row in _ROWS if row.group == "transducer")
SOURCES = frozenset(row.node for row in _ROWS if row.group == "source")


def letters(*groups: Group) -> tuple[str, ...]:
    """Letters of the nodes of some groups, in the order of the table: `letters("storage")` are C, I and IC."""
    return tuple(dict.fromkeys(str(row.node.value) for row in _ROWS if row.group in groups))
