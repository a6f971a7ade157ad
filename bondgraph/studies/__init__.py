"""Studies: many points of one model, their results, and the estimation of parameters from measured data."""
