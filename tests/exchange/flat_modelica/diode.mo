model Diode "a diode and a resistor: a nonlinear loop; initial equation"
  parameter Real Is(unit = "A") = 1e-12, Vt(unit = "V") = 0.025, R(unit = "Ohm") = 1000, C(unit = "F") = 1e-6;
  Real vd(unit = "V", start = 0.6), i(unit = "A"), vr(unit = "V"), vc(unit = "V");
  Real ic(unit = "A");
initial equation
  vc = 0.2 + 0.1;
equation
  i = Is*(exp(vd/Vt) - 1);
  vr = R*i;
  vd + vr + vc = 5*sin(314*time) + 5;
  ic = i - vc/2000;
  C*der(vc) = ic;
  annotation(experiment(StopTime = 0.02, Tolerance = 1e-9));
end Diode;
