"""Domains: the letters and dimensions of effort, flow, displacement and momentum."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ..fast_dataclass import dataclass
from .units import AMPERE, KELVIN, KILOGRAM, METRE, MOLE, NEWTON, ONE, PASCAL, SECOND, VOLT, WATT, Dimension

EFFORT, FLOW, DISPLACEMENT, MOMENTUM = "e", "f", "q", "p"
GENERIC = (EFFORT, FLOW, DISPLACEMENT, MOMENTUM)


@dataclass(frozen=True, slots=True)
class Domain:
    """One physical domain; `letters` are its names for e, f, q, p (None if it has none)."""

    name: str
    effort: Dimension
    flow: Dimension
    letters: tuple[str | None, str | None, str | None, str | None]
    typed: bool = True
    guessed: bool = True  # True if the letters of a law may imply it

    @property
    def has_power(self) -> bool:
        """True if effort times flow is a power."""
        return self.typed and self.effort * self.flow == WATT

    @property
    def is_balanced(self) -> bool:
        """True if an energy balance counts effort times flow: a power, or a bare number of a plain model."""
        return self.has_power or not self.typed

    def dimension(self, variable: str) -> Dimension:
        """Dimension of `e`, `f`, `q` or `p`."""
        if not self.typed:
            return ONE
        match variable:
            case "e":
                return self.effort
            case "f":
                return self.flow
            case "q":
                return self.flow * SECOND
        return self.effort * SECOND

    def letter(self, variable: str) -> str:
        """Letter of this domain for `e`, `f`, `q` or `p`."""
        return self.letters[GENERIC.index(variable)] or variable

    def variable(self, letter: str) -> str | None:
        """`e`, `f`, `q` or `p` for a letter of this domain or a generic letter; None for any other word."""
        if letter in self.letters:
            return GENERIC[self.letters.index(letter)]
        return letter if letter in GENERIC else None


DOMAINS: Mapping[str, Domain] = {
    d.name: d
    for d in (
        Domain("translation", NEWTON, METRE / SECOND, ("F", "v", "x", "p")),
        Domain("rotation", NEWTON * METRE, ONE / SECOND, ("M", "omega", "phi", "L")),
        Domain("electric", VOLT, AMPERE, ("u", "i", "q", "lambda")),
        Domain("magnetic", AMPERE, VOLT, ("mmf", "Phi_dot", "Phi", None)),
        Domain("hydraulic", PASCAL, METRE**3 / SECOND, ("P", "Q", "V", "Gamma")),
        Domain("thermal", KELVIN, WATT / KELVIN, ("T", "S_dot", "S", None)),
        Domain("chemical", NEWTON * METRE / MOLE, MOLE / SECOND, ("mu", "n_dot", "n", None)),
        Domain("acoustic", PASCAL, METRE**3 / SECOND, ("P", "Q", "V", "Gamma"), guessed=False),
        Domain("pseudothermal", KELVIN, WATT, ("T", "Q_dot", "Q", None), guessed=False),
        Domain("pneumatic", PASCAL, KILOGRAM / SECOND, ("P", "m_dot", "m", None), guessed=False),
        Domain("untyped", ONE, ONE, ("e", "f", "q", "p"), typed=False),
    )
}

# Multibond domains: the scalar ports that they bundle.
BUNDLES: Mapping[str, Mapping[str, str]] = {
    "planar": {"x": "translation", "y": "translation", "phi": "rotation"},
    "spatial": {
        "x": "translation", "y": "translation", "z": "translation", "rx": "rotation", "ry": "rotation", "rz": "rotation",
    },
}  # fmt: skip


def components_of(ports: Iterable[str], name: str) -> dict[str, str]:
    """Ports of one multibond of an element, by component: of `a` the port `a.x` is `x`, and the port `a[2]`, of a width, is `[2]`."""
    return {p[len(name) :].removeprefix("."): p for p in ports if name and p.startswith((f"{name}.", f"{name}["))}


def multibond_of(port: str) -> str:
    """Name of the multibond that a port belongs to: `a` of `a.x` and `a[2]`; empty for a single port."""
    return port.rpartition("[" if port.endswith("]") else ".")[0]


# Default domains of the components of multibonds: those of bundles and of a universal joint.
COMPONENT_DOMAINS: Mapping[str, str] = {
    **BUNDLES["spatial"], **BUNDLES["planar"], "phi1": "rotation", "phi2": "rotation",
}  # fmt: skip
