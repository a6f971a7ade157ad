model Tank "A tank that a pump keeps between two levels"
  parameter Real A(unit = "m2") = 2.0;
  parameter Real k(unit = "m2/s") = 0.01;
  parameter Real q(unit = "m3/s") = 0.05;
  Real level(unit = "m", start = 1.0, fixed = true);
  discrete Integer starts(start = 0, fixed = true);
  Boolean pumping(start = false, fixed = true);
  output Real outflow(unit = "m3/s");
equation
  outflow = k*level;
  A*der(level) = (if pumping then q else 0.0) - outflow;
  when level < 0.5 then
    pumping = true;
    starts = pre(starts) + 1;
  elsewhen level > 2 then
    pumping = false;
    starts = pre(starts);
  end when;
  annotation(experiment(StopTime = 1000));
end Tank;
