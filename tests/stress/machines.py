"""8. One cache for many cold processes, a full disk at each write, a cache that somebody touched, a run that is killed."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.stress.report import Section
from tests.stress.ways import targets

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "models" / "duffing.bg"
SHORT_SIZE = 101  # bytes
CODE = "import sys; from bondgraph.commands import main; main()"


def command(*arguments: str, cache: Path, most_bytes: int | None = None) -> subprocess.Popen[str]:
    """`bondgraph …` in a process of its own, with a cache of its own; no file of it may be larger than `most_bytes`."""

    def limit() -> None:
        assert most_bytes is not None
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # then a write fails, as on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))

    environment = {**os.environ, "BONDGRAPH_CACHE": str(cache), "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", CODE, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, env=environment,
        preexec_fn=None if most_bytes is None else limit,
    )  # fmt: skip


def finished(process: subprocess.Popen[str], seconds: float = 300.0) -> tuple[int, str, str]:
    """Code, output, errors."""
    out, err = process.communicate(timeout=seconds)
    return process.returncode, out, err


def run_to(path: Path, cache: Path, **limits: Any) -> tuple[int, str]:
    """A run that writes its values: code and errors."""
    code, _, err = finished(command("run", str(MODEL), "--points", "11", "--out", str(path), cache=cache, **limits))
    return code, err


def half_written(folder: Path) -> list[str]:
    """Files that were left behind while they were written."""
    return [p.name for p in folder.rglob("*") if p.name.endswith(".part")]


def section(short: bool) -> Section:
    """Interference of processes with each other and with their files."""
    found = Section("8. Processes, disks and caches")
    with tempfile.TemporaryDirectory(prefix="bondgraph-stress-") as place:
        folder = Path(place)
        own = folder / "own"
        own.mkdir(mode=0o700)
        if short:  # the code of the solver takes long to make, and is there
            _copy(own)
        there = set(own.iterdir())
        truth = folder / "truth.csv"
        code, err = run_to(truth, own)
        if code:
            found.fail("a plain run", err)
            return found
        right = truth.read_bytes()
        if not short:
            _at_once(found, folder, right, 8)
        if "native" in targets():
            _touched(found, folder, right, short, {p for p in own.iterdir() if p not in there or not short})
        _full(found, folder, right, (SHORT_SIZE,) if short else (0, 1, 100, 1000, 5000, 20_000, 100_000, 400_000))
        if short:
            shutil.copytree(own, folder / "killed")
        _killed(found, folder, right, (0.3,) if short else (0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 5.0))
    return found


def _agree(found: Section, where: str, path: Path, right: bytes) -> None:
    found.tried += 1
    if not path.is_file():
        found.fail(where, "no result was written")
    elif path.read_bytes() != right:
        found.fail(where, "other numbers")


def _at_once(found: Section, folder: Path, right: bytes, count: int) -> None:
    """Cold processes at once on one empty cache: equal numbers, and nothing but whole entries."""
    cache = folder / "shared"
    paths = [folder / f"at_once_{i}.csv" for i in range(count)]
    running = [command("run", str(MODEL), "--points", "11", "--out", str(p), cache=cache) for p in paths]
    for process, path in zip(running, paths, strict=True):
        code, _, err = finished(process, 900.0)
        if code:
            found.fail(f"{path.stem} of {count} at once", err)
        _agree(found, f"{path.stem} of {count} at once", path, right)
    if left := half_written(cache):
        found.fail("cold processes at once", f"left behind: {left}")
    found.say(f"{count} cold processes at once on one empty cache.")


def _copy(place: Path) -> None:
    """Copy the cache of this process."""
    kept = Path(os.environ.get("BONDGRAPH_CACHE") or place)
    for path in kept.iterdir() if kept.is_dir() else ():
        if path.is_file():
            (place / path.name).write_bytes(path.read_bytes())
            (place / path.name).chmod(0o600)


def _touched(found: Section, folder: Path, right: bytes, short: bool, files: set[Path]) -> None:
    """Entries that were changed, cut, exchanged or belong to another user are computed again, and never loaded."""
    cache = folder / "own"
    kept = {p: p.read_bytes() for p in sorted(files) if p.is_file()}
    for name, change in changes(kept):
        for path, content in kept.items():
            path.write_bytes(change(path, content))
            path.chmod(0o600)
        out = folder / "touched.csv"
        out.unlink(missing_ok=True)
        code, err = run_to(out, cache)
        if code:
            found.fail(f"cache: {name}", err)
        _agree(found, f"cache: {name}", out, right)
        for path, content in kept.items():
            path.write_bytes(content)
        if short:
            break
    if not short and os.geteuid() == 0:
        for path in kept:
            os.chown(path, 65534, 65534)
        out = folder / "foreign.csv"
        code, err = run_to(out, cache)
        _agree(found, "cache: entries of somebody else", out, right)
        os.chown(cache, 65534, 65534)
        before = {p.name: p.stat().st_mtime_ns for p in cache.iterdir()}
        out = folder / "foreign_folder.csv"
        code, err = run_to(out, cache)
        _agree(found, "cache: the folder of somebody else", out, right)
        if before != {p.name: p.stat().st_mtime_ns for p in cache.iterdir()}:
            found.fail("cache: the folder of somebody else", "it was written to")
    found.say(
        f"{len(kept)} entries of a cache, all changed in one way after the other, and of another owner where this process may do that."
    )


def changes(kept: dict[Path, bytes]) -> Iterator[tuple[str, Any]]:
    """Ways to spoil entries."""
    contents = list(kept.values())
    yield "one bit in the middle", lambda p, c: c[: len(c) // 2] + bytes([c[len(c) // 2] ^ 4]) + c[len(c) // 2 + 1 :]
    yield "cut in half", lambda p, c: c[: len(c) // 2]
    yield "empty", lambda p, c: b""
    yield "entries exchanged", lambda p, c: contents[(contents.index(c) + 1) % len(contents)]
    yield "zeros", lambda p, c: bytes(len(c))
    yield "longer", lambda p, c: c + b"\0" * 100


def _full(found: Section, folder: Path, right: bytes, sizes: tuple[int, ...]) -> None:
    """No file may grow beyond a size: the cache stays without the entry, and of a result there is all or nothing."""
    for size in sizes:
        place = folder / f"full_{size}"
        place.mkdir()
        out = place / "out.csv"
        out.write_text("before")
        if size == SHORT_SIZE:
            shutil.copytree(folder / "own", place / "cache")
        code, err = run_to(out, place / "cache", most_bytes=size)
        where = f"no file larger than {size} bytes"
        found.tried += 1
        written = out.read_bytes()
        if written not in (b"before", right):
            found.fail(where, f"half a result: {len(written)} bytes of {len(right)}")
        if written == b"before" and code == 0:
            found.fail(where, "nothing was written, and the command ended well")
        if written == right and code != 0:
            found.fail(where, f"all was written, and the command ended with {code}: {err}")
        if code not in (0, 2):
            found.fail(where, f"the command ended with {code}: {err}")
        if left := half_written(place):
            found.fail(where, f"left behind: {left}")
        again = folder / f"again_{size}.csv"
        code, err = run_to(again, place / "cache")
        _agree(found, f"{where}, then a disk with room", again, right)
    found.say(
        f"A disk that is full after {', '.join(map(str, sizes))} bytes of any file (by RLIMIT_FSIZE), and the same cache with room again."
    )


def _killed(found: Section, folder: Path, right: bytes, times: tuple[float, ...]) -> None:
    """Killed at any time: the cache remains usable, and an earlier result is complete."""
    cache = folder / "killed"
    for number, seconds in enumerate(times):
        out = folder / f"killed_{number}.csv"
        out.write_text("before")
        process = command("run", str(MODEL), "--points", "11", "--out", str(out), cache=cache)
        clock.sleep(seconds)
        process.kill()
        process.communicate()
        found.tried += 1
        if out.read_bytes() not in (b"before", right):
            found.fail(f"killed after {seconds} s", "half a result")
        again = folder / f"after_{number}.csv"
        code, err = run_to(again, cache)
        if code:
            found.fail(f"after a run killed after {seconds} s", err)
        _agree(found, f"after a run killed after {seconds} s", again, right)
    found.say(f"Runs killed after {', '.join(map(str, times))} s, and the same cache used again.")
