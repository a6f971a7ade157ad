"""Elements by their textbook letters, each with its law as in the language."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypedDict, Unpack

from compiler.api import BUNDLES, ELEMENTS, braces, letters

from ..errors import UsageError
from .argument_checks import (
    Ports,
    Value,
    domain_of,
    expression_of,
    is_number,
    law_of,
    literal_of,
    mapping_of,
    path_of,
    ports_of,
    value_of,
)
from .parts import Part, name_of

CAUSALITIES = ("integral", "derivative", "effort", "flow")
STORAGES = letters("storage")


class ElementOptions(TypedDict, total=False):
    """Further properties of an element besides its law."""

    # ports of a field: `ports=("x", "phi")`, or with domains `ports={"q": "electric", "x": "translation"}`
    ports: Ports
    energy: str  # energy of a storage, instead of its law
    start: Mapping[str, Value]  # `start={"x": "1 mm"}`
    nominal: Mapping[str, Value]
    prefer: str  # integral, derivative, effort or flow
    require: str
    description: str


class Elements:
    """Calls for the element kinds; the graph stores their statements."""

    plain: bool

    def _add(self, name: str, statement: str, ports: tuple[str, ...] | None) -> Part:
        raise NotImplementedError

    def zero(self, name: str, domain: str = "", *, active: Value = None, description: str = "") -> Part:
        """Add a 0-junction: one effort for all bonds; zero effort while the condition `active` is false."""
        return self._junction("0", name, domain, active, description)

    def one(self, name: str, domain: str = "", *, active: Value = None, description: str = "") -> Part:
        """Add a 1-junction: one flow for all bonds; zero flow while the condition `active` is false: `active="not resting"`."""
        return self._junction("1", name, domain, active, description)

    def Se(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a source of effort: `Se("push", "F = 1 N")`."""
        return self.element("Se", name, law, **given)

    def Sf(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a source of flow: `Sf("road", "v = 0.2 [m/s]")`."""
        return self.element("Sf", name, law, **given)

    def MSe(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a modulated source of effort, which reads other variables: `MSe("drive", "F = force")`."""
        return self.element("MSe", name, law, **given)

    def MSf(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a modulated source of flow, which reads other variables."""
        return self.element("MSf", name, law, **given)

    def C(self, name: str, law: str = "", **given: Unpack[ElementOptions]) -> Part:
        """Add a storage of displacement, by its law or its energy: `C("spring", "F = k*x", start={"x": "1 mm"})`."""
        return self.element("C", name, law, **given)

    def I(self, name: str, law: str = "", **given: Unpack[ElementOptions]) -> Part:  # noqa: E743
        """Add a storage of momentum, by its law or its energy: `I("mass", "p = m*v")`."""
        return self.element("I", name, law, **given)

    def IC(self, name: str, law: str = "", **given: Unpack[ElementOptions]) -> Part:
        """Add a field whose ports store displacement (`a.q`) or momentum (`b.p`)."""
        return self.element("IC", name, law, **given)

    def R(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a resistor: `R("damper", "F = r*v")`."""
        return self.element("R", name, law, **given)

    def MR(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a modulated resistor, whose law reads other variables."""
        return self.element("MR", name, law, **given)

    def RS(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a resistor that turns power into heat; its last port delivers the loss of the others."""
        return self.element("RS", name, law, **given)

    def MRS(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a modulated resistor that turns power into heat, whose law reads other variables."""
        return self.element("MRS", name, law, **given)

    def TF(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a transformer: `TF("gear", "omega1 = 20*omega2")`. The bond into it reaches side 1, the bond out of it leaves side 2."""
        return self.element("TF", name, law, **given)

    def MTF(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a modulated transformer, whose ratio reads other variables."""
        return self.element("MTF", name, law, **given)

    def GY(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a gyrator: `GY("motor", "u1 = K*omega2")`."""
        return self.element("GY", name, law, **given)

    def MGY(self, name: str, law: str, **given: Unpack[ElementOptions]) -> Part:
        """Add a modulated gyrator, whose ratio reads other variables."""
        return self.element("MGY", name, law, **given)

    def splitter(self, name: str, ports: Ports) -> Part:
        """Add a splitter: a multibond on one side, its bonds one by one on the other: `hand`, `hand["x"]`."""
        listed, names = ports_of(ports)
        return self._add(name, f"splitter {name_of(name)}{listed}", names)

    def port(self, name: str, domain: str, *, description: str = "") -> Part:
        """Add a port of the model itself, for use in a larger one: `port("ends", "planar")`."""
        text = f"port {name_of(name)}: {domain_of(domain, BUNDLES)}{literal_of(description)}"
        return self._add(name, text, _bonds_of(domain))

    def _junction(self, kind: str, name: str, domain: str, active: Value, description: str) -> Part:
        switch = [] if active is None else [f"active = {value_of(active, f'when `{name}` is active')}"]
        text = f"{kind} {name_of(name)}{f' : {domain_of(domain, BUNDLES)}' if domain else ''}{braces(switch)}"
        return self._add(name, text + literal_of(description), _bonds_of(domain))

    def element(self, kind: str, name: str, law: str = "", **given: Unpack[ElementOptions]) -> Part:
        """Add an element of any kind of the language: `element("R", "damper", "F = r*v")`. Raises `UsageError`."""
        own = name_of(name)
        if kind not in ELEMENTS:
            raise UsageError("BR540", f"`{own}`: `{kind}` is no kind of element; they are {', '.join(ELEMENTS)}")
        for word in given:
            if word not in ElementOptions.__annotations__:
                raise UsageError(
                    "BR512", f"`{own}`: an element has no `{word}`; it has {', '.join(ElementOptions.__annotations__)}"
                )
        if "energy" in given:
            if kind not in STORAGES or law:
                raise UsageError(
                    "BR513", f"`{own}`: an energy stands in a storage ({', '.join(STORAGES)}), in place of its law"
                )
            text = f"energy = {expression_of(given['energy'], f'the energy of `{own}`')}"
        elif law == "":
            raise UsageError("BR514", f"`{own}` needs its law{', or its energy' if kind in STORAGES else ''}")
        else:
            text = law_of(law, f"the law of `{own}`")
        listed, names = ports_of(given.get("ports", ()), BUNDLES)
        attributes = braces(self._attributes(own, given))
        statement = f"{kind} {own}{listed} : {text}{attributes}{literal_of(given.get('description', ''))}"
        return self._add(name, statement, names)

    def _attributes(self, name: str, given: ElementOptions) -> Iterator[str]:
        for word, values in (("start", given.get("start", {})), ("nominal", given.get("nominal", {}))):
            for key, value in mapping_of(values, f"`{word}` of `{name}`").items():
                yield f"{word} {path_of(key)} = {self._with_unit(value, f'`{word} {key}` of `{name}`')}"
        for word, side in (("prefer", given.get("prefer")), ("require", given.get("require"))):
            if side is not None:
                if side not in CAUSALITIES:
                    raise UsageError("BR515", f"`{word}` of `{name}` is one of {', '.join(CAUSALITIES)}, not {side!r}")
                yield f"{word} = {side}"

    def _with_unit(self, value: Value, what: str) -> str:
        if is_number(value) and value != 0 and not self.plain:
            raise UsageError("BR516", f"{what}: a number needs its unit here, as text: '1 mm', not {value!r}")
        return value_of(value, what)


def _bonds_of(domain: str) -> tuple[str, ...] | None:
    """Names of the bonds of a domain; None for one of a width, whose bonds have numbers."""
    return None if "[" in domain else tuple(BUNDLES.get(domain, ()))
