"""From a flat graph to text and back: the same graph, with the same laws and the same motion."""

from __future__ import annotations

import re

import numpy as np
import pytest

import bondgraph
from compiler.unparse import write_text
from tests.compiling import MODELS
from tests.unparse.same_graph import Same, same_motion


def there_and_back(text: str, tries: int = 20) -> str:
    """The flat text of a text, once it has been seen to mean the same."""
    original = bondgraph.load(text).compilation(everything=True)
    flat = write_text(original.whole_graph)
    reread = bondgraph.load(flat).compilation(everything=True)
    Same(original.whole_graph, reread.whole_graph).check()
    same_motion(original, reread, tries)
    assert without_comments(write_text(reread.whole_graph)) == without_comments(flat), "writing it again changes it"
    return flat


def without_comments(text: str) -> str:
    return re.sub(r" *#.*", "", text)


def test_names_with_dots_and_brackets() -> None:
    """Valid names stay, others follow in a comment; no two become one."""
    flat = there_and_back("""
      model Part { parameter k: N/m = 3; port a: translation; C c : F = k*x; a -> c }
      model M {
        parameter k: N/m = 1, p_c: N/m = 5
        Part p { k = k };  Part q[1] { k = 2*k };  Part q_1 { k = p_c }
        1 body : translation
        I p_1 : p = 1 kg*v
        body -> p.a, q[1].a, q_1.a, p_1
        output y = p.c.x, z = q[1].c.x + q_1.c.x, p_k = q_1.k
      }
    """)
    assert "  parameter k: N/m = 1\n" in flat
    assert "  C p_c_2 : F = p_k_2*x  # p.c\n" in flat
    assert "  C q_1_c : F = q_1_k_2*x  # q[1].c\n" in flat
    assert "  C q_1_c_2 : F = q_1_k*x  # q_1.c\n" in flat


def test_arrays_stay_unless_their_word_is_a_letter() -> None:
    flat = there_and_back("""
      model Part { parameter n = 2, x = 3; output y[1] = n*x }
      model M {
        parameter k = (1 [N/m], 2 [N/m]), x[1] = 3 [N/m], a_1 = 5, b = 2
        Part part { n = a_1*b }
        for i in 1..2 {
          1 body[i] : translation
          C spring[i] : F = (k[i] + x[1])*x
          I mass[i, 1] : p = 1 kg*v
          body[i] -> spring[i], mass[i, 1]
          output stretch[i] = spring[i].x + mass[i, 1].v*1 s
        }
        output b_2 = part.y[1]
      }
    """)
    assert "  parameter k[1]: N/m = 1\n" in flat
    assert "  parameter x_1: N/m = 3  # x[1]\n" in flat
    assert "  C spring[2] : F = (k[2] + x_1)*x\n" in flat
    assert "  I mass_2_1 : p = 1 kg*v  # mass[2, 1]\n" in flat
    assert "  body[2] -> spring[2], mass_2_1\n" in flat
    assert "  output stretch[2]: m = spring[2].x + 1 s*mass_2_1.v\n" in flat


def test_letters_that_quantities_have() -> None:
    """A law names its own variables by `e f q p` if their letters are taken; a quantity is renamed if these are taken too."""
    flat = there_and_back(
        """
      model Part {
        parameter k: N/m = 3, n = 2
        port a: translation
        C c : F = k*n*x
        R r : F = 1 [N*s/m]*v*n
        a -> 1(c, r)
      }
      model M {
        parameter x = 4, F = 2, p = 3, q = 5
        input v = 0
        Part one { n = x*F }
        1 body : translation
        I mass : 1/(2 kg)*body_p*e*1 s = f*1 [N/kg*s]
        parameter body_p = 1
        body -> one.a
        output y = x*F*p*v*q, z = one.c.x
      }
    """.replace("        I mass : 1/(2 kg)*body_p*e*1 s = f*1 [N/kg*s]\n", "")
    )
    assert "  C one_c : e = one_k*one_n*q  # one.c\n" in flat
    assert "  R one_r : e = 1 [N*s/m]*f*one_n  # one.r\n" in flat
    assert "  parameter p = 3\n" in flat
    assert "  parameter q_2 = 5  # q\n" in flat
    flat = there_and_back("""
      model Part { port a: translation; parameter n = 2; I i : p = 3 kg*v*n; a -> i }
      model M { parameter p = 2, v = 3, f = 4; Part one { n = p*v*f }; Se s : F = 1 N; s -> 1(one.a); output y = one.i.p }
    """)
    assert "  parameter p_2 = 2  # p\n" in flat and "  parameter f_2 = 4  # f\n" in flat
    assert "  I one_i : p = 3 kg*f*one_n  # one.i\n" in flat


