"""The playground: the page of a folder as files, which run in the reader's browser.

Python's side runs in a process that lacks what a browser lacks, from the archive alone. In the browser everything is real but Pyodide, whose double asks that
process. Pyodide itself is tried where PYODIDE names a folder with its files, numpy and scipy.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.presentation.page.serve import playground
from tests.compiling import MODELS, ROOT
from tests.page.test_serve import CURVE, unpacked, until

HERE = Path(__file__).parent
CLIPPER = """import Diode from electric

model Clipper {
  parameter R = 1 kohm
  input volt = 0 V
  MSe source : u = volt
  R   series : u = R*i
  Diode d
  source -> 1(series, d.pins)
  output i = series.i
  experiment sine { set volt = 2 V*sin(2*pi*50 Hz*time); simulate 0 .. 5 ms; report i in mA }
}
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A playground of three models, with the double of Pyodide."""
    folder = tmp_path_factory.mktemp("playground")
    (folder / "models").mkdir()
    for name in ("manipulator", "mems", "oscillator"):
        shutil.copy(MODELS / f"{name}.bg", folder / "models")
    (folder / "models" / "clipper.bg").write_text(CLIPPER, encoding="utf-8")
    playground.write_playground(folder / "models", folder / "site")
    (folder / "site" / "pyodide").mkdir()
    shutil.copy(HERE / "pyodide.mjs", folder / "site" / "pyodide")
    return folder


@dataclass
class Python:
    """Python in the browser, by one process for all tests. `models`: the folder of each page's models."""

    process: subprocess.Popen[str]
    models: Path

    def call(self, request: list[Any]) -> Any:
        """Answer a worker: three parts begin a page, two are a question, whose answer is status and words."""
        assert self.process.stdin is not None and self.process.stdout is not None
        if len(request) == 3:
            shutil.copytree(self.models, self.models.parent / "played", dirs_exist_ok=True)
            request = [str(self.models.parent / "played"), *request[1:]]
        print(json.dumps(request), file=self.process.stdin, flush=True)
        return json.loads(self.process.stdout.readline())

    def ask(self, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        status, words = self.call([path, None if body is None else json.dumps(body)])
        assert status == 200, words
        found: dict[str, Any] = json.loads(words)
        return found


@pytest.fixture(scope="module")
def python(site: Path) -> Iterator[Python]:
    command = [sys.executable, "-I", "-S", HERE / "without_a_machine.py", ROOT, Path(np.__file__).parents[1]]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield Python(process, site / "models")
        process.communicate(timeout=60)


def test_python_runs_from_the_archive_alone(site: Path, python: Python) -> None:
    """Checked, drawn and run without LLVM, threads and processes; the numbers are those of this process."""
    loaded = python.call(["", {}, "oscillator.bg"])
    packed = set(ZipFile(site / "site" / "packages.zip").namelist())
    for name, file in loaded.items():
        if name.split(".")[0] in (*playground.OURS, *playground.PURE) and file is not None:
            assert f"{name.replace('.', '/')}{'/__init__' if file.endswith('__init__.py') else ''}.py" in packed, name
    assert not {"llvmlite", "sympy", "click", "rich"} & set(loaded)
    state = python.ask("/changes?since=0")
    assert state["file"] == "oscillator.bg" and "<svg" in state["sections"] and not state["problems"]
    run = python.ask("/run", {"experiment": "push_it", "settings": {"k": "120 N/m"}})["run"]
    model = bondgraph.load(MODELS / "oscillator.bg")
    expected = model.simulate(settings={"k": "120 [N/m]"}, target="numpy").final("position") * 1e3
    assert unpacked(run["values"])[-1] == pytest.approx(expected, rel=1e-9)
    wrong = python.ask("/check", {"text": state["text"].replace("k*x", "z*x")})
    assert "BG" in wrong["problems"] and len(wrong["lines"]) == 1
    assert python.call(["/no", "{}"])[0] == 404 and python.call(["/run", "x"])[0] == 400
    assert python.ask("/changes?since=1") == {"version": 1} or python.ask("/changes?since=2") == {"version": 2}


def test_what_was_saved_is_there_again(python: Python) -> None:
    text = CLIPPER.replace("1 kohm", "2 kohm")
    python.call(["", {"clipper.bg": text, "mine.bg": "model Mine {\n}\n"}, "clipper.bg"])
    state = python.ask("/changes?since=1")
    assert state["text"] == text and "mine.bg" in state["files"]
    run = python.ask("/run", {"experiment": "sine", "settings": {}})["run"]
    current = unpacked(run["values"])
    # 2 V behind 2 kohm and a diode, which takes 0.6 to 0.8 V of it, and all while the voltage is small
    assert 0.6 < current[-1] < 0.7 and abs(current[: len(current) // 20]).max() < 1e-3


def test_what_is_missing_is_told(site: Path, tmp_path: Path) -> None:
    lacking = playground.missing(tmp_path)
    assert [*lacking[:4], *lacking[5:]] == [*playground.CORE, "numpy-….whl", "scipy-….whl"]
    for name in (*playground.CORE, "pyodide.asm.js", "numpy.whl"):
        (tmp_path / name).write_text("", encoding="utf-8")
    packages = {n: {"file_name": f"{n}.whl", "depends": d} for n, d in {"numpy": [], "scipy": ["numpy", "blas"], "blas": [], "other": []}.items()}  # fmt: skip
    (tmp_path / "pyodide-lock.json").write_text(json.dumps({"packages": packages}), encoding="utf-8")
    assert playground.missing(tmp_path) == ["scipy.whl", "blas.whl"]
    for broken in ("{", "[]", '{"packages": {}}'):
        (tmp_path / "pyodide-lock.json").write_text(broken, encoding="utf-8")
        assert "pyodide-lock.json" in playground.missing(tmp_path)


def test_equal_folders_have_equal_archives(site: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(commands, ["serve", str(site / "models"), "--playground", str(tmp_path / "again")])
    assert done.exit_code == 0 and "pyodide.mjs" in done.stdout and "numpy-" in done.stdout
    for name in ("packages.zip", "index.html", "worker.js"):
        assert (tmp_path / "again" / name).read_bytes() == (site / "site" / name).read_bytes(), name
    names = ZipFile(tmp_path / "again" / "packages.zip").namelist()
    assert any(n.startswith("lark-") and "LICENSE" in n for n in names)
    assert any(n.startswith("networkx-") and "LICENSE" in n for n in names)
    assert str(site) not in (tmp_path / "again" / "index.html").read_text(encoding="utf-8")


def test_refusals(site: Path, tmp_path: Path) -> None:
    (tmp_path / "other.txt").write_text("", encoding="utf-8")
    for call, advice in (
        ([str(site / "models" / "clipper.bg"), "--playground", "x"], "of a FOLDER of models"),
        ([str(tmp_path), "--playground", "x"], "of a FOLDER of models"),
        ([str(site / "models"), "--playground", str(tmp_path)], "has other files: name a new folder"),
        ([str(site / "models"), "--playground", str(tmp_path / "a" / "b")], "is no folder that can be written"),
    ):
        done = CliRunner().invoke(commands, ["serve", *call])
        assert done.exit_code == 2 and advice in done.stderr, done.stderr


# ---------------------------------------------------------------- in a browser


@pytest.fixture
def hosted(site: Path, python: Python) -> Iterator[str]:
    """A host of files, and the process behind the double."""

    class Host(SimpleHTTPRequestHandler):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments, directory=str(site / "site"))

        def do_POST(self) -> None:
            request = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            answer = json.dumps(python.call(request)).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, *arguments: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Host)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()
    thread.join()


NODES = "document.querySelectorAll('g.node').length"
NAME = "document.querySelector('h1')?.textContent"


each = pytest.mark.parametrize(("file", "name"), [("oscillator", "Oscillator"), ("clipper", "Clipper"), ("manipulator", "Manipulator")])  # fmt: skip


@pytest.mark.few(1)
@each
def test_a_model_is_drawn_and_run(hosted: str, open_page: Callable[..., Any], file: str, name: str) -> None:
    """The first picture needs no Python; nothing is asked of anybody but the host of the files."""
    drawn_and_run(hosted, open_page, file, name)


@pytest.mark.skipif("PYODIDE" not in os.environ, reason="PYODIDE names no folder with Pyodide, numpy and scipy")
@each
def test_in_pyodide_itself(hosted: str, open_page: Callable[..., Any], site: Path, file: str, name: str) -> None:
    here = (site / "site" / "pyodide").rename(site / "site" / "double")
    try:
        (site / "site" / "pyodide").symlink_to(os.environ["PYODIDE"])
        assert playground.missing(site / "site" / "pyodide") == []
        drawn_and_run(hosted, open_page, file, name, 300.0)
    finally:
        (site / "site" / "pyodide").unlink(missing_ok=True)
        here.rename(site / "site" / "pyodide")


def drawn_and_run(hosted: str, open_page: Callable[..., Any], file: str, name: str, patience: float = 60.0) -> None:
    opened = open_page(f"{hosted}#{file}.bg")
    page = opened.page
    assert page.evaluate(NODES) > 3
    until(page, f"{NAME} === {name!r} && {CURVE}", patience)
    assert page.evaluate(NODES) > 3 and page.locator("#equations math").count() > 3
    assert opened.console == [] and opened.elsewhere(hosted) == []
    assert page.inner_text("#loading") == ""


def test_a_text_is_checked_and_saved(hosted: str, open_page: Callable[..., Any], site: Path) -> None:
    page = open_page(f"{hosted}#clipper.bg").page
    until(page, f"{NAME} === 'Clipper' && {CURVE}")
    area = page.locator("textarea")
    area.fill(CLIPPER.replace("R*i", "Q*i"))
    assert "`Q`" in until(page, "document.getElementById('problems').innerText")
    area.fill(CLIPPER.replace("1 kohm", "4 kohm"))
    until(page, "document.getElementById('problems').innerText === ''")
    before = page.evaluate(CURVE)
    page.click("#bar button:has-text('Save')")
    until(page, f"{CURVE} && {CURVE} !== {before!r}")
    assert list(page.evaluate("Object.values(localStorage)")) == [CLIPPER.replace("1 kohm", "4 kohm")]


def test_what_cannot_start_says_why(hosted: str, open_page: Callable[..., Any], site: Path) -> None:
    (site / "site" / "pyodide").rename(site / "site" / "elsewhere")
    try:
        page = open_page(hosted).page
        assert "pyodide/pyodide.mjs is not beside this page" in until(page, "document.querySelector('#loading.wrong')?.innerText")  # fmt: skip
        assert page.evaluate(NODES) > 3
    finally:
        (site / "site" / "elsewhere").rename(site / "site" / "pyodide")
