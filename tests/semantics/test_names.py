"""Names: those that an expression may read, scopes, duplicates, functions, constants of a file."""

from __future__ import annotations

import pytest

from tests.compiling import Running, compiled, mistake, mistakes, numbers, units_of

OSCILLATOR = """
model A {
  parameter m = 2 kg, k: N/m = 8, r: N*s/m = 0.5
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x
  R  damper : F = r*v
  body -> mass, spring, damper
%s
}
"""
STATE = {"mass.p": 3.0, "spring.x": 0.25}


def read(expression: str) -> float:
    return Running(compiled(OSCILLATOR % f"  output y = {expression}")).outputs(STATE)["y"]


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("spring.x", 0.25), ("spring.q", 0.25), ("spring.F", 2.0), ("spring.e", 2.0), ("spring.v", 1.5), ("spring.f", 1.5),
        ("mass.p", 3.0), ("mass.v", 1.5), ("mass.f", 1.5), ("mass.F", -2.75), ("mass.e", -2.75),
        ("damper.F", 0.75), ("damper.v", 1.5), ("body.v", 1.5), ("body.f", 1.5),
        ("spring.x.F", 2.0), ("spring.x.v", 1.5), ("mass.p.v", 1.5),
        ("spring.F*spring.v", 3.0), ("m*mass.v^2/2", 2.25), ("spring.x + 1 mm", 0.251),
    ],
)  # fmt: skip
def test_variables_of_elements(expression: str, value: float) -> None:
    """Letters of the domain and `e f q p`; behind a displacement the port's other variables."""
    assert read(expression) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "expression",
    [
        "spring.p",
        "mass.x",
        "mass.q",
        "damper.x",
        "body.F",
        "body.x",
        "spring.u",
        "spring.lambda",
        "spring.omega",
        "spring.",
        "mass",
    ],
)
def test_variables_that_an_element_lacks(expression: str) -> None:
    found = mistakes(OSCILLATOR % f"  output y = {expression}")
    assert len(found) == 1 and found[0].help


def test_sides_of_transducers() -> None:
    text = "model A {\n  Se s : u = 6 V\n  1 a, b\n  GY motor : u1 = 2 [V*s]*omega2\n  I j : p = 3 [kg*m^2]*omega\n  TF gear : omega1 = 5*omega2\n  1 c\n  R r : M = 7 [N*m*s]*omega\n  s -> a -> motor -> b -> j, gear\n  gear -> c -> r\n  R w : u = 1 ohm*i\n  a -> w\n%s}\n"
    reads = "  output u1 = motor.u1, i1 = motor.i1, M2 = motor.M2, w2 = motor.omega2, o1 = gear.omega1, o2 = gear.omega2, M1 = gear.M1, e2 = gear.e2, f2 = gear.f2\n"
    found = Running(compiled(text % reads)).outputs({"j.L": 6.0})
    i1 = 6.0 - 2 * 2.0
    assert found == pytest.approx(
        {"u1": 4.0, "i1": i1, "M2": 2 * i1, "w2": 2.0, "o1": 2.0, "o2": 0.4, "M1": 7 * 0.4 / 5, "e2": 2.8, "f2": 0.4},
        rel=1e-14,
    )
    assert units_of(compiled(text % reads))["M2"] == "N*m"
    for wrong in ("motor.u", "motor.u3", "motor.M1", "gear.phi1"):
        mistake(text % f"  output y = {wrong}\n", "BG101")


def test_ports_of_fields() -> None:
    text = "model A {\n  C plates(q: electric, x: translation) : energy = 1/2*q^2*(3 m - x)/2 [F*m]\n  1 wire, plate\n  R lead : u = 2 ohm*i\n  I mass : p = 4 kg*v\n  wire -> lead, plates.q\n  plate -> mass, plates.x\n%s}\n"
    reads = "  output q = plates.q, u = plates.q.u, i = plates.q.i, x = plates.x, F = plates.x.F, v = plates.x.v, e = plates.x.e\n"
    found = Running(compiled(text % reads)).outputs({"plates.q": 5.0, "plates.x": 1.0, "mass.p": 8.0})
    u = 5.0 * (3 - 1) / 2
    assert found == pytest.approx(
        {"q": 5.0, "u": u, "i": -u / 2, "x": 1.0, "F": -(25 / 2) / 2, "v": 2.0, "e": -6.25}, rel=1e-14
    )
    for wrong in ("plates.y", "plates.q.x", "plates.x.u", "plates.F", "plates"):
        assert len(mistakes(text % f"  output y = {wrong}\n")) == 1


