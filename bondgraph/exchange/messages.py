"""Sentences by which a unit tells an importer why it refuses something; the numbers are those of `runtime/instance.py`."""

from compiler.api import LimitNote

from .runtime import instance

_SENTENCES = {
    instance.NO_VALUE: "There is no such value reference, or it cannot be set.",
    instance.NOT_NOW: "This is not possible in this state of the instance.",
    instance.TOO_MANY_STEPS: "The communication step needs too many steps: make it shorter.",
    instance.NO_STEP: "No step is short enough for the tolerance: the values grow without bound, or the model is singular here.",
    instance.NOT_FINITE: "A value or a rate is not finite.",
    instance.WRONG_TIME: "The communication point is not the time that the instance has reached.",
    instance.NO_SLOPE: "There are directional derivatives of outputs and rates by inputs and states alone.",
    instance.SLIDES: "Conditions can neither hold nor fail: either side leads back to the other. Give the model a mode that sticks, or a smooth law.",
    instance.WITHOUT_END: "Events cause each other without end.",
    instance.PILED_UP: "Events accumulate: end them by a mode that an event sets where little is left.",
    instance.SET_TWICE: "Two events set one quantity at one instant.",
    instance.WRONG_SAMPLING: "The period, offset, delay, jitter or seed of a sampled event is out of its range.",
    instance.CROWDED: "A condition changes too often within a step to be followed: it may be nothing but the rounding of terms that cancel.",
    instance.SINGULAR: "The mechanism comes to a singular pose: its constraints depend on each other there, and it may go on in several ways.",
    instance.OPEN: "The loops of the mechanism are not closed with these values: set the starts of all its states so that they are.",
    instance.NO_SOLUTION: "An algebraic loop has no solution near the last one.",
    instance.ENDED: "An event has ended the run.",
}  # fmt: skip
MESSAGES = tuple(_SENTENCES.get(number, "") for number in range(instance.LIMITS))
# Kinds of limits, in the order of their numbers, and sentences on them.
_LIMITS = {
    "require": "The requirement `{0.words}` (line {0.span.line}) does not hold any more.",
    "table": "The table `{0.words}(...)` of `{0.owner}` (line {0.span.line}) is asked outside of its range.",
    "start": "With these parameters the model has no meaning: {0.words} is out of its range.",
}
KINDS = tuple(_LIMITS)


def sentence_of(note: LimitNote) -> str:
    """Return the sentence by which a unit tells an importer that a limit is left."""
    return _LIMITS[note.kind].format(note)
