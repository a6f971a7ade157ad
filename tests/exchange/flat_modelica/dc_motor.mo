model DCMotor
  input Real u(unit = "V") = 12;
  input Real load(unit = "N.m") = 0.0 "torque of what it drives";
  parameter Real R(unit = "Ohm") = 1, L(unit = "H") = 1e-3, K(unit = "N.m/A") = 0.05, J(unit = "kg.m2") = 1e-4, b(unit = "N.m.s/rad") = 1e-4;
  Real i(unit = "A", start = 0, fixed = true);
  output Real w(unit = "rad/s", start = 0, fixed = true);
  Real tau(unit = "N.m");
  Real emf(unit = "V");
initial equation
equation
  L*der(i) + R*i + emf = u;
  emf = K*w;
  tau = K*i;
  J*der(w) = tau - b*w - load;
  annotation(experiment(StopTime = 0.5));
end DCMotor;
