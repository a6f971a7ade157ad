"""Storages that depend on their own derivatives without end: seen by counting orders, before expressions of high order are written."""

from __future__ import annotations

import pytest

from compiler.reduction.differentiate import Differentiator
from tests.compiling import compiled

LAWS = {
    "linear": ("T = room + S/c*room", "a.T*a.S_dot = G*(a.T - b.T)"),
    "exponential": ("T = room*exp(S/c)", "a.T*a.S_dot = G*(a.T - b.T)"),
    "radiation": ("T = room*exp(S/c)", "a.T*a.S_dot = G*(a.T^4 - b.T^4)/room^3"),
    "power": ("T = room*(1 + S/c)^3", "a.T*a.S_dot = G*(a.T - b.T)"),
}


def bar(n: int, law: str, preferred: str, wall: str = "1..n-1") -> str:
    store, conduction = LAWS[law]
    wish = "{ prefer = derivative }" if preferred == "all" else ""
    other = (
        "C other : T = room*exp(S/c) { prefer = derivative }; slice[1] -> other" if preferred == "one beside" else ""
    )
    return f"""model Bar {{
  parameter n = {n}, c: J/K = 15, G: W/K = 1000, room = 293 K
  for k in 1..n {{
    0 slice[k] : thermal
    C store[k] : {store} {wish}
    slice[k] -> store[k]
  }}
  {other}
  for k in {wall} {{
    RS wall[k](a, b) : {conduction}
    slice[k] -> wall[k].a
    wall[k].b -> slice[k+1]
  }}
  output y = store[1].T
}}"""


def orders(text: str, monkeypatch: pytest.MonkeyPatch) -> tuple[tuple[str, ...], int]:
    """Storages whose preference was dropped, and the highest derivative for which an expression was written."""
    highest = [0]
    chain = Differentiator._chain

    def counted(self: Differentiator, variable: int, item: object) -> object:
        highest.append(self.order.get(variable, 0) + 1)
        return chain(self, variable, item)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(Differentiator, "_chain", counted)
        compilation = compiled(text)
        given_way = compilation.given_way
        compilation.certificate  # noqa: B018
    return given_way, max(highest)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("n", [2, 5, 12])
def test_no_expression_of_high_order_is_written(n: int, law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given_way, highest = orders(bar(n, law, "all"), monkeypatch)
    assert sorted(given_way) == sorted(f"store[{k + 1}]" for k in range(n))
    assert highest == 1


@pytest.mark.parametrize("law", LAWS)
def test_a_wish_that_can_be_kept_beside(law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given_way, highest = orders(bar(3, law, "one beside"), monkeypatch)
    assert given_way == () and highest == 1


CIRCUITS = {
    "RC ladder": "for k in 1..3 { 0 n[k] : electric; C c[k] : q = 2 F*u WISH; n[k] -> c[k]; R g[k] : i = 1 S*u; n[k] -> g[k] }\n"
    "for k in 1..2 { 1 b[k] : electric; R r[k] : u = 3 ohm*i; n[k] -> b[k] -> n[k+1]; b[k] -> r[k] }",
    "one mass": "Se s : F = 1 N\n R r : F = 1 [N*s/m]*v\n I m : p = 1 kg*v WISH\n s -> 1(r) -> m",
    "two masses of one flow": "Se s : F = 1 N\n I a : p = 1 kg*v WISH\n I m : p = 2 kg*v WISH\n s -> 1(a) -> m",
    "mass and spring": "Se s : F = 1 N\n C k : F = 1 [N/m]*x WISH\n I m : p = 2 kg*v WISH\n s -> 1(k) -> m",
    "masses through a gear": "Se s : M = 1 [N*m]\n I a : L = 1 [kg*m^2]*omega WISH\n TF g : omega1 = 3*omega2\n I b : L = 2 [kg*m^2]*omega WISH\n"
    "s -> 1(a) -> g -> b",
    "gyrator": "Se s : u = 1 V*sin(time/1 s)\n I l : lambda = 1 H*i WISH\n R r : u = 1 ohm*i\n GY k : u1 = 2 [V*s]*omega2\n I j : L = 1 [kg*m^2]*omega WISH\n"
    "s -> 1(l, r) -> k -> j",
    "cubic spring": "Se s : F = 1 N\n C k : F = 1 [N/m^3]*x^3 WISH\n R r : F = 1 [N*s/m]*v\n I m : p = 2 kg*v\n s -> 1(k, r) -> m",
    "diode": "Se s : u = 1 V\n R d : i = 1 mA*(exp(u/25 mV) - 1)\n C c : q = 1 mF*u WISH\n R r : i = 1 S*u\n s -> 1(d) -> 0(c) -> r",
    "storages in parallel": "Sf s : i = 1 A\n C a : q = 1 F*u WISH\n C b : q = 2 F*u WISH\n R r : i = 1 S*u\n s -> 0(a, b) -> r",
}  # fmt: skip


@pytest.mark.parametrize("name", CIRCUITS)
def test_the_same_gives_way_as_by_writing_all_orders(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"model A {{\n{CIRCUITS[name]}\n}}".replace("WISH", "{ prefer = derivative }")
    given_way, highest = orders(text, monkeypatch)
    monkeypatch.setattr(Differentiator, "_without_end", lambda self: None)
    assert given_way == orders(text, monkeypatch)[0]
    assert highest <= 2
