"""Session of a file that is edited while it is viewed: its last valid page, its current errors, and runs with other values.

One task is compiled or run at a time. All numbers that can be set are arguments of one program for each experiment, so that a run with other
values needs no compilation.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from compiler.api import CompilationFailed, Source, read_text

from ....analysed_model import AnalysedModel
from ....errors import UsageError
from ....files import FollowedFiles
from ..certificate import problems_markup
from ..document import Document, document_of
from ..experiments import PROBLEMS, experiment_data, one_run
from ..markup import Html, tag
from ..runs import PageModel, run_data
from ..shapes import modes_data
from ..shell import data_text
from .cancellation import Stopped, TimedExecutor
from .settings import base_settings, parameters_of

EMPTY: dict[str, Any] = {
    "model": "", "parts": {"nodes": [], "lines": [], "bonds": []}, "places": [], "powers": [], "scenes": [], "experiments": [], "modes": [],
    "live": True, "parameters": [],
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


class Session:
    """Session of one file."""

    def __init__(self, path: Path, model: str | None = None) -> None:
        self.path, self.model = path, model
        self.version = 0
        self.problems = Html("")
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
            loaded, problems = self.loaded, Html("")
            try:
                loaded = self._compiled()
            except CompilationFailed as failed:
                problems = problems_markup(failed.diagnostics)
            except (OSError, UnicodeDecodeError) as problem:
                problems = tag("p", f"{self.path.name} cannot be read: {problem}")
            except PROBLEMS as problem:
                problems = tag("p", str(problem))
            except Exception as problem:  # the thread that follows the file must not end silently
                kind = type(problem).__name__
                problems = tag("p", f"a defect of ours, not of your file ({kind}: {problem}); the page stays as it was")
            self._look(loaded)
        with self.news:
            self.loaded, self.problems = loaded, problems
            self.version += 1
            self.news.notify_all()

    def _compiled(self) -> Loaded:
        text = read_text(self.path)
        model = AnalysedModel(Source(str(self.path), text, self.path), self.model)
        document = document_of(model, live=True)
        watched = PageModel(model)
        document.data["parameters"] = parameters_of(model)
        files = tuple(s.path for s in model.compilation().files if s.path is not None)
        _settle()
        return Loaded(watched, document, files)

    def _look(self, loaded: Loaded | None) -> bool:
        """Return True if a file has changed since the last check."""
        return self._files.changed({self.path, *(loaded.files if loaded is not None else ())})

    def watch(self) -> None:
        """Follow the files until the session ends."""
        while not self.ended.wait(LOOK_EVERY):
            if self._look(self.loaded):
                self.load()

    # ------------------------------------------------------------ what pages ask
    def page(self) -> Document:
        """Return the first contents of a page."""
        with self.news:
            loaded, problems, version = self.loaded, self.problems, self.version
        found = loaded.document if loaded is not None else Document(self.path.name, Html(""), EMPTY)
        return Document(found.title, found.sections, {**found.data, "version": version, "problems": problems})

    def change(self, since: int, patience: float) -> str:
        """Return the state after a version, as JSON; the current state if no change comes within `patience` seconds."""
        with self.news:
            self.news.wait_for(lambda: self.version != since or self.ended.is_set(), patience)
            loaded, problems, version = self.loaded, self.problems, self.version
        told: dict[str, Any] = {"version": version, "problems": problems}
        if version != since and loaded is not None and not problems:
            told |= {
                "title": loaded.document.title,
                "sections": loaded.document.sections,
                "data": {**loaded.document.data, "version": version},
            }
        return data_text(told)

    def run(self, experiment: str, settings: Mapping[str, float]) -> str:
        """Run an experiment with some values; return JSON. Raises `UsageError` for names that the model does not have."""
        with self.work:
            loaded = self._checked(experiment, settings)
            longest = LONGEST if experiment in loaded.base else LONGEST_FIRST
            try:
                found = self.executor.within(longest, lambda: _run(loaded, experiment, settings))
            except Stopped as stopped:
                words = f"{stopped}: no curve within {longest:g} s, or another was asked for"
                found = {"name": experiment, "kind": "failed", "told": tag("pre", words.lstrip(": "))}
            return data_text(found)

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

    def _checked(self, experiment: str, settings: Mapping[str, float]) -> Loaded:
        if self.loaded is None:
            raise UsageError("BR921", "there is no model yet")
        if experiment not in self.loaded.watched.model.experiments:
            raise UsageError("BR922", "there is no such experiment")
        known = {p["name"] for p in self.loaded.document.data["parameters"]}
        if not set(settings) <= known:
            raise UsageError("BR923", "there is no such parameter")
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
        return {"name": experiment, "kind": "run", "run": told, "told": ""}
    except PROBLEMS as problem:
        return {"name": experiment, "kind": "failed", "told": tag("pre", str(problem))}


def _compiled_in(model: AnalysedModel, experiment: str, settings: Mapping[str, float]) -> list[str]:
    """Return notes on values that must be compiled in, which takes longer."""
    from ....simulation.settings import compiled_in

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
