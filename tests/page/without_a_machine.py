"""A process that lacks what Python in a browser lacks, and answers a page: `python -I -S FILE ROOT ELSEWHERE`, requests and answers as lines of JSON.

There are no threads, no copies of the process, no other programs, no LLVM, no name of the user, and not all modules of the standard library. ELSEWHERE
has the packages that a playground or Pyodide brings; no other is found there.
"""

from __future__ import annotations

import importlib.machinery
import json
import os
import subprocess
import sys
import threading
import time
from typing import Any, NoReturn

REMOVED = {"_multiprocessing", "_posixshmem", "curses", "dbm", "fcntl", "grp", "lzma", "pwd", "resource", "sqlite3", "ssl", "termios"}  # fmt: skip


def absent(*arguments: object, **named: object) -> NoReturn:
    raise RuntimeError("can't start new thread")


class Brought:
    """Some packages of another folder, and nothing else of it; no module that Pyodide has removed."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: object = None) -> Any:
        if name in REMOVED:
            raise ModuleNotFoundError(f"no module {name}", name=name)
        if name.split(".")[0] in ("numpy", "scipy", "lark", "networkx"):
            return importlib.machinery.PathFinder.find_spec(name, path or [sys.argv[2]])
        return None


def main() -> None:
    sys.path.insert(0, sys.argv[1])
    sys.meta_path.insert(0, Brought)
    threading.Thread.start = absent
    subprocess.Popen.__init__ = absent
    for name in ("fork", "geteuid", "posix_spawn"):
        if hasattr(os, name):
            delattr(os, name)
    del time.thread_time
    from bondgraph.presentation.page.serve.playground import answers_of

    answer: Any = None
    for line in sys.stdin:
        given = json.loads(line)
        if len(given) == 3:  # folder, saved texts, file: a page begins
            answer = answers_of(*given)
            found: object = {name: getattr(module, "__file__", None) for name, module in sys.modules.items()}
        else:
            found = answer(*given)
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