def test_outputs_keep_their_names() -> None:
    """No law reads one: they may have the letters of laws, also of transducers and of elements that only their letters give a domain."""
    flat = there_and_back("""
      model M {
        C c : F = 2 [N/m]*x { start x = 1 m }
        I m : p = 3 kg*f
        R r : e = 5 [N*s/m]*f
        TF lever : f2 = 2*f1
        C field(a: translation, b: translation) : a.F = 2 [N/m]*a.x, b.F = 3 [N/m]*b.x
        Se push : e = 2 N
        R slow : F = 7 [N*s/m]*v
        1(r, m, field.a) -> c
        1(c2) -> lever -> field.b
        C c2 : F = 1 [N/m]*x
        push -> slow
        output q = c.x, f = m.v, p = m.p, e = r.F + q*1 [N/m], x = field.a.x, a = f, e1 = lever.F1, f2 = lever.v2, v = slow.v
      }
    """)
    assert re.findall(r"^  output (\w+)", flat, re.MULTILINE) == ["q", "f", "p", "e", "x", "a", "e1", "f2", "v"]


def test_flat_names_that_become_letters() -> None:
    """`S.dot` would be the flow of a thermal law, `a.b` the port of a field."""
    flat = there_and_back("""
      model Part { parameter dot = 2, b = 3; output y = dot }
      model M {
        Part S { dot = 3 };  Part a { b = 2 };  Part c { b = 7 }
        Se hot : T = 300 K
        R wall : T = 5 [K^2/W]*S_dot*S.dot*c.b
        hot -> wall
        C field(a_b: translation, c_b: translation) : energy = 1 [N/m]*a_b^2*a.b*c.b + 1 [N/m]*c_b^2
        1 left, right
        left -> field.a_b
        right -> field.c_b
        I one, two : p = 1 kg*v
        left -> one
        right -> two
        output y = wall.S_dot
      }
    """)
    assert "T = 5 [s^3*K^2/kg/m^2]*S_dot*S_dot_2*c_b_2\n" in flat
    assert "energy = 1 [N/m]*(a_b^2*a_b_2*c_b_2 + c_b^2)\n" in flat


def test_domains_that_only_a_law_tells() -> None:
    """Two elements bond without a junction: the letters of one law must not be taken by a quantity."""
    flat = there_and_back("""
      model Part { parameter n = 2; port a: electric; C c : u = 2 [V/C]*q*n; a -> c }
      model Source { port a: electric; Se s : u = 5 V; s -> a }
      model M {
        parameter u = 3, i = 4
        Part one { n = u*i };  Source two
        two.a -> one.a
        output y = one.c.u
      }
    """)
    assert "  parameter u_2 = 3  # u\n" in flat
    assert "  Se two_s : u = 5 V  # two.s\n" in flat


def test_domains_whose_letters_mean_another() -> None:
    there_and_back("""
      model Room {
        0 room : pseudothermal
        Sf heater : f = 1 kW
        Se outside : e = 5 degC
        C air : e = 15 degC + q/50 [kJ/K]  { start q = 100 kJ }
        R wall : f = e*40 [W/K]
        0 pipe : acoustic
        C gas : q = 1e-9 [m^3/Pa]*e
        R valve : e = 1e6 [Pa*s/m^3]*f
        heater -> room -> air
        outside -> 1(wall) -> room
        pipe -> gas, valve
        output T = air.T, P = gas.P
      }
    """)