def test_names_of_states() -> None:
    """Path and letter, for every way of reading it."""
    assert compiled(OSCILLATOR % "  output y = spring.q").program.states.names == ("mass.p", "spring.x")
    electric = "model A {\n  1 a\n  C c : u = q/1 F\n  I l : lambda = 2 H*i\n  a -> c, l\n  output y = c.q\n}\n"
    assert compiled(electric).program.states.names == ("c.q", "l.lambda")
    rotation = (
        "model A {\n  1 a\n  C c : M = 2 [N*m]*phi\n  I j : p = 2 [kg*m^2]*omega\n  a -> c, j\n  output y = c.e\n}\n"
    )
    assert compiled(rotation).program.states.names == ("c.phi", "j.L")


def test_order_in_the_text_does_not_matter() -> None:
    text = "model A {\n  output y = s + c\n  signal s = 2*b\n  constant c = b + a\n  parameter b = a^2\n  parameter a = 3\n}\n"
    assert numbers(text) == {"y": 2 * 9 + 12}


def test_elements_before_their_parameters() -> None:
    text = "model A {\n  body -> mass, spring\n  output y = spring.x\n  C spring : F = k*x\n  I mass : p = m*v\n  parameter k: N/m = 8\n  1 body\n  parameter m = 2 kg\n}\n"
    assert Running(compiled(text)).rates({"spring.x": 0.5, "mass.p": 4.0}) == {"spring.x": 2.0, "mass.p": -4.0}


class TestDuplicates:
    @pytest.mark.parametrize(
        "body",
        [
            "parameter a = 1\n  parameter a = 2", "parameter a = 1, a = 2", "parameter a = 1\n  signal a = 2", "signal a = 2\n  output a = 1",
            "parameter a = 1\n  1 a : translation", "1 a : translation\n  parameter a = 1", "1 a : translation\n  I a : p = 1 kg*v",
            "signal a[1] = 1\n  signal a[1] = 2", "signal a[1] = 1\n  signal a = 2", "parameter a = (1, 2)\n  signal a[1] = 2",
        ],
    )  # fmt: skip
    def test_the_later_place_is_told_and_the_first_is_shown(self, body: str) -> None:
        found = [d for d in mistakes(f"model A {{\n  {body}\n}}\n") if d.code == "BG104"]
        assert len(found) == 1
        ((first, _),) = found[0].related()
        assert (first.line, first.column) < (found[0].span.line, found[0].span.column)

    def test_nothing_follows_from_it(self) -> None:
        """Both uses of the name are understood as its first declaration."""
        text = OSCILLATOR % "  parameter body = 3\n  output y = spring.x"
        assert [d.code for d in mistakes(text)] == ["BG104"]

    def test_models_functions_constants_of_a_file(self) -> None:
        for pair in ("model B { }\nmodel B { }", "constant B = 1\nmodel B { }", "function B(x) = x\nconstant B = 2"):
            assert "BG104" in {d.code for d in mistakes(pair + "\nmodel A { output y = 1 }\n")}

    def test_experiments(self) -> None:
        text = (
            "model A {\n  output y = 1\n  experiment e { simulate 0 .. 1 s }\n  experiment e { simulate 0 .. 2 s }\n}\n"
        )
        assert mistake(text, "BG104").span.line == 4


class TestReserved:
    @pytest.mark.parametrize(
        "word", ["time", "pi", "ground", "true", "false", "if", "else", "and", "or", "not", "in", "to", "over"]
    )
    def test_words_of_expressions(self, word: str) -> None:
        assert {d.code for d in mistakes(f"model A {{\n  parameter {word} = 3\n}}\n")} <= {"BG134", "BG001", "BG505"}
        assert mistakes(f"model A {{\n  parameter {word} = 3\n}}\n")

    @pytest.mark.parametrize(
        "name",
        [
            "C",
            "I",
            "R",
            "m",
            "N",
            "s",
            "Se",
            "TF",
            "e",
            "f",
            "q",
            "p",
            "body",
            "hinge",
            "slide",
            "to_",
            "Model",
            "sin",
            "step",
        ],
    )
    def test_what_is_free_for_parameters(self, name: str) -> None:
        assert numbers(f"model A {{\n  parameter {name} = 3\n  output result = 2*{name}\n}}\n") == {"result": 6.0}

    def test_item_by_item(self) -> None:
        """One wrong name hides neither the next mistake nor a right name."""
        found = mistakes("model A {\n  parameter time = 3, pi = 4, a = 2\n  output y = a\n}\n")
        assert [(d.code, d.span.column) for d in found] == [("BG134", 13), ("BG134", 23)]


