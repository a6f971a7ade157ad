"""Units are checked through everything: sums, functions, laws, declared units, instances, overrides, reports."""

from __future__ import annotations

import pytest

from compiler.errors import CompilationFailed
from tests.compiling import compiled, mistake, mistakes, numbers, refused, units_of

NAMES = "parameter x = 2 m, y = 3 m, t = 5 s, v = 7 [m/s], n = 4, f = 6 N, gap: um = (1, 2, 3)"


def of(expression: str) -> tuple[float, str]:
    """Value in SI and unit of an expression over NAMES."""
    compilation = compiled(f"model A {{\n  {NAMES}\n  output result = {expression}\n}}\n")
    return numbers(compilation.source.text)["result"], units_of(compilation)["result"]


@pytest.mark.parametrize(
    ("expression", "value", "unit"),
    [
        ("x + y", 5.0, "m"),
        ("x - 1 mm", 1.999, "m"),
        ("x*y", 6.0, "m^2"),
        ("x/t", 0.4, "m/s"),
        ("x/y", 2 / 3, "1"),
        ("v*t + x", 37.0, "m"),
        ("f*x", 12.0, "N*m"),
        ("f/v", 6 / 7, "N*s/m"),
        ("x^2", 4.0, "m^2"),
        ("x^-1", 0.5, "1/m"),
        ("x^(1/2)", 2**0.5, "m^(1/2)"),
        ("x^0", 1.0, "1"),
        ("sqrt(x*y)", 6**0.5, "m"),
        ("abs(-x)", 2.0, "m"),
        ("min(x, y)", 2.0, "m"),
        ("max(x, 0)", 2.0, "m"),
        ("sign(-x)", -1.0, "1"),
        ("atan2(x, y)", 0.5880026035475675, "1"),
        ("sin(x/y)", 0.6183698030697369, "1"),
        ("exp(n)", 54.598150033144236, "1"),
        ("x if x < y else y", 2.0, "m"),
        ("0 if x < y else y", 0.0, "m"),
        ("x + 0", 2.0, "m"),
        ("0 - x", -2.0, "m"),
        ("x*0 + y*0", 0.0, "1"),
        ("x*0 + 3 s*0", 0.0, "s"),
        ("gap[2]", 2e-6, "m"),
        ("x - gap[1]", 2.0 - 1e-6, "m"),
        ("step(time - 1 s)*x", 0.0, "m"),
        ("ramp(time, -1 s, 1 s)", 0.5, "1"),
        ("smoothstep3(x, 1 m, 3 m)", 0.5, "1"),
        ("(x < y)*1 if n > 3 else 0", 1.0, "1"),
        ("2^n", 16.0, "1"),
        ("x*y^2/t", 3.6, "m^3/s"),
    ],
)
def test_units_of_expressions(expression: str, value: float, unit: str) -> None:
    found, found_unit = of(expression)
    assert found == pytest.approx(value, rel=1e-15)
    assert found_unit == unit


@pytest.mark.parametrize(
    ("expression", "culprit"),
    [
        ("x + t", "t"),
        ("x + 1", "1"),
        ("1 + x", "x"),
        ("x - y*y", "y*y"),
        ("x + y + t", "t"),
        ("(x + y) + f*t", "f*t"),
        ("n + x/t", "x/t"),
        ("sin(x)", "x"),
        ("exp(t)", "t"),
        ("min(x, t)", "t"),
        ("max(1, x)", "x"),
        ("atan2(x, t)", "t"),
        ("x if x < t else y", "t"),
        ("x if x < y else t", "t"),
        ("x if x == 3 else y", "3"),
        ("2^x", "x"),
        ("step(time - 1)", "1"),
        ("ramp(time, 0, 1 m)", "1 m"),
        ("pulse(time, 1 s, 2)", "2"),
        ("sin(t)*x", "t"),
        ("x + gap", None),
        ("gap + x", None),
        ("gap*gap", None),
        ("x/gap", None),
        ("sin(gap)", None),
        ("gap > x", None),
    ],
)
def test_what_does_not_fit(expression: str, culprit: str | None) -> None:
    """Reported at the operand that does not fit, in one message."""
    found = mistakes(f"model A {{\n  {NAMES}\n  output result = {expression}\n}}\n")
    assert [d.span.line for d in found] == [3]
    if culprit is not None:
        assert found[0].code == "BG103"
        assert found[0].span.text == culprit
    else:
        assert found[0].code == "BG111"


