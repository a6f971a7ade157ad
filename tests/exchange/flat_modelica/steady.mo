model Steady
  parameter Real a(unit = "1/s") = 2, u0(unit = "m") = 3;
  Real x(unit = "m"), y(unit = "m");
initial equation
  der(x) = 0;
  der(y) = 0;
equation
  der(x) = a*(u0 - x) + (if time > 1 then a*u0 else 0);
  der(y) = a*(x - y);
  assert(x < 100, "too \"large\"");
  annotation(experiment(StopTime = 3));
end Steady;
