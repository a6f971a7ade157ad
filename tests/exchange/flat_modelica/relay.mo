model Relay "a two-point controller, as Modelica.Blocks.Logical.Hysteresis writes it"
  parameter Real uLow = 19, uHigh = 21, T_out = 10, tau = 100, dT = 20;
  Real T(start = 18, fixed = true);
  Boolean hot(start = false, fixed = true);
equation
  hot = not pre(hot) and T > uHigh or pre(hot) and T >= uLow;
  tau*der(T) = T_out - T + (if hot then 0 else dT);
  annotation(experiment(StopTime = 500));
end Relay;