def test_fields_heat_and_mixed_storage() -> None:
    flat = there_and_back("""
      model M {
        parameter b: N*m*s = 0.1, T_0: K = 290
        IC rail(a: translation, b: translation) : energy = 3 [N/m]*a.q^2 + b.p^2/(2*4 kg) + 0.1 [1/s]*a.q*b.p { start b.p = 2 [N*s] }
        R pair(x: translation, y: translation) : x.F = 2 [N*s/m]*x.v - 1 [N*s/m]*y.v, y.F = 2 [N*s/m]*y.v + 1 [N*s/m]*x.v
        RS pad(shaft: rotation, heat: thermal) : shaft.M = b*shaft.omega
        C store : T = T_0 + S/(2 [J/K^2])
        I wheel : L = 0.2 [kg*m^2]*omega { start omega = 5 [1/s] }
        1 left, right : translation
        1 axle
        C cap(q: electric, x: translation) : energy = 1/2*q^2*(2 um - x)/(8.85e-12 [F/m]*1 [mm^2]) + 1 [N/m]*x^2
        Se source : u = 0.1 V
        R lead : u = 1 kohm*i
        left -> rail.a, pair.x, cap.x
        right -> rail.b, pair.y
        axle -> wheel, pad.shaft
        pad.heat -> store
        source -> 1(lead) -> cap.q
        output T = store.T, x = rail.a.q, E = cap.q.u*cap.q.i
      }
    """)
    assert "RS pad(shaft: rotation, heat: thermal) : shaft.M = b*shaft.omega\n" in flat


def test_modulation_and_readings() -> None:
    there_and_back("""
      model M {
        parameter r: N*s/m = 2, n = 3
        input u = 1 N
        signal ratio = n*(1 + 0.1*sin(time/1 s)) + spring.x/1 m
        MSe push : F = u + 0*time*1 [N/s]
        1 a, b
        C spring : F = 5 [N/m]*x { start F = 2 N, nominal x = 1 mm, prefer = integral }
        I mass : p = 2 kg*v
        MTF lever : v1 = ratio*v2
        MR damper : F = r*(1 + spring.x^2/1 [m^2] + lever.v1/1 [m/s])*v
        R rest : F = r*v { require = effort }
        MSe other : F = time*1 [N/s]*lever.F2/1 N
        push -> a -> spring, damper, lever
        lever -> b -> mass, rest
        other -> b
        output y = lever.F1*lever.v1, z = a.v, w = damper.F
      }
    """)


def test_zero_times_what_changes_is_no_modulation() -> None:
    """`0*u` reads `u` in the text, but nothing is left of it in the graph: the letter M goes."""
    original = bondgraph.load(
        "model M { input u = 1 N; MSe s : F = 2 N + 0*u; 1 j; I m : p = 1 kg*v; s -> j -> m; output v = m.v }"
    )
    flat = write_text(original.compilation().whole_graph)
    assert "  Se s : F = 2 N\n" in flat
    assert bondgraph.load(flat).simulate(to=3.0, points=2).final("v") == pytest.approx(6.0)


def test_constants_of_zero_stay_in_their_laws() -> None:
    flat = there_and_back("""
      model M {
        constant none = 0 [N/m], many = 0
        1 j
        I m : p = 1 kg*v { start v = 1 [m/s] }
        for i in 0..2 { C c[i] : F = i*2 [N/m]*x + none*x; R r[i] : F = i*3 [N*s/m]*v;  j -> c[i], r[i] }
        j -> m
        output x = c[1].x, y = many
      }
    """)
    assert "constant constant_1 = 0" in flat


def test_expressions_of_every_form() -> None:
    flat = there_and_back("""
      constant L = 2 m
      function clip(x, low, high) = min(max(x, low), high)
      function swap(a, b) = polar(a, b)
      model M {
        parameter a = 3 m, b = -2 m, n = 2, g = 1.5 [m^(1/2)], t_0 = 0.3 s, flag = 1
        input w = 0.7
        signal s[1] = clip(a - (b - L), 0 m, 4 m)/(a/b)*(-a/L)
        signal s[2] = a^2/b^2 - (a/L)^3*2 + (a/L)^-2 + 2^(n*w) + sqrt(a^2 + b^2)/1 m
        signal s[3] = sin(w)*cos(w)*tan(w) + atan2(a, b) + sign(b) + abs(b)/a + exp(-w) + log(2 + w) + log10(n) + floor(w) + ceil(w)
        signal s[4] = a if w > 0.5 and not (a < b or a == L) else (b if flag == 1 else L if w != 0 else 2*L)
        signal s[5] = smoothstep5(time, 0 s, t_0) + smoothstep3(time, t_0, 2 s) + ramp(time, t_0, 1 s) + step(time - t_0) + pulse(time, 0 s, t_0)
        signal s[6] = asin(w)*acos(w)*atan(w) + sinh(w) + cosh(w) + tanh(w) + asinh(w) + acosh(1 + w) + atanh(w/2)
        signal s[7] = g^2/a - (g*sqrt(L))/a + (a*b^2)^(1/3)/L
        signal s[8] = -(a + b)/L - (-(w - 1)) + (1 - w)*(1 - w)/(1 + w)
        signal point = swap(a, w) + (1 m, 2 m)
        signal c = (w > 0.5) + 2*(w <= 0.7)
        output y[1] = s[1], y[2] = s[2], y[3] = s[3], y[4] = s[4], y[5] = s[5], y[6] = s[6], y[7] = s[7], y[8] = s[8]
        output px = point[1], py = point[2], c2 = c, lift = w < 1
      }
    """)
    assert flat.count("\n  output ") == 12


