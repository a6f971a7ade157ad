"""Errors outside the text of a model: in a call, in the numbers, in an installation."""

from __future__ import annotations

from typing import Any, Self


class BondgraphError(Exception):
    """Base of all errors outside the text of a model: a code, a sentence, and advice where there is some; `errors.md` lists the codes.

    It is raised as `UsageError("BR408", "there are no data:", "name a file")`; its text is the sentence and the advice.
    """

    def __init__(self, code: str, sentence: str, advice: str = "") -> None:
        super().__init__(code, sentence, advice)
        self.code, self.sentence, self.advice = code, sentence.rstrip(":;,."), advice

    def __str__(self) -> str:
        return " ".join(filter(None, self.args[1:]))


class UsageError(BondgraphError):
    """Raised for an invalid call: an unknown name, an impossible value; the message lists the possible ones."""


class ManyRuns(UsageError):
    """Raised for an experiment that is more than one run, or none: `Model.run` executes it."""


class RunFailed(BondgraphError):
    """Raised if the text is valid, but the numbers failed; the message has the time and the quantity.

    `result` is the part computed up to then, a `bondgraph.Result`; None if the run had not begun.
    """

    result: Any = None


class RunInterrupted(KeyboardInterrupt):
    """Raised if Ctrl-C was pressed during a run; `result` is the part computed up to then."""

    result: Any = None


class RunBroken(BondgraphError):
    """Raised for a defect of this program, or of the machine, in the middle of a run; `result` is the part computed up to then."""

    result: Any = None


class PointBroken(RunFailed):
    """Raised for the same at one of many points; the others went on."""


class FailedAt(RunFailed):
    """Raised for equations that fail at one time and state; shape (n,), unknowns of loops included."""

    def at(self, time: float, state: Any, mode: Any) -> Self:
        """Return the error with its time, state and mode."""
        self.time, self.state, self.mode = time, state, mode
        return self


class RateNotFinite(FailedAt):
    """Raised if a rate is not finite."""


class StepsCollapsed(FailedAt):
    """Raised if the steps lead no further. `ahead`: points ever further along the flow; empty where the steps are not too short."""

    ahead: tuple[tuple[float, Any], ...] = ()


class NotLossless(FailedAt):
    """Raised if an energy-conserving method was requested for a model that gains or loses energy."""


class MissingPackage(BondgraphError, ImportError):
    """Raised if an optional package is not installed; the message says how to install it."""


class UnknownOutput(KeyError):
    """Raised if a result has no output of the requested name."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError itself would show the quoted representation of the message
