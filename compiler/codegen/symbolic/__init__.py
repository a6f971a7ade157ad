"""State space to state equations in sympy, from which the stage and the readable programs are printed."""
