"""Session of a file that is edited while it is viewed: its last valid page, its current errors, and runs with other values.

One task is compiled or run at a time. All numbers that can be set are arguments of one program for each experiment, so that a run with other
values needs no compilation.

A run that a slider made endless must not block all later ones. Python stops a thread by raising an exception in it, as Ctrl-C does in the main
thread; runs handle that, and leave nothing incomplete.
"""

from __future__ import annotations

import ctypes
import gc
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from compiler.api import CompilationFailed, Diagnostic, Source, examine, read_text

from ....analysed_model import AnalysedModel
from ....compiled_model import LIBRARY, most_parts
from ....errors import UsageError
from ....files import FollowedFiles
from ....simulation.settings import compiled_in
from ..certificate import problems_markup
from ..document import WORDING, Document, document_of, modes_data, text_section
from ..experiments import PROBLEMS, beside_run, experiment_data, one_run
from ..markup import preformatted, tag
from ..runs import PageModel, run_data
from ..shell import data_text
from .files import models_in, path_of, save, stamp
from .settings import base_settings, parameters_of, settings_of

EMPTY: dict[str, Any] = {
    "model": "", "parts": {"nodes": [], "lines": [], "bonds": []}, "places": [], "powers": [], "scenes": [], "experiments": [], "modes": [],
    "live": True, "parameters": [], **WORDING,
}  # fmt: skip
LOOK_EVERY = 0.15  # s between two checks of the files
LONGEST_FIRST, LONGEST = 120.0, 15.0  # s of a run that compiles, and of any other
WAITING = 0.6  # s after which a run is stopped for the next one
MOST_COMPILED = 40  # most compilations in memory


@dataclass
class Loaded:
    """A version of the model that compiles."""

    watched: PageModel
    document: Document
    files: tuple[Path, ...]
    base: dict[str, dict[str, float]] = field(default_factory=dict)  # experiment -> settings of each of its runs


@dataclass(frozen=True, slots=True)
class Text:
    """Text of the file now, what tells it from another, its errors with their lines (0: in another file), and texts that mend them."""

    text: str = ""
    stamp: str = ""
    problems: str = ""
    lines: tuple[int, ...] = ()
    corrections: Sequence[Mapping[str, object]] = ()