def test_a_power_needs_a_number_where_its_base_has_a_unit() -> None:
    assert mistake(f"model A {{\n  {NAMES}\n  output result = x^n\n}}\n", "BG111").span.text == "n"


class TestDeclaredUnits:
    """`k: N/m = 100` against `k = 100 [N/m]`: the decision "declared unit against default"."""

    @pytest.mark.parametrize(
        ("item", "value", "unit"),
        [
            ("k: N/m = 100", 100.0, "N/m"),
            ("k: kN/m = 100", 100e3, "N/m"),
            ("k: kN/m = -100", -100e3, "N/m"),
            ("k: kN/m = 1 [N/mm]", 1e3, "N/m"),
            ("k: um = 0", 0.0, "m"),
            ("k: degC = 20", 293.15, "K"),
            ("k: degC = -20", 253.15, "K"),
            ("k: degC = 300 K", 300.0, "K"),
            ("k: deg = 180", 3.141592653589793, "1"),
            ("k = 1 [kN/m]", 1e3, "N/m"),
            ("k = 2*3 [kN/m]", 6e3, "N/m"),
            ("k: um = other", 7.0, "m"),
            ("k: um = other/2", 3.5, "m"),
            ("k: um = 1 mm + 2 mm", 3e-3, "m"),
            ("k: 1/s = 3", 3.0, "1/s"),
            ("k: V/m^(1/2) = 19400", 19400.0, "kg*m^(3/2)/s^3/A"),
        ],
    )
    def test_what_it_means(self, item: str, value: float, unit: str) -> None:
        text = f"model A {{\n  parameter other = 7 m\n  parameter {item}\n  output y = k\n}}\n"
        assert numbers(text)["y"] == pytest.approx(value, rel=1e-15)
        assert units_of(compiled(text))["y"] == unit

    @pytest.mark.parametrize(
        "item",
        [
            "k: N/m = 1 kg",
            "k: N/m = other",
            "k: N/m = 2*3",
            "k: um = (1 m, 2 s)",
            "k: um = 3*other^2",
            "k: N = 1 [kN/m]",
        ],
    )
    def test_all_but_bare_numbers_must_have_that_dimension(self, item: str) -> None:
        """`2*3` is an expression, not a bare number: it has the dimension 1, which is not N/m."""
        found = mistake(f"model A {{\n  parameter other = 7 m\n  parameter {item}\n  output y = 1\n}}\n", "BG103")
        assert found.span.line == 3

    def test_one_prefixed_unit_after_the_number_divides_by_your_m(self) -> None:
        """`1 kN/m` is one kilonewton over the parameter m."""
        text = "model A {\n  parameter m = 4 kg\n  output y = 1 kN/m\n}\n"
        assert (numbers(text)["y"], units_of(compiled(text))["y"]) == (250.0, "m/s^2")

    def test_lists(self) -> None:
        text = "model A {\n  parameter d: um = (1.95, 1.75, 2), e = (1 m, 2 mm), f: GPa = (130, 2 Pa)\n  output y = d[1] + e[2], z = f[1] + f[2]\n}\n"
        assert numbers(text) == {"y": 1.95e-6 + 2e-3, "z": 130e9 + 2.0}

    @pytest.mark.parametrize("role", ["parameter", "constant", "signal", "output", "input"])
    def test_every_role_can_declare_its_unit(self, role: str) -> None:
        text = f"model A {{\n  {role} k: mN = 3\n  output y = 2*k\n}}\n"
        assert numbers(text)["y"] == 6e-3
        assert mistake(f"model A {{\n  {role} k: mN = 3 m\n  output y = 1\n}}\n", "BG103").span.text == "3 m"