class TestUnknown:
    def test_what_is_close_is_suggested(self) -> None:
        assert (
            "`stiffness`" in mistake("model A {\n  parameter stiffness = 1\n  output y = stifness\n}\n", "BG101").help
        )
        assert "`spring`" in mistake(OSCILLATOR % "  body -> sprin", "BG101").help

    def test_each_is_told_where_it_is_read(self) -> None:
        found = mistakes("model A {\n  parameter b = here\n  output y = there + 1\n  output z = elsewhere\n}\n")
        assert [(d.code, d.span.text) for d in found] == [("BG101", "here"), ("BG101", "there"), ("BG101", "elsewhere")]

    def test_a_mistake_in_one_statement_hides_no_other(self) -> None:
        text = OSCILLATOR % "  R loose : F = c*v\n  C extra : F = k*y\n  output y1 = spring.w\n  output y2 = b + 1\n"
        lines = [d.span.line for d in mistakes(text)]
        assert sorted(set(lines)) == [9, 10, 11, 12]


class TestFunctions:
    def test_they_name_an_expression(self) -> None:
        text = "function square(x) = x^2\nfunction mean(a, b) = (a + b)/2\nfunction both(a, b) = square(mean(a, b)) + c\nconstant c = 100\nmodel A {\n  output y = square(3), z = mean(1 m, 3 m), w = both(2, 4)\n}\n"
        assert numbers(text) == {"y": 9.0, "z": 2.0, "w": 109.0}
        assert units_of(compiled(text))["z"] == "m"

    def test_arguments_are_values_not_text(self) -> None:
        """No capture: the function's x is not the model's, `square(a + 1)` squares the sum."""
        text = "function square(x) = x*x\nmodel A {\n  parameter x = 5, a = 2\n  output y = square(a + 1) + x\n}\n"
        assert numbers(text) == {"y": 14.0}

    def test_they_see_the_file_not_the_model(self) -> None:
        text = "function shifted(x) = x + offset\nconstant offset = 3\nmodel A {\n  output y = shifted(1)\n}\n"
        assert numbers(text) == {"y": 4.0}
        inner = mistakes(
            "function shifted(x) = x + offset\nmodel A {\n  parameter offset = 3\n  output y = shifted(1)\n}\n"
        )
        assert [d.code for d in inner] == ["BG101"], (
            "a function that reads the names of whoever calls it would capture them by accident"
        )

    def test_units_pass_through(self) -> None:
        text = "function energy(k, x) = k*x^2/2\nmodel A {\n  output y = energy(2 [N/m], 3 m)\n  output z = energy(2 [N/m], 3 m) + 1 N\n}\n"
        assert mistake(text, "BG103").span.line == 4

    def test_lists_as_arguments(self) -> None:
        text = "function first(list) = list[1]\nfunction twice(list) = list + list\nmodel A {\n  parameter gap = (1, 2)\n  output y = first(gap), z = first(twice(gap))\n}\n"
        assert numbers(text) == {"y": 1.0, "z": 2.0}

    @pytest.mark.parametrize("text", ["f(1, 2)", "f()", "atan2(1)", "sin(1, 2)", "step()", "ramp(time, 1 s)"])
    def test_number_of_arguments(self, text: str) -> None:
        found = mistake(f"function f(x) = x\nmodel A {{\n  output y = {text}\n}}\n", "BG108")
        assert "`" in found.help

    def test_no_recursion(self) -> None:
        assert (
            "f -> g -> f"
            in mistake(
                "function f(x) = g(x)\nfunction g(x) = f(x)\nmodel A {\n  output y = f(1)\n}\n", "BG107"
            ).sentence
        )

    def test_no_explosion(self) -> None:
        """Twenty functions that each call the one before twice would be a million calls."""
        lines = ["function f0(x) = x"] + [f"function f{i}(x) = f{i - 1}(x) + f{i - 1}(x)" for i in range(1, 25)]
        text = "\n".join(lines) + "\nmodel A {\n  output y = f24(1)\n}\n"
        assert mistake(text, "BG160").span.line > 0

    def test_unknown(self) -> None:
        assert "`sin`" in mistake("model A {\n  output y = sinus(1)\n}\n", "BG109").help