class Session:
    """Session of one file, or of a folder of which one file is shown. `answers`: corrections, hover, complete of the language service."""

    def __init__(
        self, path: Path, model: str | None = None, answers: Callable[[str, str, Path, int], Sequence[Mapping[str, object]]] = lambda *_: ()
    ) -> None:  # fmt: skip
        self.folder = path if path.is_dir() else None
        self.path = path if self.folder is None else path / next(iter(models_in(path)), "model.bg")
        self.model, self.answers = model, answers
        self.version = 0
        self.shown = Text()
        self.loaded: Loaded | None = None
        self.news = threading.Condition()
        self.work = threading.Lock()
        self.executor = TimedExecutor()
        self.ended = threading.Event()
        self._files = FollowedFiles()

    # ------------------------------------------------------------ the file
    def load(self) -> None:
        """Read and compile the current file; store errors for display, with the page of the last valid version."""
        with self.work:
            loaded, shown = self.loaded, Text()
            try:
                now = stamp(self.path)  # before the text: a change between both is then one that is not known
                shown = Text(read_text(self.path), now)
                loaded = self._compiled(shown.text)
            except CompilationFailed as failed:
                shown = replace(shown, **self._told(failed.diagnostics, shown.text))
            except (OSError, UnicodeDecodeError) as problem:
                shown = replace(shown, problems=tag("p", f"{self.path.name} cannot be read: {problem}"))
            except PROBLEMS as problem:
                shown = replace(shown, problems=tag("p", str(problem)))
            except Exception as problem:  # the thread that follows the file must not end silently
                kind = type(problem).__name__
                words = f"a defect of ours, not of your file ({kind}: {problem}); the page stays as it was"
                shown = replace(shown, problems=tag("p", words))
            self._look(loaded)
        with self.news:
            self.loaded, self.shown = loaded, shown
            self.version += 1
            self.news.notify_all()

    def _compiled(self, text: str) -> Loaded:
        model = AnalysedModel(Source(str(self.path), text, self.path), self.model)
        document = document_of(model, live=True)
        watched = PageModel(model)
        document.data["parameters"] = parameters_of(model)
        files = tuple(s.path for s in model.compilation().files if s.path is not None)
        _settle()
        return Loaded(watched, document, files)

    def _told(self, diagnostics: Sequence[Diagnostic], text: str) -> dict[str, Any]:
        """Return errors as the fields of a `Text`: markup, lines, corrections."""
        lines = tuple(d.span.line if d.span.source.path == self.path else 0 for d in diagnostics)
        return {
            "problems": problems_markup(tuple(diagnostics)), "lines": lines, "corrections": self.answers("corrections", text, self.path, 0),
        }  # fmt: skip

    def _look(self, loaded: Loaded | None) -> bool:
        """Return True if a file has changed since the last check."""
        return self._files.changed({self.path, *(loaded.files if loaded is not None else ())})

    def watch(self) -> None:
        """Follow the files until the session ends."""
        while not self.ended.wait(LOOK_EVERY):
            if self._look(self.loaded):
                self.load()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files that can be opened."""
        return models_in(self.folder) if self.folder is not None else (self.name,)

    @property
    def name(self) -> str:
        return self.path.name if self.folder is None else self.path.relative_to(self.folder).as_posix()

    def open(self, name: str) -> str:
        """Go to another file of the folder. Raises `UsageError`."""
        path = self._path(name)
        with self.work:
            self.path, self.loaded, self.model = path, None, None
        self.load()
        return data_text({"file": self.name})

    def save(self, name: str, text: str, before: str) -> str:
        """Write a file whose stamp was `before`, and show it. Raises `UsageError`, OSError."""
        path = self._path(name)
        with self.work:
            present = save(path, text, before)
        if present == before:
            self.open(name) if path != self.path else self.load()
        return data_text({"saved": present == before, "stamp": present})

    def _path(self, name: str) -> Path:
        if self.folder is None and name != self.path.name:
            raise UsageError("BR946", "this page is about one file;", "`bondgraph serve FOLDER` shows all of a folder")
        return self.path if self.folder is None else path_of(self.folder, name)

    def check(self, text: str) -> str:
        """Return the errors of a text that stands in place of the file, as JSON."""
        errors, _ = examine(Source(str(self.path), text, self.path), None, LIBRARY, most_parts())
        return data_text(self._told(errors, text) if errors else {"problems": "", "lines": (), "corrections": ()})

    def answer(self, question: str, text: str, at: int) -> str:
        """Return what is known about a character of a text that stands in place of the file, as JSON."""
        return data_text(self.answers(question, text, self.path, at))

    # ------------------------------------------------------------ what pages ask
    def page(self) -> Document:
        """Return the first contents of a page."""
        with self.news:
            document, state = self._document(), self._state()
        return Document(document.title, document.sections, {**document.data, **state})

    def _document(self) -> Document:
        """Return the page of the last valid version; of a file without one its text alone."""
        if self.loaded is not None:
            return self.loaded.document
        return Document(self.path.name, text_section([Source(str(self.path), self.shown.text, self.path)]), EMPTY)

    def _state(self) -> dict[str, Any]:
        return {"version": self.version, "file": self.name, "files": self.names, **asdict(self.shown)}

    def change(self, since: int, patience: float) -> str:
        """Return the state after a version, as JSON; the current state if no change comes within `patience` seconds."""
        with self.news:
            self.news.wait_for(lambda: self.version != since or self.ended.is_set(), patience)
            state, document = self._state(), self._document()
            if self.version == since:
                return data_text({"version": since})
            if self.loaded is None or not self.shown.problems:
                state |= {"title": document.title, "sections": document.sections, "data": document.data}
        return data_text(state)

    def run(self, experiment: str, texts: Mapping[str, str | float]) -> str:
        """Run an experiment with some values; return JSON. Raises `UsageError` for names that the model does not have."""
        with self.work:
            loaded = self._checked(experiment)
            parameters = loaded.document.data["parameters"]
            settings, shown, wrong = settings_of(parameters, texts)
            if wrong:
                return data_text({"kind": "unread", "wrong": wrong})
            longest = LONGEST if experiment in loaded.base else LONGEST_FIRST
            try:
                found = self.executor.within(longest, lambda: _run(loaded, experiment, settings))
            except Stopped as stopped:
                words = f"{stopped}: no curve within {longest:g} s, or another was asked for"
                found = {"name": experiment, "kind": "failed", "told": preformatted(words.lstrip(": "))}
            return data_text(found | {"set": shown})

    def stop(self) -> str:
        """Stop a run that lasts longer than a user waits who has moved the slider again."""
        return data_text({"stopped": self.executor.stop(WAITING)})

    def modes(self) -> str:
        """Return the modes, as JSON."""
        with self.work:
            version = self.version
            try:
                found = modes_data(self.loaded.watched) if self.loaded is not None else []
            except PROBLEMS:
                found = []
            return data_text({"version": version, "modes": found})

    def _checked(self, experiment: str) -> Loaded:
        if self.loaded is None:
            raise UsageError("BR921", "there is no model yet")
        if experiment not in self.loaded.watched.model.experiments:
            raise UsageError("BR922", "there is no such experiment")
        return self.loaded


def _run(loaded: Loaded, experiment: str, settings: Mapping[str, float]) -> dict[str, Any]:
    watched = loaded.watched
    if watched.model.compiled > MOST_COMPILED:  # values that decide more than numbers are compiled in, one by one
        watched.model.forget()
    try:
        if not one_run(watched, experiment):
            return experiment_data(watched, experiment, settings=settings)
        first = experiment not in loaded.base
        if first:
            loaded.base[experiment] = base_settings(watched.model, experiment)
        before = watched.model.compiled
        try:
            result = watched.simulate(experiment, {**loaded.base[experiment], **settings})
        except PROBLEMS:
            if not loaded.base[experiment]:
                raise
            loaded.base[experiment] = {}  # settings that cannot be arguments are compiled in
            result = watched.simulate(experiment, settings)
        if first or not set(settings) <= set(loaded.base[experiment]):
            _settle()
        told = run_data(watched, experiment, result)
        if not first and watched.model.compiled > before:
            told["notes"] += _compiled_in(watched.model, experiment, settings)
        return {"name": experiment, "kind": "run", "run": told, "told": beside_run(watched, experiment, settings)}
    except PROBLEMS as problem:
        return {"name": experiment, "kind": "failed", "told": preformatted(str(problem))}


def _compiled_in(model: AnalysedModel, experiment: str, settings: Mapping[str, float]) -> list[str]:
    """Return notes on values that must be compiled in, which takes longer."""
    why = compiled_in(model, experiment, settings, settings)
    return [
        f"`{name}` is compiled in, which takes longer: more than numbers go with it in {place}"
        for name, place in why.items()
    ]


def _settle() -> None:
    """Exclude compiled objects from garbage collection: examining them would make every tenth run slow."""
    gc.enable()
    gc.collect()
    gc.freeze()


class Stopped(Exception):
    """Raised if the work was stopped before its end."""


class TimedExecutor:
    """Executor of one task at a time, with a time limit."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._thread: int | None = None
        self._began = 0.0

    def within(self, seconds: float, work: Callable[[], Any]) -> Any:
        """Return the result of some work. Raises `Stopped` after `seconds`."""
        timer = threading.Timer(seconds, self.stop)
        timer.daemon = True
        try:
            with self._guard:
                self._thread, self._began = threading.get_ident(), time.monotonic()
            with suppress(RuntimeError):  # no thread can start in a browser: no limit there
                timer.start()
            try:
                return work()
            finally:
                with self._guard:
                    self._thread = None
        except KeyboardInterrupt as stopped:
            raise Stopped(str(stopped)) from None
        finally:
            timer.cancel()

    def stop(self, longer_than: float = 0.0) -> bool:
        """Stop the current task if it has run for `longer_than` seconds; return True if there was one."""
        with self._guard:
            if self._thread is None or time.monotonic() - self._began < longer_than:
                return False
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(self._thread), ctypes.py_object(KeyboardInterrupt)
            )
            return True
