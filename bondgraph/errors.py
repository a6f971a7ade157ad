"""What can go wrong outside the text of a model: in a call, in the numbers, in an installation."""

from __future__ import annotations

from typing import Any


class UsageError(Exception):
    """The call makes no sense: an unknown name, a value that cannot be; the message says what is possible."""


class RunFailed(Exception):
    """The text is fine, but the numbers failed; the message says at which time and with which quantity."""


class RateNotFinite(RunFailed):
    """A rate is no number, at a time and in a state; shape (n,), unknowns of loops included."""

    def __init__(self, what: str, time: float, state: Any) -> None:
        super().__init__(what)
        self.time, self.state = time, state


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
