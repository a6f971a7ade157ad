"""Fast `dataclass`, compatible with the standard library's: methods are generated at their first call.

The standard one writes and compiles six methods of each class on import, most of which no run ever calls: that was half of the time of
importing the compiler. And its frozen `__init__` looks up and calls `object.__setattr__` for each field; here each slot is set by its own
descriptor, which takes half of the time. Fields, slots, `replace` and `match` are the standard library's, and type checkers see no difference.
"""

from __future__ import annotations

import dataclasses
from types import MemberDescriptorType
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, slots=False, eq=True, repr=True):
        """Make a dataclass. A method that the class defines is kept."""

        def made(cls):
            own = dict(vars(cls))
            cls = dataclasses.dataclass(init=False, repr=False, eq=False, slots=slots)(cls)
            for name, method in _methods(cls, frozen, slots, eq, repr).items():
                if own.get(name) is None:
                    setattr(cls, name, method)
            return cls

        return made if cls is None else made(cls)


__all__ = ["dataclass"]

_LEFT_OUT = object()


def _methods(cls: type, frozen: bool, slots: bool, eq: bool, repr: bool) -> dict[str, Any]:
    methods: dict[str, Any] = {"__init__": _later(cls, "__init__", lambda: _init(cls, frozen))}
    if repr:
        methods["__repr__"] = _told
    if eq:
        methods["__eq__"] = _later(cls, "__eq__", lambda: _eq(cls))
        methods["__hash__"] = _later(cls, "__hash__", lambda: _hash(cls)) if frozen else None
    if frozen:
        methods |= {"__setattr__": _refuse_to_set, "__delattr__": _refuse_to_delete}
    if frozen and slots:
        methods |= {"__getstate__": _state, "__setstate__": _set_state}
    return methods


def _later(cls: type, name: str, write: Callable[[], Any]) -> Callable[..., Any]:
    """A method that is generated at its first call."""

    def method(*given: Any, **named: Any) -> Any:
        written = write()
        written.__qualname__ = f"{cls.__qualname__}.{name}"
        setattr(cls, name, written)
        return written(*given, **named)

    return method


def _written(name: str, given: Sequence[str], body: Sequence[str], known: dict[str, Any]) -> Any:
    """Function compiled from source that contains only names of fields; `known` are its other names."""
    lines = [f"def made({', '.join(known)}):", f" def {name}({', '.join(given)}):", *(f"  {b}" for b in body)]
    found: dict[str, Any] = {}
    exec("\n".join([*lines, f" return {name}"]), found)
    return found["made"](**known)


def _init(cls: type, frozen: bool) -> Any:
    known: dict[str, Any] = {"left_out": _LEFT_OUT, "set_any": object.__setattr__}
    given, named, body = ["self"], list[str](), list[str]()
    for field in dataclasses.fields(cls):
        name = value = field.name
        if field.default_factory is not dataclasses.MISSING:
            known |= {f"make_{name}": field.default_factory, f"default_{name}": _LEFT_OUT}
            value = f"make_{name}() if {name} is left_out else {name}" if field.init else f"make_{name}()"
        elif field.default is not dataclasses.MISSING:
            known[f"default_{name}"] = field.default
            value = name if field.init else f"default_{name}"
        elif not field.init:
            continue  # `__post_init__` sets it
        if field.init:
            told = f"{name}=default_{name}" if f"default_{name}" in known else name
            (named if field.kw_only else given).append(told)
        slot = getattr(cls, name, None)
        if not frozen:
            body.append(f"self.{name} = {value}")
        elif isinstance(slot, MemberDescriptorType):
            known[f"set_{name}"] = slot.__set__
            body.append(f"set_{name}(self, {value})")
        else:
            body.append(f"set_any(self, {name!r}, {value})")
    body += ["self.__post_init__()"] if hasattr(cls, "__post_init__") else ["pass"] * (not body)
    return _written("__init__", [*given, *(["*"] if named else []), *named], body, known)


def _tuple(cls: type, owner: str) -> str:
    """Return the source code of a tuple of the fields that are compared."""
    return "(" + "".join(f"{owner}.{f.name}, " for f in dataclasses.fields(cls) if f.compare) + ")"


def _eq(cls: type) -> Any:
    same = f"return {_tuple(cls, 'self')} == {_tuple(cls, 'other')}"
    body = [f"if other.__class__ is self.__class__: {same}", "return NotImplemented"]
    return _written("__eq__", ("self", "other"), body, {})


def _hash(cls: type) -> Any:
    return _written("__hash__", ("self",), [f"return hash({_tuple(cls, 'self')})"], {})


def _told(self: Any) -> str:
    told = ", ".join(f"{f.name}={getattr(self, f.name)!r}" for f in dataclasses.fields(self) if f.repr)
    return f"{type(self).__qualname__}({told})"


def _refuse_to_set(self: object, name: str, value: object) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_to_delete(self: object, name: str) -> NoReturn:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


def _state(self: Any) -> list[Any]:
    return [getattr(self, f.name) for f in dataclasses.fields(self)]


def _set_state(self: Any, state: list[Any]) -> None:
    for field, value in zip(dataclasses.fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)
