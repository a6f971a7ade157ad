"""Limits of the constraint projection and of the search for singular poses, the same in Python and in machine code."""

# projection
ITERATIONS = 20
ROUNDING = 4e-16  # relative to the size of a constraint residual: it cannot get smaller
NOISE = 1e-13  # relative to that size: rounding left where large positions are subtracted
WEAK = 1e-5  # smallest pivot of a Cholesky factor that is trusted

# singular poses
LOOK = 16.0  # steps ahead within which a singular pose is crossed in one step
NEAR = 0.3  # fraction of the time to it: longest ordinary step; a series about its middle converges by more than a factor of five
MISSES = 0.5  # fraction of the singular value: remainder of a parabola at the zero of the straight line
APART = 1e-8  # relative size from which the residual of a redundant row counts as open: the root of the rounding, at a double zero
FINE = 1e-9  # relative tolerance below which that many steps get too short: rounding grows as a crossing gets shorter
NEVER = 1e300  # time ahead: no try yet