class TestLaws:
    """Both sides of a law have one unit, in every domain; `e f q p` have those of their letters."""

    @pytest.mark.parametrize(
        ("kind", "law", "parameter"),
        [
            ("C", "F = k*x", "k: N/m = 1"),
            ("C", "x = k*F", "k: m/N = 1"),
            ("I", "p = k*v", "k: kg = 1"),
            ("R", "F = k*v", "k: N*s/m = 1"),
            ("C", "M = k*phi", "k: N*m = 1"),
            ("I", "L = k*omega", "k: kg*m^2 = 1"),
            ("R", "M = k*omega", "k: N*m*s = 1"),
            ("C", "q = k*u", "k: F = 1"),
            ("I", "lambda = k*i", "k: H = 1"),
            ("R", "u = k*i", "k: ohm = 1"),
            ("C", "V = k*P", "k: m^3/Pa = 1"),
            ("I", "Gamma = k*Q", "k: Pa*s^2/m^3 = 1"),
            ("R", "P = k*Q", "k: Pa*s/m^3 = 1"),
            ("C", "T = k*S", "k: K^2/J = 1"),
            ("R", "T = k*S_dot", "k: K^2/W = 1"),
            ("C", "mmf = k*Phi", "k: A/Wb = 1"),
            ("R", "mmf = k*Phi_dot", "k: A/V = 1"),
            ("C", "mu = k*n", "k: J/mol^2 = 1"),
            ("R", "mu = k*n_dot", "k: J*s/mol^2 = 1"),
            ("C", "energy = 1/2*k*x^2", "k: N/m = 1"),
            ("I", "energy = p^2/(2*k)", "k: kg = 1"),
        ],
    )
    def test_the_usual_laws(self, kind: str, law: str, parameter: str) -> None:
        domain = "" if "energy" not in law else " : translation"
        text = f"model A {{\n  parameter {parameter}\n  1 a{domain}\n  {kind} part : {law}\n  {kind} other : {law}\n  a -> part, other\n}}\n"
        assert mistakes(text) == () or {d.code for d in mistakes(text)} <= {"BG505", "BG403", "BG502"}
        name = parameter.partition(":")[0]
        wrong = text.replace(f"{name}: ", f"{name}: K^3*", 1)
        assert {d.code for d in mistakes(wrong)} == {"BG103"}

    def test_generic_letters_have_the_units_of_their_domain(self) -> None:
        text = "model A {\n  parameter k = 2 [%s]\n  1 a : electric\n  C c : e = k*q\n  R r : u = 1 ohm*i\n  a -> c, r\n  output y = c.e, z = c.q, w = c.f\n}\n"
        assert units_of(compiled(text % "1/F")) == {"y": "V", "z": "C", "w": "A"}
        assert {d.code for d in mistakes(text % "F")} == {"BG103"}

    @pytest.mark.parametrize(
        ("kind", "law"),
        [
            ("TF", "omega1 = 20*omega2"),
            ("TF", "v1 = 3 m*omega2"),
            ("TF", "P1 = F2/2 [cm^2]"),
            ("GY", "u1 = 0.05 [V*s]*omega2"),
            ("GY", "M2 = 0.05 [N*m/A]*i1"),
        ],
    )
    def test_transducers(self, kind: str, law: str) -> None:
        assert not [d for d in mistakes(f"model A {{\n  {kind} part : {law}\n}}\n") if d.code == "BG103"]
        wrong = f"model A {{\n  {kind} part : {law}*1 kg\n}}\n"
        assert "BG103" in {d.code for d in mistakes(wrong)}

    def test_a_bare_number_in_a_law_needs_its_unit(self) -> None:
        text = "model A {\n  1 a\n  I m : p = 2 kg*v\n  R r : F = %s*v\n  a -> m, r\n}\n"
        assert mistakes(text % "2 [N*s/m]") == ()
        assert mistake(text % "2", "BG103").span.line == 4

    def test_conditions_in_laws(self) -> None:
        text = "model A {\n  parameter k: N/m = 2\n  1 a\n  I m : p = 2 kg*v\n  C c : F = k*x if x > %s else 0\n  a -> m, c\n}\n"
        assert mistakes(text % "1 mm") == ()
        assert mistake(text % "1", "BG103").span.text == "1"


