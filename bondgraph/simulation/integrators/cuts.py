"""Check of a step cut by an event: places and quotients, see `integration/cut.py`."""

NEAR = 1e-3  # fraction of the remaining part: distance of the states of a difference quotient; EPS^(1/5), as it is of order 4
HALVES = (0.5, 1.0)  # fractions of the remaining part at which rates are evaluated
BACK = (0.0, -1.0, -2.0, -3.0, -4.0)
SLOPE = (25.0 / 12, -48.0 / 12, 36.0 / 12, -16.0 / 12, 3.0 / 12)  # backward difference quotient of order 4
PARTED = len(BACK)
ALLOWED = 1.0  # in units of the tolerance: error of the states if the derivatives err as much over the whole part
SHORTEST = 2.0**14  # units in the last place of a time: a shorter part gives no difference quotient
