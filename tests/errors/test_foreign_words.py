"""Lines as users of 20-sim, Modelica, SPICE, MATLAB and Python type them: the advice names what is meant, and works when it is followed."""

from __future__ import annotations

import re

import pytest

from compiler.errors import Diagnostic
from compiler.examination import check
from compiler.source import Source
from tests.compiling import LIBRARY

MODEL = """IMPORTmodel A {
  parameter m = 1 kg, k: N/m = 100, n = 2
  I mass : p = m*v { start v = 1 [m/s] }
  C spring : F = k*x
  R damper : F = 0.5 [N*s/m]*v
  1 body
  body -> mass, damper
  output v = mass.v
  LINE
}
"""
CASES = [  # the line; words of the advice; the line when it is followed
    ("c = 3", "parameter c = 3", "parameter c = 3"), ("parameters c = 3", "`parameter c = 3`", "parameter c = 3"), ("var c = 3", "`parameter c = 3`", "parameter c = 3"),
    ("double c = 3;", "`parameter c = 3;`", "parameter c = 3;"), ("parameter Real c = 3", "instead of a type", "parameter c = 3 [N/m]"), ("const c = 3", "constant c = 3", "constant c = 3"),
    ("output y := mass.v", "written `=`", "output y = mass.v"), ("output y = 2mass.v", "`2*mass.v`", "output y = 2*mass.v"), ("output y = mass.v**2", "a^2", "output y = mass.v^2"),
    ("output y = 1,5*mass.v", "`1.5`", "output y = 1.5*mass.v"), ("output y = .5*mass.v", "`0.5`", "output y = 0.5*mass.v"), ("output y = SIN(1)", "`sin`", "output y = sin(1)"),
    ("output y = Math.sin(1)", "`sin(…)`", "output y = sin(1)"), ("output y = np.exp(1)", "`exp(…)`", "output y = exp(1)"), ("output y = arctan(1)", "`atan`", "output y = atan(1)"),
    ("output y = pow(n, 2)", "a^2", "output y = n^2"), ("output y = 2*PI", "`pi`", "output y = 2*pi"), ("output y = t", "`time`", "output y = time"),
    ("output y in mm = spring.x", "`output y: mm`", "output y: mm = spring.x"), ("body -> 1 (spring)", "`1(", "body -> 1(spring)"), ("parameter l in mm = 3", "`parameter l: mm`", "parameter l: mm = 3"),
    ("output y = m*g", "`parameter g = 9.81 [m/s^2]`", "parameter g = 9.81 [m/s^2]; output y = m*g"),
    ("output y = e", "exp(1)", "output y = exp(1)"), ("output y = ddt(spring.x)", "der(x)", "output y = der(spring.x)"),
    ("output y = round(n)", "floor", "output y = floor(n + 0.5)"), ("output y = integrate(mass.v)", "integral(rate, start)", "output y = integral(mass.v, 0 m)"),
    ("output y = if n > 1 then 2 else 3", "a if condition else b", "output y = 2 if n > 1 else 3"), ("output y = n > 1 ? 2 : 3", "a if condition else b", "output y = 2 if n > 1 else 3"),
    ("output y = 1 if n > 1 && n < 3 else 0", "`and`", "output y = 1 if n > 1 and n < 3 else 0"), ("output y = 1 if n > 1 || n < 0 else 0", "`or`", "output y = 1 if n > 1 or n < 0 else 0"),
    ("output y = table(n, 1)", "linear(x, xs, ys)", "output y = linear(n, (1, 2), (3, 4))"), ("output y = 1_000", "1000", "output y = 1000"),
    ("parameter r = 10k", "10 kohm", "parameter r = 10 kohm"), ("parameter r = 4k7", "4.7 kohm", "parameter r = 4.7 kohm"), ("parameter f = 50 hz", "`Hz`", "parameter f = 50 Hz"),
    ("parameter f = 50 hertz", "`Hz`", "parameter f = 50 Hz"), ("parameter T = 300 kelvin", "`K`", "parameter T = 300 K"), ("parameter T = 25 °C", "`degC`", "parameter T = 25 degC"),
    ("parameter d = 3 millimeters", "`mm`", "parameter d = 3 mm"), ("parameter d = 3 MM", "`mm`", "parameter d = 3 mm"), ("parameter w = 3 RPM", "`rpm`", "parameter w = 3 rpm"),
    ("parameter d = 3 feet", "`ft`", "parameter d = 3 ft"), ("parameter d = 3 inches", "`inch`", "parameter d = 3 inch"), ("parameter u = 3 kilovolt", "`kV`", "parameter u = 3 kV"),
    ("parameter a = 9.81 m/s²", "`^`", "parameter a = 9.81 m/s^2"), ("parameter a = 2 m s", "[m*s]", "parameter a = 2 [m*s]"), ("parameter w = 3 rad/sec", "[N*s]", "parameter w = 3 [rad/s]"),
    ("parameter xs = {1, 2, 3}", "(1, 2, 3)", "parameter xs = (1, 2, 3)"), ("parameter xs = [1 2 3]", "[1, 2, 3]", "parameter xs = [1, 2, 3]"),
    ("parameter A = [1, 2; 3, 4]", "[[1, 2], [3, 4]]", "parameter A = [[1, 2], [3, 4]]"), ("parameter A = [1 2; 3 4]", "[[1, 2], [3, 4]]", "parameter A = [[1, 2], [3, 4]]"),
    ("output y = inv([[n, 1], [1, 3]])", "inverse(A)", "output y = inverse([[n, 1], [1, 3]])"), ("constant A = [[1, 2], [3, 4]]; constant B = A'", "transpose(A)", "constant A = [[1, 2], [3, 4]]; constant B = transpose(A)"),
    ("constant A = [[1, 2], [3, 4]]; constant w = A\\[1, 2]", "solve(A,", "constant A = [[1, 2], [3, 4]]; constant w = solve(A, [1, 2])"),
    ("connect(body, spring)", "`body -> spring`", "body -> spring"), ("connect body spring", "`body -> spring`", "body -> spring"), ("body - spring", "`body -> spring`", "body -> spring"),
    ("spring <- body", "`body -> spring`", "body -> spring"), ("body <-> spring", "`body -> spring`", "body -> spring"), ("body --- spring", "`body -> spring`", "body -> spring"),
    ("spring2 : C : F = k*x", "`C spring2 : F = k*x`", "C spring2 : F = k*x; body -> spring2"), ("mass2: I : p = m*v", "`I mass2 : p = m*v`", "I mass2 : p = m*v; body -> mass2"),
    ("Se push = 1 N", "law behind a colon", "Se push : F = 1 N; push -> body"), ("SE push : F = 1 N", "`Se`", "Se push : F = 1 N; push -> body"),
    ("1-junction j2", "`1 j2`", "1 j2; body -> j2"), ("OneJunction j2", "`1 name`", "1 j2; body -> j2"), ("zero j2 : translation", "`0 name`", "0 j2 : translation; body -> j2"),
    ("R1 1 2 10", "`R wire : u", "R wire : F = 1 [N*s/m]*v; body -> wire"), ("Resistor r { R = 10 ohm }", "import Resistor from electric", "import"), ("resistor r", "import Resistor from electric", "import"),
    ("w : Resistor(R=1)", "`Resistor w`", ""), ("w: Resistor;", "`Resistor w`", ""),
    ("Friction f(mu=1)", "in braces", ""), ("mass.v = 3", "start v", ""), ("start mass.v = 3 [m/s]", "start v = 3 [m/s]", ""),
    ("spring -> mass -> body", "1(spring, mass)", ""), ("for i = 1:3 { 1 j[i] }", "for i in 1..3", "for i in 1..3 { 1 j[i]; body -> j[i] }"),
    ("for i in range(3) { 1 j[i] }", "for i in 1..3", "for i in 1..3 { 1 j[i]; body -> j[i] }"), ("for (i in 1..3) { 1 j[i] }", "for i in 1..3", "for i in 1..3 { 1 j[i]; body -> j[i] }"),
    ("function f(x) { return 2*x }", "`function f(x) = 2*x`", "function f(x) = 2*x"), ("def f(x): return 2*x", "`function f(x) = 2*x`", "function f(x) = 2*x"),
    ("function f(x): 2*x", "`function f(x) = 2*x`", "function f(x) = 2*x"), ("when mass.v < 0 then mass.v = 0", "when condition {", "when mass.v < 0 { mass.v = 0 }"),
    ("when mass.v < 0 { reinit(mass.v, 0) }", "`mass.v = 0`", "when mass.v < 0 { mass.v = 0 }"), ("when mass.v < 0 { mass.v := 0 }", "written `=`", "when mass.v < 0 { mass.v = 0 }"),
    ("mode u = 0; every 5 ms { u := 1 }", "written `=`", "mode u = 0; every 5 ms { u = 1 }"), ("mode u = 0; every 5 ms { u = 1 | 2 }", "`or`", ""),
    ("// comment", "`#`", "# comment"), ("% comment", "`#`", "# comment"), ("/* comment */", "`#`", "# comment */"),
    ("parameter c = 3 // comment", "`#`", "parameter c = 3 # comment"), ("equation", "between the braces", ""), ("annotation(x=1);", "between the braces", ""),
    ("solve z : z^3 + z = time/1 s", "`solve z^3 + z = time/1 s for z = 0`", "solve z^3 + z = time/1 s for z = 0"),
    ("simulate 0 .. 1 s", "experiment", "experiment e { simulate 0 .. 1 s }"), ("experiment e { simulate 5 s }", "`simulate 0 .. 5 s`", "experiment e { simulate 0 .. 5 s }"),
    ("experiment e { simulate 0 to 5 s }", "`simulate 0 .. 5 s`", "experiment e { simulate 0 .. 5 s }"), ("experiment e { run 0 .. 5 s }", "`simulate 0 .. 5 s`", "experiment e { simulate 0 .. 5 s }"),
    ("experiment e { simulate 0 .. 5 s; plot v }", "`report v`", "experiment e { simulate 0 .. 5 s; report v }"),
    ("experiment e { simulate 0 .. 5 s; report v as mm/s }", "`report v in mm/s`", "experiment e { simulate 0 .. 5 s; report v in mm/s }"),
    ("experiment e { simulate 0 .. 5 s report v }", "; report", "experiment e { simulate 0 .. 5 s; report v }"),
    ("experiment e { simulate 0 .. 5 s step 1 ms }", "--points", "experiment e { simulate 0 .. 5 s }"),
    ("variables real c;", "`signal c", "signal c = 3*mass.v"), ("parameters real c = 3 {N/m};", "`parameter c = 3 [N/m]`", "parameter c = 3 [N/m]"),
    ("parameters real global c = 3;", "`parameter c = 3 [N/m]`", "parameter c = 3 [N/m]"), ("real c", "`parameter c = 3`", "parameter c = 3"),
    ("output y = sqr(n)", "`a^2`", "output y = n^2"), ("output y = arcsin(0.5)", "`asin`", "output y = asin(0.5)"), ("output y = resint(mass.v, 0, 1)", "`when`", "signal s = integral(mass.v, 0 m); when mass.v > 2 [m/s] { s = 0 m }"),
    ("output y = tdelay(mass.v, 1)", "`delay(x, 1 ms)`", "output y = delay(mass.v, 1 ms)"), ("output y = dly(mass.v, 0)", "an `every`", "mode u = 0 [m/s]; every 1 ms { u = mass.v }"),
    ("output y = limit(mass.v, 0, 1)", "min(max(x, low), high)", "output y = min(max(mass.v, 0 [m/s]), 1 [m/s])"), ("output y = clip(n, 0, 1)", "min(max(x, low), high)", "output y = min(max(n, 0), 1)"),
    ("output y = event(mass.v)", "when x > 1 {", "when mass.v > 2 [m/s] { mass.v = 0 [m/s] }"), ("Real c;", "`parameter c = 3`", "parameter c = 3"), ("Real c(start=3);", "`parameter c = 3 [N/m]`", "parameter c = 3 [N]"),
    ("parameter SI.Mass c = 3;", "instead of a type", "parameter c = 3 [kg]"), ("parameter Modelica.SIunits.Mass c = 3;", "instead of a type", "parameter c = 3 [kg]"), ("Boolean on = true;", "`mode on = false`", "mode on = false"),
    ("discrete Real c;", "`mode c = 0`", "mode c = 0"), ("extends Base;", "an instance", ""), ("extends Base(c = 3);", "an instance", ""), ("flow Real i;", "`port a: electric`", "port a: electric"),
    ("replaceable Base b;", "`parameter Kind: model = Base`", ""), ("inner World world;", "`constant` of the file", ""), ("within Package;", "without packages", ""), ("end A;", "between the braces", ""),
    ("output y = noEvent(mass.v)", "its argument alone", "output y = mass.v"), ("output y = smooth(1, mass.v)", "its argument alone", "output y = mass.v"), ("output y = semiLinear(n, 1, 2)", "a if condition else b", "output y = 1*n if n > 0 else 2*n"),
    ("output y = sample(0, 1)", "mode held = 0; every 1 ms { held = 1 }", "mode held = 0; every 1 ms { held = 1 }"), ("output y = edge(n > 1)", "when x > 1 {", "mode c = 0; when mass.v > 1 [m/s] { c = 1 }"),
    ("output y = integer(n)", "floor(a)", "output y = floor(n)"), ("output y = div(n, 2)", "floor(a/b)", "output y = floor(n/2)"), ("output y = trunc(n)", "sign(a)*floor(abs(a))", "output y = sign(n)*floor(abs(n))"),
    ("output y = zeros(3)", "(0, 0, 0)", "output y = (0, 0, 0)"), ("output y = linspace(0, 1, 3)", "for i in 1..3 {", "for i in 1..3 { constant a[i] = 0 }"), ("output y = sum((n, n, n))", "dot(x, (1, 1, 1))", "output y = dot((n, n, n), (1, 1, 1))"),
    ("output y = n <> 2", "`!=`", "output y = n != 2"), ("output y = n ~= 2", "`!=`", "output y = n != 2"), ("output y = ~(n > 2)", "`not (a > b)`", "output y = not (n > 2)"), ("output y = n .* 2", "`a*b`", "output y = n*2"),
    ("output y = n .^ 2", "`a^2`", "output y = n^2"), ("n += 1", "`mode n = 0;", "mode c = 0; when mass.v > 1 [m/s] { c = c + 1 }"), ("V1 1 0 DC 5", "`Se supply : u", "Se supply : F = 5 N; supply -> body"),
    ("V1 in 0 SIN(0 1 50)", "sin(2*pi*50 Hz*time)", "Se supply : F = 5 N*sin(2*pi*50 Hz*time); supply -> body"), ("R1 in out 10k", "`R wire : u", "R wire : F = 1 [N*s/m]*v; body -> wire"), ("C1 n1 0 10u IC=0", "`R wire : u", ""),
    (".tran 1u 10m", "simulate 0 .. 10 ms", "experiment run { simulate 0 .. 10 ms }"), (".param c=3", "`parameter c = 3`", "parameter c = 3"), (".ic v(1)=0", "{ start u = 0 V }", ""), (".end", "between the braces", ""),
    ("parameter r = 10meg", "`10 Mohm`", "parameter r = 10 Mohm"), ("[t, x] = ode45(@f, [0 5], x0)", "experiment run { simulate 0 .. 5 s }", "experiment run { simulate 0 .. 5 s }"), ("function y = f(x)", "`function f(x) = 2*x`", "function f(x) = 2*x"),
    ("y = @(x) 2*x", "`function f(x) = 2*x`", "function f(x) = 2*x"), ("disp(n)", "`output y = mass.v`", "output y = mass.v"), ("while n < 3", "stop when x > 1", "experiment run { simulate 0 .. 5 s; stop when v > 1 [m/s] }"),
    ("elseif n > 2", "else if n > 0 {", "if n > 1 { constant a = 1 } else if n > 0 { constant a = 2 } else { constant a = 3 }"), ("switch n", "a if condition else b", "output y = 1 if n > 1 else 2"), ("global g", "`constant` of the file", ""),
    ("output y = log2(n)", "log(a)/log(2)", "output y = log(n)/log(2)"), ("output y = cosd(30)", "cos(30 deg)", "output y = cos(30 deg)"), ("output y = deg2rad(30)", "`30 deg`", "output y = 30 deg"), ("output y = hypot(3, 4)", "norm((a, b))", "output y = norm((3, 4))"),
    ("output y = rand(1)", "noise(time, 1 ms, 1)", "output y = noise(time, 1 ms, 1)"), ("output y = heaviside(time)", "step(time - 1 s)", "output y = step(time - 1 s)"), ("output y = square(time)", "pwm(time, 1 s, 0.5)", "output y = pwm(time, 1 s, 0.5)"),
    ("output y = sawtooth(time)", "mod(time, 1 s)", "output y = mod(time, 1 s)"), ("output y = sgn(n)", "`sign`", "output y = sign(n)"), ("output y = cbrt(n)", "a^(1/3)", "output y = n^(1/3)"), ("output y = True", "`true`", "output y = true"), ("output y = Time", "`time`", "output y = time"),
    ("experiment e { m = 2 kg; simulate 0 .. 1 s }", "`set m = 2 kg`", "experiment e { set m = 2 kg; simulate 0 .. 1 s }"), ("experiment e { parameter m = 2 kg; simulate 0 .. 1 s }", "`set m = 2 kg`", ""),
    ("experiment e { run 2 s }", "`simulate 0 .. 2 s`", "experiment e { simulate 0 .. 2 s }"), ("experiment e { run for 2 s }", "`simulate 0 .. 2 s`", ""), ("experiment e { stop time = 2 s }", "`simulate 0 .. 2 s`", ""),
    ("experiment e { tspan = 0 .. 2 s }", "`simulate 0 .. 2 s`", ""), ("experiment e { simulate 0 .. 2 s; save v }", "`report v`", ""), ("experiment e { initial mass.v = 3 [m/s]; simulate 0 .. 1 s }", "`start mass.v = 3 [m/s]`", "experiment e { start mass.v = 3 [m/s]; simulate 0 .. 1 s }"),
    ("experiment e { simulate 0 .. 2 s, rtol = 1e-8 }", "0 .. 1 s { rtol = 1e-8, points = 501 }", "experiment e { simulate 0 .. 1 s { rtol = 1e-8, points = 501 } }"),
    ("experiment e { sweep m from 1 kg to 2 kg; simulate 0 .. 1 s }", "`sweep m = 1 kg, 2 kg`", "experiment e { sweep m = 1 kg, 2 kg; simulate 0 .. 1 s }"),
    ("I coil : 2 kg", "`I coil : p = 2 kg*f`", "I coil : p = 2 kg*f; body -> coil"), ("I coil : m", "`I coil : p = m*f`", "I coil : p = m*f; body -> coil"), ("C soft : 1/k", "`C soft : q = (1/k)*e` or", "C soft : q = (1/k)*e; body -> soft"),
    ("C soft : k", "`C soft : e = k*q`", "C soft : e = k*q; body -> soft"), ("Se push : 5 N", "`Se push : e = 5 N`", "Se push : e = 5 N; push -> body"), ("R slow : 2 [N*s/m]", "`R slow : e = 2 [N*s/m]*f`", "R slow : e = 2 [N*s/m]*f; body -> slow"),
    ("TF lever : 3", "`TF lever : e2 = 3*e1`", "TF lever : e2 = 3*e1; 1 other : translation; body -> lever -> other"), ("1 other : 0", "`1 other : translation`", "1 other : translation; body -> other"),
    ("real k2 = 100 {N/m};", "`parameter k2 = 100 [N/m]`", "parameter k2 = 100 [N/m]"), ("parameters", "Each line says itself what it is", ""), ("real d2 = 0.5 {N.s/m};", "`parameter d2 = 0.5 [N*s/m]`", "parameter d2 = 0.5 [N*s/m]"),
    ("real global g = 9.81;", "`parameter g = 9.81;`", "parameter g = 9.81;"), ("k2 = {100, 'N/m'};", "`parameter k2 = 100 [N/m]`", "parameter k2 = 100 [N/m]"), ("p.e = int(p.f)/C;", "`C spring : e = k*q`", ""),
    ("GY Km : p1.e = 0.05*p2.f; p2.e = 0.05*p1.f", "`GY Km : e1 = K*f2`", ""), ("m*der(v) = -k*x;", "`I mass : p = m*v`", ""), ("der(x) = v;", "`signal x = integral(v, start)`", "signal way = integral(mass.v, 0 m)"),
    ("u - Ra - La - Jm", "`u -> 1(Ra, …)`", ""), ("when mass.v < 0 { reinit(mass.v, -n*pre(mass.v)) }", "`mass.v = -n*pre(mass.v)`", "when mass.v < 0 { mass.v = -n*mass.v }"),
    ("elsewhen mass.v < 0 { mass.v = 0 }", "a `when` of its own", "when mass.v < 0 { mass.v = 0 }"), (".param R=1k C=1u", "`parameter R = 1k`", ""), (".print tran v(out)", "`report u in mV`", ""),
    ("s = tf('s')", "TransferFunction2", ""), ("A = [0 1; -100 -0.5];", "`parameter A = [[1, 2], [3, 4]]`", "parameter A = [[0, 1], [-100, -0.5]]"), ("resistor Ra = R", "`R Ra : u = 2 ohm*i`", ""),
    ("Gear G1 (ratio = 10);", "`Gear G1 { ratio = 10 }`", ""), ("Gain K(2)", "`Gain K { r = 10 ohm }`", ""), ("Gain K { k = 2 }", "`signal y = 2*u", "signal y = 2*n"), ("Ground g", "`Se earth : u = 0 V`", ""),
    ("Se push : F = 1 N.m", "`1 N*m`", ""), ("submodel Motor { }", "`model Name { … }`", ""), ("parameter A2 = 2 m2", "`[m^2]`", "parameter A2 = 2 m^2"), ("parameter rho = 1000 kg/m3", "`^`, `m^3`", "parameter rho = 1000 [kg/m^3]"),
    ("parameter J = 1e-4 kg m^2", "`1e-4 [kg*m^2]`", "parameter J = 1e-4 [kg*m^2]"), ("I mass2 : F = m*a", "rate of the momentum", "I mass2 : p = m*v; body -> mass2"), ("R r2 : F = 2 [N*s]*w", "`omega`", ""),
    ("multibody arm : planar { body bob { mass = 1 kg }; revolute pin : ground to bob }", "`hinge`", ""), ("multibody arm : planar { body bob { mass = 1 kg }; hinge pin : ground -> bob }", "`ground to bob`", ""),
    ("multibody arm : planar { body bob { mass = 1 kg, inertia = 1 [kg*m^2] }; hinge pin : ground to bob }\n  output phi = pin.phi", "`arm.pin`", "multibody arm : planar { body bob { mass = 1 kg, inertia = 1 [kg*m^2] }; hinge pin : ground to bob }\n  output phi = arm.pin.phi"),
    ('string file = "road.csv"', '`parameter file = "road.csv"`', 'parameter file = "road.csv"'), ("parameter kind = 'soft'", '`parameter kind = "soft"`', 'parameter kind = "soft"'),
    ('parameter kind: { soft, hard } = "soft"', "Did you mean `soft`?", "parameter kind: { soft, hard } = soft"), ("0 n3 : three phase", "`0 node : electric[3]`", "0 n3 : electric[3]; R r3(p: electric[3]) : u = 2 ohm*i; n3 => r3"),
    ("C soft : F = 10 [N/m]*x { start 0.1 m }; body -> soft", "`start x = 0.1 m`", "C soft : F = 10 [N/m]*x { start x = 0.1 m }; body -> soft"),
    ("output speed = mass.v in mm/s", "`output speed: mm/s = mass.v`", "output speed: mm/s = mass.v"), ("when mass.v < 0: mass.v = 0", "when condition {", "when mass.v < 0 { mass.v = 0 }"),
    ("constant at = (0, -0.5) m", "`(0, -0.5 m)`", "constant at = (0, -0.5 m)"), ("for i = 1 to 3 { 1 j[i] }", "for i in 1..3", "for i in 1..3 { 1 j[i]; body -> j[i] }"),
    ("Se hot : T = 80 C", "`degC`", "Se hot : T = 80 degC; R wall : S_dot = 1 [W/K^2]*T; hot -> wall"), ("R r2 : F = 0.1 N s/m*v", "`0.1 [N*s/m]`", "R r2 : F = 0.1 [N*s/m]*v; body -> r2"),
    ("0 n3 : three_phase", "`electric[3]`", ""), ("0 far; R r2 : F = 2 [N*s/m]*v; body -> r2 -> far", "`-> 1(r2) -> far`", ""), ("experiment e { simulate 0:0.01:5 }", "`simulate 0 .. 5 s`", "experiment e { simulate 0 .. 5 s }"),
]  # fmt: skip


