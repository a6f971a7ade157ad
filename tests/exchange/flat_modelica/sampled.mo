model Sampled "a PI controller with a period"
  parameter Real T(unit = "s") = 0.1, K = 2, Ti(unit = "s") = 0.5;
  Real x(start = 0, fixed = true);
  discrete Real u(start = 0, fixed = true), s(start = 0, fixed = true), e(start = 0, fixed = true);
equation
  der(x) = -x + u;
  when sample(0, T) then
    e = 1 - x;
    s = pre(s) + e*T/Ti;
    u = K*(e + s);
  end when;
  annotation(experiment(StopTime = 3));
end Sampled;