def test_factors_of_one_give_back_units() -> None:
    """`1 [N/m]*x` has no number left: the factor is written again."""
    flat = there_and_back("""
      model M {
        C spring : F = 1 [N/m]*x + x^3*1 [N/m^3]
        I mass : p = v*1 kg
        Se push : F = sin(time*1 [rad/s])*1 N
        push -> 1(spring, mass)
        output y = spring.x/1 m, e = exp(-spring.x*1 [1/m]), s = (spring.x*1 [1/m])^(mass.v*1 [s/m])
      }
    """)
    assert "  C spring : F = 1 [N/m]*x + 1 [N/m^3]*x^3\n" in flat
    assert "  I mass : p = 1 kg*v\n" in flat
    assert "  Se push : F = 1 N*sin(1 [1/s]*time)\n" in flat


def test_signals_with_memory() -> None:
    there_and_back("""
      model M {
        parameter h = 2 m
        I mass : p = 1 kg*v { start v = 1 [m/s] }
        R loss : F = 1 [N*s/m]*v
        1 j
        j -> mass, loss
        signal height = integral(mass.v - 0.1 [1/s]*height, h)
        output far = integral(height/1 s, 0) + h, twice = 2*integral(abs(mass.v), 0 m) + height
      }
    """)


def test_plain_models_stay_plain() -> None:
    flat = there_and_back("""
      plain model M {
        parameter k = 3, m = 2, x = 1
        C spring : e = k*q + 0.1*q^3 { start q = 1 }
        I mass : p = m*f
        C field(a, b) : energy = a^2 + b^2 + a*b*x
        MSe push : e = sin(2*time)*spring.q
        1 j
        push -> j -> spring, mass, field.a, field.b
        output y = spring.q, h = integral(mass.f, 0), t = time
      }
    """)
    assert "\nplain model M {" in flat
    assert "without units" not in flat


def test_untyped_ports_in_a_typed_model() -> None:
    flat = there_and_back("""
      model M {
        parameter k = 3
        1 j : untyped
        C c : e = k*q
        C field(a: untyped, b: translation) : energy = a^2 + b^2*1 [1/m^2]
        R r : e = f
        j -> c, field.a, r
        1 body : translation
        body -> field.b, mass
        I mass : p = 1 kg*v
        output y = c.q, x = mass.v
      }
    """)
    assert "C field(a: untyped, b: translation) : energy = a^2 + 1 [1/m^2]*b^2\n" in flat


def test_mechanisms() -> None:
    flat = there_and_back("""
      model Arm {
        parameter l = 1 m, mass = 2 kg, g = 9.81 [m/s^2]
        multibody chain : planar {
          gravity = (0, -g)
          for i in 1..2 { body link[i] { mass = mass, inertia = mass*l^2/12, at = ((i - 1/2)*l, 0) } }
          body tip { mass = 0.1 kg, at = (2*l, 0.2 m), angle = 30 deg }
          body loose { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (3*l, 0), start x = 3.1 m, start phi.omega = 1 [rad/s] }
          body slider { mass = 1 kg }
          hinge top : ground to link[1] { at = (0, 0), start phi = 10 deg, start omega = 2 [1/s] }
          hinge middle : link[1] to link[2] { at = (l, 0) }
          weld fixed : link[2] to tip
          free spring : tip to loose { at = (2.5*l, 0), angle = 45 deg, axes = middle }
          slide rail : ground to slider { along = 30 deg, start x = 0.1 m }
          frame point : loose { at = (3*l, 0.3 m) }
        }
        C leaf(x, y, phi) : energy = 1/2*(3 [N/m])*x^2 + 1/2*(5 [N/m])*y^2 + 1/2*(2 [N*m])*phi^2
        R top_loss, other_loss : M = 0.1 [N*m*s]*omega
        chain.spring => leaf
        chain.top -> top_loss
        chain.top -> other_loss
        MSe wind : F = 1 N*sin(time/1 s)*chain.loose.phi
        wind -> chain.point.x
        C rail_spring : F = 10 [N/m]*x { start x = 0.01 m }
        chain.rail -> rail_spring
        output y = chain.link[2].y, phi = chain.middle.phi, rate = chain.tip.x.v, torque = chain.top.M
      }
      model Two {
        Arm one { l = 0.5 m };  Arm two { g = 1.62 [m/s^2] }
        output dy = one.y - two.y, a = one.chain.spring.x
      }
    """)
    assert "  multibody one_chain : planar {  # one.chain\n" in flat
    assert "    hinge middle : link[1] to link[2] { at = (one_l, 0) }\n" in flat
    assert flat.count("one_chain.top.phi -> one_top_loss, one_other_loss\n") == 1


