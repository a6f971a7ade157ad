//! base 0.1.0
package 'VanDerPol'
  model 'VanDerPol'
    parameter Real 'mu' = 1.0;
    output Real 'x'(start = 2.0, fixed = true);
    output Real 'y'(start = 0.0, fixed = true);
  equation
    der('x') = 'y';
    der('y') = 'mu' * (1.0 - 'x' ^ 2.0) * 'y' - 'x';
    annotation(experiment(StopTime = 5.0));
  end 'VanDerPol';
end 'VanDerPol';
