"""Arrays and records that functions of the subset write to, so that the others are constants in C."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Sequence, Set
from typing import Any

from .source import is_declared, tree_of

Function = Callable[..., Any]


READ = {"source", "text"}  # arguments that functions of C do not write to


class Stores:
    """Syntax trees of all functions that some call, and the names of arguments and variables to which each writes."""

    def __init__(self, exported: Sequence[Function], left_out: Set[Function]) -> None:
        self.trees: dict[Function, ast.FunctionDef] = {}
        self.names: dict[Function, set[str]] = {}
        # Pairs of a function and a name: the second is written to if the first is.
        self.follows: dict[tuple[Function, str], list[tuple[Function, str]]] = {}
        self.waiting = list(exported)
        while self.waiting:
            function = self.waiting.pop()
            if function not in self.trees and function not in left_out:
                self.names.setdefault(function, set())
                self.trees[function] = tree_of(function)
                self._read(function, self.trees[function])

        words = {f.__name__ for f in self.trees}
        for function, tree in self.trees.items():
            _rename(tree, words, function.__globals__)

    def written(self, function: Function) -> set[str]:
        """Names to which a function writes, also those that were renamed."""
        return self.names[function] | {f"{name}_" for name in self.names[function]}

    def _read(self, function: Function, tree: ast.FunctionDef) -> None:
        home, called = function.__globals__, set[ast.expr]()
        for node in ast.walk(tree):
            match node:
                case ast.Assign(targets=[target], value=value):
                    of = target.value if isinstance(target, ast.Subscript | ast.Attribute) else None
                    self._write(function, _roots(of) if of is not None else set())
                    for name in _roots(value):
                        if isinstance(target, ast.Name):
                            self._follow((function, target.id), (function, name))
                        else:
                            self._write(function, {name})
                case ast.AugAssign(target=ast.Subscript(value=of) | ast.Attribute(value=of)):
                    self._write(function, _roots(of))
                case ast.Call(func=ast.Name(id=word) as callee, args=arguments) if inspect.isfunction(
                    meant := home.get(word)
                ):
                    called.add(callee)
                    if is_declared(meant):
                        self._write(meant, set(inspect.signature(meant).parameters) - READ)
                    else:
                        self.waiting.append(meant)
                    for argument, value in zip(inspect.signature(meant).parameters, arguments, strict=True):
                        for name in _roots(value):
                            self._follow((meant, argument), (function, name))
                case ast.Call(func=ast.Name(id="id")):
                    pass  # an address as a number
                case ast.Call(args=arguments):
                    called.add(node.func)
                    self._write(function, {name for value in arguments for name in _roots(value)})
                case ast.Name(id=word) if (
                    node not in called
                ):  # as a value, or one of several: all of these have one type
                    meant = home.get(word)
                    for one in meant if isinstance(meant, tuple) else (meant,):
                        if inspect.isfunction(one) and not is_declared(one):
                            self.waiting.append(one)
                            self._write(one, set(inspect.signature(one).parameters))

    def _follow(self, first: tuple[Function, str], then: tuple[Function, str]) -> None:
        self.follows.setdefault(first, []).append(then)
        if first[1] in self.names.get(first[0], ()):
            self._write(then[0], {then[1]})

    def _write(self, function: Function, names: set[str]) -> None:
        meant = self.names.setdefault(function, set())
        for name in names - meant:
            meant.add(name)
            for then, other in self.follows.get((function, name), ()):
                self._write(then, {other})


def _rename(tree: ast.FunctionDef, words: set[str], home: dict[str, Any]) -> None:
    """Give arguments and variables other names than those of functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.arg) and node.arg in words:
            node.arg += "_"
        elif isinstance(node, ast.Name) and node.id in words and not inspect.isfunction(home.get(node.id)):
            node.id += "_"


def _roots(node: ast.expr) -> set[str]:
    """Names of which an expression may be the address."""
    match node:
        case ast.Name(id=name):
            return {name}
        case ast.Subscript(value=array, slice=ast.Slice()):
            return _roots(array)
        case ast.IfExp(body=body, orelse=other):
            return _roots(body) | _roots(other)
    return set()
