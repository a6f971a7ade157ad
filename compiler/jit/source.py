"""Syntax trees of imported functions."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from types import CodeType
from typing import Any

from .kinds import TranslationError


def tree_of(function: Callable[..., Any]) -> ast.FunctionDef:
    """Syntax tree of a function. Raises `TranslationError` if lines of its file have moved since it was imported, or its names or numbers changed."""
    code = function.__code__
    try:
        module = ast.parse(inspect.getsource(function))
        codes = [c for c in compile(module, "", "exec").co_consts if isinstance(c, CodeType)]
    except (OSError, SyntaxError):
        codes = []
    if not any(c.co_name == code.co_name and _content(c) == _content(code) for c in codes):
        raise TranslationError(f"`{code.co_filename}` has changed since this process imported it: start it again")
    tree = module.body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree


def is_declared(function: Callable[..., Any]) -> bool:
    """Return True for a function of a library of C: its body in Python raises `NotImplementedError` alone."""
    return function.__code__.co_names == ("NotImplementedError",)


def _content(code: CodeType) -> tuple[object, ...]:
    numbers = tuple(c for c in code.co_consts if not isinstance(c, CodeType))
    return numbers, code.co_names, code.co_varnames, code.co_argcount