def told(line: str, top: str = "") -> tuple[Diagnostic, ...]:
    text = MODEL.replace("LINE", line).replace("IMPORT", top)
    if not re.search(r"\bspring\b(?!\.)", line):
        text = text.replace("body -> mass, damper", "body -> mass, damper, spring")
    return check(Source("text", text), None, LIBRARY)


@pytest.mark.parametrize(("line", "words", "followed"), CASES, ids=[case[0] for case in CASES])
def test_the_advice_names_what_is_meant_and_works(line: str, words: str, followed: str) -> None:
    found = told(line)
    assert found and words in found[0].help, [d.help for d in found]
    if followed == "import":
        part = "Resistor r { R = 10 ohm }; Se u : u = 1 V; u -> r.pins"
        assert not told(part, "import Resistor from electric\n")
    elif followed:
        assert not told(followed)


def test_there_are_many() -> None:
    assert len({line for line, _, _ in CASES}) >= 150


WHOLE = [  # texts outside of a model, and what is told of them
    ("import Modelica.Electrical.Analog.Basic.Resistor;\nmodel A { }", "`import Resistor from electric`"), ("component spring\n  nodes\n", "`model spring { … }`"),
    ("* RC low pass\nR1 in out 1k\n", "A comment begins with `#`"), ("model Osc:\n    C spring : F = k*x\n", "`model Osc { … }`"), ("def force(x):\n    return k*x\n", "`function force(x) = 2*x`"), ("C spring : F = force(x)\n", "all else stands in `model Name { … }`"),
    ("model A {\n  parameter m = 1 kg, k = 100 N/m\n  Se push : F = m*sin(2 s)\n}", "Divide by a reference"), ("model A { parameter m = 1 kg, k = 100 N/m; C spring : F = k*x; Se push : F = 1 N; push -> spring }", "write `100 [N/m]`"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "words"), WHOLE, ids=[words for _, words in WHOLE])
def test_the_advice_on_a_whole_file(text: str, words: str) -> None:
    assert any(words in d.help for d in check(Source("text", text), None, LIBRARY))