class TestFileConstants:
    def test_every_model_of_the_file_reads_them(self) -> None:
        text = "constant g = 9.81 [m/s^2], half = g/2\nmodel B { parameter m = 2 kg; output w = m*g }\nmodel A {\n  B b\n  output y = b.w, z = half\n}\n"
        assert numbers(text) == {"y": 2 * 9.81, "z": 9.81 / 2}

    def test_a_model_s_own_name_comes_first(self) -> None:
        text = "constant g = 9.81\nmodel A {\n  parameter g = 1\n  output y = g\n}\n"
        assert numbers(text) == {"y": 1.0}

    def test_circles(self) -> None:
        assert "BG107" in {d.code for d in mistakes("constant a = b, b = a\nmodel A {\n  output y = a\n}\n")}

    def test_they_cannot_read_a_model(self) -> None:
        assert mistake("constant a = 2*k\nmodel A {\n  parameter k = 3\n  output y = a\n}\n", "BG101").span.text == "k"


class TestCircles:
    @pytest.mark.parametrize(
        ("body", "names"),
        [
            ("parameter a = b, b = a", {"a", "b"}),
            ("parameter a = a + 1", {"a"}),
            ("constant a = b\n  parameter b = c\n  constant c = 2*a", {"a", "b", "c"}),
            ("signal s = (t[1], 1)\n  signal t = (2*s[1], 2)", {"s", "t"}),
        ],
    )
    def test_circles_are_told_with_their_names(self, body: str, names: set[str]) -> None:
        found = mistake(f"model A {{\n  {body}\n}}\n", "BG107")
        assert set(found.sentence.split(": ")[1].split(" -> ")) == names

    def test_through_a_storage_is_no_circle(self) -> None:
        text = (
            OSCILLATOR.replace("R  damper : F = r*v", "MSe damper : F = -s").replace(
                "body -> mass, spring, damper", "body -> mass, spring\n  damper -> body"
            )
            % "  signal s = r*spring.v\n  output y = s"
        )
        assert Running(compiled(text)).rates(STATE) == pytest.approx({"mass.p": -2.75, "spring.x": 1.5})


def test_index_names_and_plain_numbers() -> None:
    text = "model A {\n  for i in 1..2 {\n    signal s[i] = 10*i\n    for j in 1..2 { signal t[i, j] = s[i] + j }\n  }\n  output y = t[2, 1], z = s[1]\n}\n"
    assert numbers(text) == {"y": 21.0, "z": 10.0}
    assert mistake(text.replace("z = s[1]", "z = i"), "BG101").span.text == "i"


def test_true_false_and_pi() -> None:
    text = "model A {\n  output y = 1 if true else 2, z = 1 if false else 2, w = 2*pi, v = 1 if not true or false else 3\n}\n"
    assert numbers(text) == {"y": 1.0, "z": 2.0, "w": 6.283185307179586, "v": 3.0}


def test_a_condition_read_as_a_number_is_one_or_zero() -> None:
    text = (
        OSCILLATOR % "  output a = spring.x < 0 m, b = spring.x > 0 m\n  signal c = spring.x > 0.1 m\n  output d = 5*c"
    )
    assert Running(compiled(text)).outputs(STATE) == {"a": 0.0, "b": 1.0, "d": 5.0}


def test_a_named_condition_is_a_condition() -> None:
    """`signal on = time > 1 s` may be used as a condition, and as a number is 1 or 0."""
    text = "model A {\n  signal on = time > 1 s\n  output y = 5 if on else 6, z = 7 if not on and time < 5 s else 8, w = 2*on\n}\n"
    running = Running(compiled(text))
    assert running.outputs(time=0.5) == {"y": 6.0, "z": 7.0, "w": 0.0}
    assert running.outputs(time=2.0) == {"y": 5.0, "z": 8.0, "w": 2.0}


def test_what_an_experiment_sets_by_a_long_name() -> None:
    text = "model S { parameter k = 1; output y = k }\nmodel A {\n  for i in 1..2 { S s[i] }\n  parameter gap = (1, 2)\n  output y = s[2].y, z = gap[1], w = s[1].y\n  experiment e {\n    set s[ 2 ].k = 5\n    set gap[ 1 ] = 7\n    simulate 0 .. 1 s\n  }\n}\n"
    assert Running(compiled(text, experiment="e")).outputs() == {"y": 5.0, "z": 7.0, "w": 1.0}
