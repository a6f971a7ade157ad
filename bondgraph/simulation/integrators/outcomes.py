"""Answers of the source of the steps to its callers, each with a number of its own."""

FINISHED, MORE = 0, 1  # the end is reached; the requested number of steps is made
LOOK = 2  # the limits of the model must be checked at the left instants
HANDOVER = 3  # other states should be integrated
NEWTON, ERROR, ROUND_OFF = 4, 5, 6  # reasons for no step
ORDER = 7  # the matrix needs another order
CROSS, REDUNDANT = 8, 9  # a singular pose is ahead; a redundant constraint opens
STIFF = 10  # stability limits the steps of an explicit method
FLIP = 11  # a condition may cross zero in the last step: the caller sets its end (`until`), or another mode
CROSSED = 12  # pilot run: a condition has changed
ABSENT = 13  # the step of the method has no machine code yet
FAILURES = {NEWTON: "newton", ERROR: "error", ROUND_OFF: "round-off"}
