"""Object code from LLVM text, compiled in a child process if it could end this one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from . import cache
from .errors import RunFailed

LONGEST_HERE = 400_000  # characters of text that are compiled in this process
PATIENCE = 300  # s: time limit of a child process

announce: Callable[[str], None] | None = None  # called with a message before work of some seconds
_WORKING: set[str] = set()  # processors for which code has been compiled here

_CHILD = """
import sys
sys.path.insert(0, {root!r})
from compiler.jit.machine import object_code
text = sys.stdin.buffer.read().decode("utf-8")
sys.stdout.buffer.write(object_code(text, {level}, {platform!r}))
"""


class CannotCompile(RunFailed):
    """Raised if LLVM cannot compile a program; the numpy target can."""


def compiled_safely(text: str, level: int) -> bytes:
    """Return the object code of a module. Raises `CannotCompile`.

    LLVM ends the process at unsupported input: therefore code for a processor that is new here, and very long functions, are compiled in a child process
    first.
    """
    from compiler.api import object_code, processor

    if len(text) > LONGEST_HERE:
        return in_child(text, level)
    key = cache.key_of("works here", processor())
    if key not in _WORKING:
        if cache.fetch(key) is not True:
            code = in_child(text, level)
            cache.keep(key, True)
            _WORKING.add(key)
            return code
        _WORKING.add(key)
    return object_code(text, level)


def compiled_for(text: str, level: int, platform: str) -> bytes:
    """Return the object code of a module for a platform of libraries, from the cache if it is there. Raises `CannotCompile`."""
    from compiler.api import LIBRARY_PLATFORMS

    key = cache.key_of("library", LIBRARY_PLATFORMS[platform], level, text)
    stored = cache.fetch(key)
    if isinstance(stored, bytes):
        return stored
    code = in_child(text, level, platform)
    cache.keep(key, code)
    return code


def kernel(name: str, text: Callable[[], str], level: int, platform: str = "") -> bytes:
    """Return the object code of a part of this package that is equal for all models, from the cache if it is there.

    `platform`: one of those that libraries are made for; this machine if there is none.
    """
    from compiler.api import processor

    key = cache.key_of("kernel", name, processor(), level, *([platform] if platform else []))
    kept = cache.fetch(key)
    if isinstance(kept, bytes):
        return kept
    if announce is not None:
        announce(f"making the machine code of the {name} for this machine, once (some seconds)")
    try:
        source = text()
    finally:
        if cache.has_changed():  # a mixture of two versions
            raise CannotCompile(
                "BR615", "no machine code is made: this package has changed since the process started", "start it again"
            )
    code = in_child(source, level, platform)
    cache.keep(key, code)
    return code


def in_child(text: str, level: int, platform: str = "") -> bytes:
    """Return the object code of a module, compiled by another process. Raises `CannotCompile`."""
    import subprocess

    root = str(Path(__file__).resolve().parent.parent)
    command = [sys.executable, "-c", _CHILD.format(root=root, level=level, platform=platform)]
    try:
        done = subprocess.run(command, input=text.encode("utf-8"), capture_output=True, timeout=PATIENCE, check=False)
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise CannotCompile("BR601", f"machine code could not be made: {problem}") from None
    if done.returncode or not done.stdout:
        told = done.stderr.decode("utf-8", "replace").strip().split("\n")[-1]
        raise CannotCompile(
            "BR601", f"machine code could not be made: {told or f'the compiler ended with {done.returncode}'}"
        )
    return done.stdout
