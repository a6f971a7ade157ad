"""Values needed before a run cannot read quantities that change during it: BG106 with the place, or a more specific code."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import pytest

from compiler.errors import CompilationFailed
from tests.compiling import compiled, mistakes

CHANGING = (
    "integral(1 [kg/s], 0 kg)", "2*integral(1 [kg/s], 0 kg)", "delay(1 kg, 1 s)", "1 kg*time/1 s", "b.p/1 [m/s]", "sig", "grown", "on", "inp",
    "1 kg*noise(time, 1 s, 1)", "linear(time, (0 s, 1 s), (0 kg, 1 kg))",
)  # fmt: skip
NAMES = "mode on = 1 kg; input inp = 1 kg; signal sig = 1 kg*time/1 s, grown = integral(1 [kg/s], 0 kg)"
GRAPH = "I b : p = 1 kg*v { START }\n  R d : F = 1 [N*s/m]*v\n  1(b) -> d"
BODY = "mass = 1 kg, inertia = 1 [kg*m^2]"


def model(declared: str = "", start: str = "start v = 1 [m/s]", steps: str = "simulate 0 .. 1 s") -> str:
    graph = GRAPH.replace("START", start)
    return f"model A {{\n  {NAMES}\n  {declared}\n  {graph}\n  output v = b.v\n  experiment e {{ {steps} }}\n}}\n"


Place = Callable[[str], str]
PLACES: dict[str, Place] = {
    "parameter": lambda e: model(f"parameter m = {e}"),
    "with a unit": lambda e: model(f"parameter m: kg = {e}; output q = m"),
    "constant": lambda e: model(f"constant m = {e}; output q = m"),
    "mode's start": lambda e: model(f"mode m = {e}; output q = m"),
    "item of a list": lambda e: model(f"parameter m = (1 kg, {e})"),
    "start": lambda e: model(start=f"start v = ({e})*1 [m/s/kg]"),
    "start of a run": lambda e: model(steps=f"start b.v = ({e})*1 [m/s/kg]; simulate 0 .. 1 s"),
    "nominal": lambda e: model(start=f"nominal p = ({e})*1 [m/s]"),
    "setting": lambda e: model("parameter m = 1 kg", steps=f"set m = {e}; simulate 0 .. 1 s"),
    "end of a run": lambda e: model(steps=f"simulate 0 .. ({e})*1 [s/kg]"),
    "points": lambda e: model(steps=f"simulate 0 .. 1 s {{ points = ({e})/1 kg }}"),
    "sweep": lambda e: model("parameter m = 1 kg", steps=f"sweep m = 1 kg, {e}; simulate 0 .. 1 s"),
    "period": lambda e: model(f"every ({e})*1 [s/kg] {{ on = 2 kg }}"),
    "delay": lambda e: model(f"output q = delay(b.v, ({e})*1 [s/kg])"),
    "start of an integral": lambda e: model(f"output q = integral(b.p, ({e})*1 [m])"),
    "point of a table": lambda e: model(f"output q = linear(time, (0 s, 1 s), (0 kg, {e}))"),
    "argument": lambda e: model(f"function f(x) = 2*x; parameter m = f({e})"),
    "instance": lambda e: model(f"B part {{ m = {e} }}") + "model B { parameter m = 1 kg; output q = m }",
    "default of a part": lambda e: model("B part") + model(f"parameter m = {e}").replace("model A", "model B"),
    "mass": lambda e: model(f"multibody w : planar {{ body z {{ {BODY.replace('1 kg', e, 1)}, at = (0 m, 0 m) }} }}"),
    "limits": lambda e: model(
        f"multibody w : planar {{ slide s : ground to z {{ along = (1, 0), limits = (-10 m, ({e})*1 [m/kg]) }}\n body z {{ {BODY}, at = (0 m, 0 m) }} }}"
    ),
    "axis": lambda e: model(
        f"multibody w : planar {{ slide s : ground to z {{ along = (1, ({e})/1 kg) }}\n body z {{ {BODY}, at = (0 m, 0 m) }} }}"
    ),
    "lock": lambda e: model(
        f"multibody w : planar {{ slide s : ground to z {{ along = (1, 0), locked = ({e}) > 1 kg }}\n body z {{ {BODY}, at = (0 m, 0 m) }} }}"
    ),
    "frequency": lambda e: model("input u = 0 N; output y = u", steps=f"response u to y over 1 Hz .. ({e})*1 [1/s/kg]"),
    "place": lambda e: model(f"multibody w : planar {{ body z {{ {BODY}, at = (({e})*1 [m/kg], 0 m) }} }}"),
    "gravity": lambda e: model(
        f"multibody w : planar {{ gravity = (0, ({e})*1 [m/s^2/kg])\n body z {{ {BODY}, at = (0 m, 0 m) }} }}"
    ),
}


@pytest.mark.parametrize(("place", "changing"), [*product(PLACES, CHANGING)])
def test_it_is_refused_where_it_stands(place: str, changing: str) -> None:
    text = PLACES[place](changing)
    found = mistakes(text, "A")
    assert {d.code for d in found} == {"BG106"}, [d.text for d in found]
    assert all(d.span.text.removeprefix("(").removesuffix(")") in changing for d in found)


@pytest.mark.parametrize("place", ["I c[(%s)/1 kg] : p = 1 kg*v", "for i in 1..(%s)/1 kg { signal s[i] = 1 }"])
@pytest.mark.parametrize("changing", CHANGING)
def test_sizes_and_ranges(place: str, changing: str) -> None:
    """An element has no name yet where sizes are read: it is unknown there."""
    (found,) = mistakes(model(place % changing))
    assert found.code == ("BG101" if changing.startswith("b.") else "BG106")


@pytest.mark.parametrize("changing", CHANGING)
def test_a_function_called_from_a_parameter(changing: str) -> None:
    found = mistakes(model(f"function f(x) = x + {changing}; parameter m = f(1 kg)"))
    assert [d.code for d in found] in (["BG106"], ["BG101"], ["BG130"])


@pytest.mark.parametrize("name", ["m", "l", "l[1]"])
@pytest.mark.parametrize("changing", [e for e in CHANGING if e not in ("sig", "grown", "on", "inp")])
def test_a_setting_from_outside(name: str, changing: str) -> None:
    text = model("parameter m = 1 kg, l = (1 kg, 2 kg); output q = m + l[1]")
    with pytest.raises(CompilationFailed) as failed:
        compiled(text, {name: changing}).program  # noqa: B018
    assert {d.code for d in failed.value.diagnostics} == {"BG106"}


@pytest.mark.parametrize("changing", CHANGING)
def test_a_signal_may_change(changing: str) -> None:
    assert mistakes(model(f"signal m = {changing}; output q = m")) == ()