class TestEverythingElse:
    def test_starts_and_nominals(self) -> None:
        text = "model A {\n  1 a\n  I m : p = 2 kg*v { %s }\n  C c : F = 2 [N/m]*x { %s }\n  a -> m, c\n}\n"
        assert mistakes(text % ("start v = 1 [mm/s], nominal p = 3 [N*s]", "start F = 1 N")) == ()
        assert mistake(text % ("start v = 1 m", ""), "BG103").span.text == "1 m"
        assert mistake(text % ("", "nominal x = 3 N"), "BG103").span.text == "3 N"

    def test_instances(self) -> None:
        text = "model Part {\n  parameter k: N/m = 1\n  input u = 0 V\n  output y = k\n}\nmodel A {\n  parameter g = 2 [kN/m]\n  Part part { %s }\n  output y = part.y\n}\n"
        assert mistakes(text % "k = g, u = 3 mV") == ()
        for wrong in ("k = 2 N", "k = 3", "u = 3 A", "u = g"):
            found = mistake(text % wrong, "BG103")
            assert found.span.line == 8 and found.span.text == wrong.split("= ")[1]

    def test_settings_from_outside(self) -> None:
        text = "model A {\n  parameter k: N/m = 1, n = 2, gap: um = (1, 2)\n  input u = 0 V\n  output y = k, z = u, w = gap[2]\n}\n"
        for name, value in {"k": "2 [kN/m]", "u": "3 mV*sin(time/1 s)", "n": "5", "gap[2]": "3 mm"}.items():
            assert compiled(text, {name: value}).program
        for name, value in {"k": "2 N", "u": "3 A", "n": "5 m", "gap[2]": "3 s"}.items():
            assert refused(compiled(text, {name: value}), "BG103").span.source.name == "setting"

    def test_reports(self) -> None:
        text = "model A {\n  parameter a = 2 m\n  output y = a\n  experiment e {\n    simulate 0 .. 1 s\n    report y in %s\n  }\n}\n"
        plan = compiled(text % "mm", experiment="e").plan
        assert [(r.name, r.unit, r.scale, r.offset) for r in plan.report] == [("y", "mm", 1000.0, 0.0)]
        for wrong in ("s", "mm^2", "N/m"):
            with pytest.raises(CompilationFailed) as failed:
                _ = compiled(text % wrong, experiment="e").plan
            assert [d.code for d in failed.value.diagnostics] == ["BG103"]

    def test_time_is_in_seconds(self) -> None:
        text = "model A {\n  output y = %s\n}\n"
        assert units_of(compiled(text % "time")) == {"y": "s"}
        assert mistake(text % "sin(time)", "BG103").span.text == "time"
        assert mistakes(text % "sin(2*pi*50 Hz*time)") == ()

    def test_mechanisms(self) -> None:
        text = "model A {\n  multibody m : planar {\n    gravity = (0, %s)\n    body b { mass = %s, inertia = %s, at = (%s, 0), angle = %s }\n  }\n  output y = m.b.x\n}\n"
        right = ["-9.81 [m/s^2]", "1 kg", "1 [kg*m^2]", "1 m", "30 deg"]
        assert mistakes(text % tuple(right)) == ()
        for number in range(len(right)):
            wrong = [*right[:number], "1 [A]", *right[number + 1 :]]
            assert {d.code for d in mistakes(text % tuple(wrong))} == {"BG103"}

    def test_plain_models_have_none(self) -> None:
        text = "plain model A {\n  parameter a = 2\n  C c : e = a*q\n  R r : e = f + a\n  1 j\n  j -> c, r\n  output y = c.q + a + time\n}\n"
        assert units_of(compiled(text)) == {"y": "1"}
        assert mistake(text.replace("a = 2", "a = 2 m"), "BG111").span.text == "m"
        assert mistake(text.replace("a = 2", "a: m = 2"), "BG111").span.line == 2
