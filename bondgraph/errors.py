"""Errors outside the text of a model: in a call, in the numbers, in an installation."""

from __future__ import annotations

from typing import Any


class BondgraphError(Exception):
    """Base of all errors outside the text of a model: a code, a sentence, and advice where there is some; `errors.md` lists the codes.

    It is raised as `UsageError("BR408", "there are no data:", "name a file")`; its text is the sentence and the advice.
    """

    def __init__(self, *words: str) -> None:
        super().__init__(*words)
        self.code, sentence, self.advice = ("", *words, "") if len(words) == 1 else (*words, "")[:3]
        self.sentence = sentence.rstrip(":;,")

    def __str__(self) -> str:
        return " ".join(self.args[1:] or self.args)


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

    def __init__(self, what: str, result: object) -> None:
        super().__init__(what)
        self.result: Any = result

    def __reduce__(self) -> tuple[type[RunInterrupted], tuple[Any, ...]]:
        return type(self), (str(self), self.result)


class RunBroken(BondgraphError):
    """Raised for a defect of this program, or of the machine, in the middle of a run; `result` is the part computed up to then."""

    def __init__(self, what: str, result: object = None) -> None:
        super().__init__(what)
        self.result: Any = result


class PointBroken(RunFailed):
    """Raised for the same at one of many points; the others went on."""


class RateNotFinite(RunFailed):
    """Raised if a rate is not finite, at a time and state; shape (n,), unknowns of loops included."""

    def __init__(self, what: str, time: float, state: Any, mode: Any = None) -> None:
        super().__init__(what)
        self.time, self.state, self.mode = time, state, mode

    def __reduce__(self) -> tuple[type[RateNotFinite], tuple[Any, ...], dict[str, Any]]:
        return (
            type(self),
            (str(self), self.time, self.state, self.mode),
            self.__dict__,
        )  # for the transfer between processes


class StepsCollapsed(RunFailed):
    """Raised if no step is short enough at a time and state; `ahead`: points ever further along the flow."""

    def __init__(self, what: str, time: float, state: Any, ahead: tuple[tuple[float, Any], ...], mode: Any) -> None:
        super().__init__(what)
        self.time, self.state, self.ahead, self.mode = time, state, ahead, mode

    def __reduce__(self) -> tuple[type[StepsCollapsed], tuple[Any, ...], dict[str, Any]]:
        return type(self), (str(self), self.time, self.state, self.ahead, self.mode), self.__dict__


class MissingPackage(BondgraphError, ImportError):
    """Raised if an optional package is not installed; the message says how to install it."""


class UnknownOutput(KeyError):
    """Raised if a result has no output of the requested name."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError itself would show the quoted representation of the message


class NotLossless(RunFailed):
    """Raised if an energy-conserving method was requested for a model that gains or loses energy; with time and state."""

    def __init__(self, time: float, state: Any, mode: Any) -> None:
        super().__init__(f"at t = {time:.9g} s the model gains or loses energy")
        self.time, self.state, self.mode = time, state, mode

    def __reduce__(self) -> tuple[type[NotLossless], tuple[Any, ...], dict[str, Any]]:
        return type(self), (self.time, self.state, self.mode), self.__dict__
