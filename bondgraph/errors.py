"""What can go wrong outside the text of a model: in a call, in the numbers, in an installation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .results import Result


class UsageError(Exception):
    """The call makes no sense: an unknown name, a value that cannot be; the message says what is possible."""


class ManyRuns(UsageError):
    """An experiment that is more than one run, or none: `Model.run` does what it says."""


class RunFailed(Exception):
    """The text is fine, but the numbers failed; the message says at which time and with which quantity.

    `result` is what was computed up to then, if the run had begun.
    """

    result: Result | None = None


class RunInterrupted(KeyboardInterrupt):
    """Somebody pressed Ctrl-C while a run was on its way; `result` is what was computed up to then."""

    def __init__(self, what: str, result: Result) -> None:
        super().__init__(what)
        self.result = result

    def __reduce__(self) -> tuple[type[RunInterrupted], tuple[Any, ...]]:
        return type(self), (str(self), self.result)


class RunBroken(Exception):
    """Something of ours, or of the machine, gave way in the middle of a run; `result` is what was computed up to then."""

    def __init__(self, what: str, result: Result | None = None) -> None:
        super().__init__(what)
        self.result = result


class PointBroken(RunFailed):
    """The same at one of many points, which did not end the others."""


class RateNotFinite(RunFailed):
    """A rate is no number, at a time and in a state; shape (n,), unknowns of loops included."""

    def __init__(self, what: str, time: float, state: Any, mode: Any = None) -> None:
        super().__init__(what)
        self.time, self.state, self.mode = time, state, mode

    def __reduce__(self) -> tuple[type[RateNotFinite], tuple[Any, ...], dict[str, Any]]:
        return (
            type(self),
            (str(self), self.time, self.state, self.mode),
            self.__dict__,
        )  # as it goes from one process to another


class StepsCollapsed(RunFailed):
    """No step is short enough at a time and in a state; `ahead`: where the flow leads from there, ever further."""

    def __init__(self, what: str, time: float, state: Any, ahead: tuple[tuple[float, Any], ...], mode: Any) -> None:
        super().__init__(what)
        self.time, self.state, self.ahead, self.mode = time, state, ahead, mode

    def __reduce__(self) -> tuple[type[StepsCollapsed], tuple[Any, ...], dict[str, Any]]:
        return type(self), (str(self), self.time, self.state, self.ahead, self.mode), self.__dict__


class MissingPackage(ImportError):
    """An optional package is not installed; the message says how to get it."""


class UnknownOutput(KeyError):
    """A result was asked for a name that it does not have."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError itself would show the quoted representation of the message


class NotLossless(RunFailed):
    """A method that keeps the energy was asked for, and the model gains or loses some: when and where."""

    def __init__(self, time: float, state: Any, mode: Any) -> None:
        super().__init__(f"at t = {time:.9g} s the model gains or loses energy")
        self.time, self.state, self.mode = time, state, mode

    def __reduce__(self) -> tuple[type[NotLossless], tuple[Any, ...], dict[str, Any]]:
        return type(self), (self.time, self.state, self.mode), self.__dict__
