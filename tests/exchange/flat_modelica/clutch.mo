model Clutch "if equations, functions, noEvent, min and max, steady start"
  parameter Real J1 = 1, J2 = 2, c = 3;
  parameter Boolean hard = true;
  constant Real pi = 2*asin(1.0);
  Real w1(start = 10, fixed = true), w2(start = 0, fixed = true), M, drive, z;
equation
  if hard and time > 1 then
    M = c*max(min(w1 - w2, 1), -1);
    drive = sin(2*pi*time);
  elseif time > 0.5 then
    drive = 0;
    M = c*noEvent(if abs(w1 - w2) > 1 then sign(w1 - w2) else w1 - w2);
  else
    M = 0;
    drive = mod(time, 0.2);
  end if;
  J1*der(w1) = drive - M;
  J2*der(w2) = M - 0.1*w2;
  z = smooth(1, if w2 > 1 then (w2 - 1)^2 else 0) + semiLinear(w1 - 9, 2, 3) + div(7.5*w1, 2);
  annotation(experiment(StopTime = 2, Tolerance = 1e-9));
end Clutch;