def test_what_an_experiment_sets_and_reports() -> None:
    """The graph of a run: inputs have what is set, reported expressions are outputs with names of their own."""
    model = bondgraph.load("""
      model M {
        input u = 0 N, w = 1 N
        parameter k = 2 [N/m]
        signal half = u/2
        MSe s : F = u + half
        C c : F = k*x
        R r : F = 3 [N*s/m]*v
        s -> 1(c, r)
        output x = c.x, unused = c.F
        experiment run { set u = 3 N*sin(time/1 s); simulate 0 .. 1 s; report x in mm, (x - 1 mm) in um, half, w, k, c.x }
      }
    """)
    original = model.compilation(model.scene(), everything=True)
    flat = write_text(original.whole_graph)
    reread = bondgraph.load(flat).compilation(everything=True)
    same_motion(original, reread)
    assert "  input u: N = 3 N*sin(1 [1/s]*time)\n" in flat
    assert list(reread.whole_graph.outputs) == ["x", "x_1_mm", "half", "w_2", "k_2", "c_x"]
    assert "  signal unused: N = c.F\n" in flat


def test_an_output_that_is_not_reported_leaves_no_letter_to_a_law() -> None:
    """It is written as a signal: `v` is no longer the law's, so `f` must be, and the parameter of that name gives way."""
    model = bondgraph.load("""
      model M {
        parameter f = 9 Hz, r = 2 [N*s/m]
        input push = 0 N
        MSe s : F = push
        I m : p = 3 kg*v
        R loss : F = r*v
        s -> 1(m, loss)
        output v = m.v, out = 2*m.v
        experiment run { set push = 1 N*sin(2*pi*f*time); simulate 0 .. 1 s; report out }
      }
    """)
    original = model.compilation(model.scene(), everything=True)
    flat = write_text(original.whole_graph)
    assert "  parameter f_2: 1/s = 9  # f\n" in flat and "  R loss : F = r*f\n" in flat
    reread = bondgraph.load(flat).compilation(everything=True)
    Same(original.whole_graph, reread.whole_graph).check()
    same_motion(original, reread)


def test_constants_of_which_only_a_number_is_left() -> None:
    """`a*sin(0)` reads nothing: in the graph it is the same number as in the text."""
    flat = there_and_back("""
      model M {
        parameter a = 2 m
        for i in 1..2 {
          constant foot = polar(a, 90 deg*(i - 1))
          input x[i] = 1 m
          output y[i] = x[i] - foot[2]
        }
      }
    """)
    assert "foot_1_2" not in flat and "  output y[1]: m = x[1]\n" in flat and "y[2]: m = x[2] - foot_2_2\n" in flat


def test_what_is_set_from_outside_can_still_be_set() -> None:
    flat = bondgraph.load(write_text(bondgraph.load(MODELS / "manipulator.bg").compilation().whole_graph))
    original = bondgraph.load(MODELS / "manipulator.bg")
    push = {"fx": "1 uN*smoothstep5(time, 0 s, 0.5 ms)"}
    first = original.simulate(None, {"comb[1].k": "9 [N/m]", "d[2]": "1.8 um", **push}, to="1 ms", points=3)
    second = flat.simulate(None, {"comb_1_k": "9 [N/m]", "d[2]": "1.8 um", **push}, to="1 ms", points=3)
    np.testing.assert_allclose(second["x"], first["x"], rtol=1e-9)
    assert np.abs(first["x"]).max() > 0
