"""Studies: many points of one model, what they give, and what measured data say of its parameters."""
