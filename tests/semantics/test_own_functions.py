"""Functions inside models: they read what they are given, and the parameters and constants of their model."""

from __future__ import annotations

import pytest

from tests.compiling import compiled, mistake, mistakes, numbers, outputs_of


def test_parameters_constants_and_items_of_lists() -> None:
    text = "constant two = 2\nmodel A {\n  parameter k: N/m = 3, gap: m = (1, 4)\n  constant offset = 10 N\n  function force(x) = k*(x - gap[2]) + offset*two\n  output F = force(6 m), G = force(gap[1])\n}\n"
    assert numbers(text) == {"F": 26.0, "G": 11.0}


def test_each_instance_has_its_own() -> None:
    text = "model Part { parameter k = 3; function f(x) = k*x; signal y = f(2) }\nmodel A {\n  Part p\n  Part q { k = 5 }\n  output a = p.y, b = q.y\n}\n"
    assert numbers(text) == {"a": 6.0, "b": 10.0}
    assert outputs_of(compiled(text, {"p.k": "4"})) == {"a": 8.0, "b": 10.0}


def test_one_calls_another_and_those_of_the_file() -> None:
    text = "function twice(x) = 2*x\nmodel A {\n  parameter k = 3\n  function f(x) = twice(g(x)) + 1\n  function g(x) = k*x\n  output y = f(5)\n}\n"
    assert numbers(text) == {"y": 31.0}


def test_in_laws_loops_and_mechanisms() -> None:
    """In a loop a name of the round does not come between: `k` is the model's. In a law `v` is the law's, `x` is given."""
    text = (
        "model A {\n  parameter k: N/m = 3, l = 2 m\n  function pull(x) = k*x\n  function place(i) = l*i\n"
        "  for i in 1..2 {\n    constant k = 100\n    C spring[i] : F = pull(x) + pull(place(i - 1))\n    I mass[i] : p = 1 kg*v\n    1 hub[i]\n    hub[i] -> spring[i], mass[i]\n    output own[i] = k*i\n  }\n"
        "  multibody m : planar { for i in 1..2 { body a[i] { mass = 1 kg, inertia = 1 [kg*m^2], at = (place(i), 0) } } }\n"
        "  output F1 = spring[1].F, F2 = spring[2].F, x = m.a[2].x\n}\n"
    )
    assert mistakes(text) == ()
    found = outputs_of(compiled(text, outputs=("F1", "F2", "x")), {"spring[1].x": 0.5, "spring[2].x": 0.5})
    assert found == {"F1": 1.5, "F2": 7.5, "x": 4.0}


def test_a_law_s_own_letters_are_not_read_by_a_function() -> None:
    found = mistake("function f(a) = a*x\nmodel A {\n  C spring : F = f(2 [N/m])\n  Sf s : v = 1 [m/s]\n  s -> spring\n  output x = spring.x\n}\n", "BG101")  # fmt: skip
    assert found.span.line == 1


@pytest.mark.parametrize(
    ("function", "code"),
    [
        ("function f(x) = u*x", "BG101"), ("function f(x) = place*x", "BG101"), ("function f(x) = spring.x*x", "BG101"), ("function f(x) = f(x)", "BG107"), ("function f(x) = g(x)\n  function g(x) = f(x)", "BG107"),
        ("function f(x) = k + x", "BG103"), ("function f(x, y) = x*y", "BG108"), ("function f(x) = x\n  function f(y) = 2*y", "BG104"), ("function of_file(x) = x", "BG104"), ("function k(x) = x", "BG104"),
        ("function spring(x) = x", "BG104"), ("function time(x) = x", "BG134"), ("function f(x) = x*integral(1, 0)", "BG130"), ("function f(x) = other(x)", "BG109"),
    ],
)  # fmt: skip
def test_wrong_ones(function: str, code: str) -> None:
    used = "" if code in ("BG104", "BG134", "BG130") and "integral" not in function else "  output y = f(1)\n"
    text = f"function of_file(x) = x\nmodel Other {{ function other(x) = x }}\nmodel A {{\n  parameter k: N/m = 3\n  input u = 1\n  {function}\n  signal place = 2*spring.x\n  C spring : F = k*x\n  Sf s : v = 1 [m/s]\n  s -> spring\n  output x = spring.x\n{used}}}\n"
    found = mistakes(text, "A")
    assert {d.code for d in found} == {code}, [f"{d.code} {d.sentence}" for d in found]


def test_a_function_of_the_file_sees_nothing_of_the_model() -> None:
    found = mistake(
        "function f(x) = k*x + g(x)\nmodel A {\n  parameter k = 3\n  function g(x) = k*x\n  output y = f(1)\n}\n",
        "BG101",
    )
    assert found.span.line == 1


def test_in_branches_of_an_if() -> None:
    """Each instance has the function of its own branch, in laws, signals and rounds, and those of one name do not mix."""
    text = (
        "model Part {\n  parameter stiff = true, k = 2\n  input x = 0\n  if stiff {\n    function f(z) = k*z^2\n  } else {\n    function f(z) = g(z) + 1\n"
        "    function g(z) = 3*z\n  }\n  signal s = f(x)\n  MR r : u = f(i/1 A)*(1 V) + x*0 V\n  Sf c : i = 5 A\n  c -> r\n"
        "  for j in 1..2 {\n    if j == 1 { function h(z) = z } else { function h(z) = 10*z }\n    signal t[j] = h(f(x))\n  }\n"
        "  output y = s, u = r.u, a = t[1], b = t[2]\n}\n"
        "model M {\n  Part p { x = 4 }\n  Part q { stiff = false, x = 4 }\n  Part w { stiff = true, k = 1, x = 4 }\n"
        "  output y = p.y, z = q.y, w1 = w.y, u = p.u, v = q.u, a = p.a, b = q.b, c = w.b\n}\n"
    )
    for given in (
        text,
        text.replace(
            "Part p { x = 4 }\n  Part q { stiff = false, x = 4 }", "Part q { stiff = false, x = 4 }\n  Part p { x = 4 }"
        ),
    ):
        assert numbers(given) == {"y": 32, "z": 13, "w1": 16, "u": 50, "v": 16, "a": 32, "b": 130, "c": 160}


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("parameter on = false\n  if on { function f(x) = x }\n  output y = f(1)", "BG109"),
        ("if true { function f(x) = x; function f(x) = 2*x }", "BG104"),
        ("function f(x) = x\n  if true { function f(x) = 2*x }", "BG104"),
    ],
)
def test_refused_in_branches(body: str, code: str) -> None:
    assert code in {d.code for d in mistakes(f"model M {{\n  {body}\n}}\n")}


@pytest.mark.parametrize("first", ["Part p; Part q { own = true }", "Part q { own = true }; Part p"])
def test_a_branch_may_have_a_function_of_the_language_for_itself(first: str) -> None:
    text = f"model Part {{\n  parameter own = false\n  if own {{ function cosh(x) = 7*x }}\n  output y = cosh(0) + 1\n}}\nmodel M {{\n  {first}\n  output a = p.y, b = q.y\n}}\n"
    assert numbers(text) == {"a": 2.0, "b": 1.0}
