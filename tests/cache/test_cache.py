"""Cache of compilations: stored safely, used only if its content is valid, and without results of runs."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import bondgraph
from bondgraph import cache, native
from bondgraph.errors import RunFailed
from tests.compiling import MODELS, ROOT

pytest.importorskip("llvmlite")
pytestmark = pytest.mark.machine_code
HEAVY = ("sympy", "scipy", "lark", "networkx")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "kept"
    monkeypatch.setenv(cache.VARIABLE, str(place))
    return place


@pytest.fixture(scope="module")
def kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that keeps what is compiled once for all models, so that not each test compiles it."""
    return tmp_path_factory.mktemp("kernels") / "kept"


class TestEntries:
    def test_what_is_kept_comes_back(self, folder: Path) -> None:
        key = cache.key_of("a", b"b", 3)
        assert cache.fetch(key) is None
        cache.keep(key, {"codes": (b"xyz",), "path": Path("here")})
        assert cache.fetch(key) == {"codes": (b"xyz",), "path": Path("here")}
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700 and [p.name for p in folder.iterdir()] == [key]

    def test_parts_of_a_key_do_not_run_into_each_other(self) -> None:
        assert (
            len({cache.key_of("ab", "c"), cache.key_of("a", "bc"), cache.key_of("abc"), cache.key_of("abc", "")}) == 4
        )

    @pytest.mark.parametrize("place", [0, 20, 60, -1])
    def test_one_changed_byte_is_seen(self, folder: Path, place: int) -> None:
        key = cache.key_of("changed")
        cache.keep(key, list(range(1000)))
        content = bytearray((folder / key).read_bytes())
        content[place] ^= 1
        (folder / key).write_bytes(bytes(content))
        assert cache.fetch(key) is None

    def test_a_cut_entry_and_that_of_another_key_are_seen(self, folder: Path) -> None:
        key, other = cache.key_of("one"), cache.key_of("two")
        cache.keep(key, list(range(1000)))
        content = (folder / key).read_bytes()
        (folder / other).write_bytes(content)
        assert cache.fetch(other) is None
        (folder / key).write_bytes(content[:100])
        assert cache.fetch(key) is None

    def test_nothing_but_our_nouns_is_made(self, folder: Path) -> None:
        key = cache.key_of("foreign")
        cache.keep(key, subprocess.Popen)
        assert (folder / key).is_file() and cache.fetch(key) is None

    @pytest.mark.skipif(os.name != "posix", reason="permissions")
    def test_what_others_could_write_is_not_trusted(self, folder: Path) -> None:
        key = cache.key_of("open")
        cache.keep(key, 1)
        (folder / key).chmod(0o666)
        assert cache.fetch(key) is None
        (folder / key).chmod(0o600)
        assert cache.fetch(key) == 1
        folder.chmod(0o777)
        assert cache.fetch(key) is None

    @pytest.mark.skipif(os.name != "posix", reason="links")
    def test_a_link_is_no_folder(self, folder: Path, tmp_path: Path) -> None:
        (tmp_path / "elsewhere").mkdir()
        folder.symlink_to(tmp_path / "elsewhere")
        cache.keep(cache.key_of("x"), 1)
        assert list((tmp_path / "elsewhere").iterdir()) == []

    def test_a_place_that_cannot_be_is_as_good_as_none(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "file").write_text("")
        for place in (str(tmp_path / "file" / "kept"), ""):
            monkeypatch.setenv(cache.VARIABLE, place)
            cache.keep(cache.key_of("x"), 1)
            assert cache.fetch(cache.key_of("x")) is None

    def test_many_at_once(self, folder: Path) -> None:
        key = cache.key_of("many")

        def write(number: int) -> bool:
            cache.keep(key, [number] * 5000)
            found = cache.fetch(key)
            return isinstance(found, list) and len(set(found)) == 1

        with ThreadPoolExecutor(8) as pool:
            assert all(pool.map(write, range(100)))
        assert [p.name for p in folder.iterdir()] == [key]

    def test_what_was_not_used_for_longest_goes_first(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        keys = [cache.key_of(i) for i in range(8)]
        for age, key in enumerate(keys):
            cache.keep(key, b"x" * 1000)
            os.utime(folder / key, (age, age))
        assert cache.fetch(keys[0]) is not None  # used just now
        monkeypatch.setattr(cache, "MOST_BYTES", 8500)
        cache.keep(cache.key_of("new"), b"x" * 1000)
        assert (
            cache.fetch(keys[0]) is not None
            and cache.fetch(keys[1]) is None
            and cache.fetch(cache.key_of("new")) is not None
        )

    def test_a_process_does_not_look_through_all_for_each_entry(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        looks: list[Path] = []
        monkeypatch.setattr(cache.os, "scandir", lambda path, scan=os.scandir: looks.append(path) or scan(path))
        for i in range(20):
            cache.keep(cache.key_of(i), b"x" * (cache.MOST_BYTES // 1000))
        assert len(looks) == 2  # at first, and once for what is a hundredth of the room


class TestChildren:
    def test_what_takes_seconds_is_told_once(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        told: list[str] = []
        monkeypatch.setattr(native, "announce", told.append)
        text = "define double @f(double %x) {\n  ret double %x\n}\n"
        assert native.kernel("squares", lambda: text, 0) == native.kernel("squares", lambda: text, 0)
        assert told == ["making the machine code of the squares for this machine, once (some seconds)"]

    def test_what_cannot_be_compiled_is_told_and_harms_nobody(self) -> None:
        with pytest.raises(native.CannotCompile, match="could not be made"):
            native.in_child("this is no module", 1)
        assert issubclass(native.CannotCompile, RunFailed)

    def test_files_that_have_changed_are_not_compiled(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Else this process would run a mixture of two versions, and others would find it under the name of the first."""
        cache.code_version()
        monkeypatch.setattr(cache, "PACKAGES", ("bondgraph",))
        with pytest.raises(native.CannotCompile, match="start it again"):
            native.kernel("squares", lambda: "", 0)
        assert not list(folder.iterdir())

    def test_the_first_code_and_long_code_are_made_in_a_child(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        text = "define double @f(double %x) {\n  ret double %x\n}\n"
        asked: list[int] = []
        original = native.in_child
        monkeypatch.setattr(native, "_WORKING", set())
        monkeypatch.setattr(native, "in_child", lambda text, level: asked.append(level) or original(text, level))
        native.compiled_safely(text, 0)
        native.compiled_safely(text, 1)
        monkeypatch.setattr(native, "LONGEST_HERE", 10)
        native.compiled_safely(text, 2)
        assert asked == [0, 2]

    def test_without_code_there_is_numpy(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def fails(text: str, level: int) -> bytes:
            raise native.CannotCompile("BR850", "no")

        monkeypatch.setattr(native, "compiled_safely", fails)
        assert bondgraph.load(MODELS / "duffing.bg").simulate().solver == "Dormand-Prince 8, numpy"


def whole_run(folder: Path, *arguments: str) -> tuple[str, set[str]]:
    """The output of a command in a process of its own, and the heavy packages that it loaded."""
    code = f"import sys, atexit\natexit.register(lambda: print('LOADED', *[m for m in {HEAVY!r} if m in sys.modules]))\nfrom bondgraph.commands import main\nmain()"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        env={**os.environ, cache.VARIABLE: str(folder)},
    )
    text, _, loaded = done.stdout.rpartition("LOADED")
    return text.split("took")[0], set(loaded.split())


def test_a_run_of_the_manipulator_loads_little(kernels: Path) -> None:
    """Masked arrays and random numbers, which numpy loads on demand, each cost a tenth of the whole process."""
    whole_run(kernels, "run", "models/manipulator.bg")
    code = "import sys\nfrom bondgraph.commands import commands\ncommands.main(['run', 'models/manipulator.bg'], standalone_mode=False)\nprint('LOADED', *sys.modules)"
    environment = {**os.environ, cache.VARIABLE: str(kernels)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, env=environment
    )
    loaded = set(done.stdout.rpartition("LOADED")[2].split())
    assert "numpy" in loaded and not loaded & {
        "numpy.ma",
        "numpy.random",
        "rich",
        "multiprocessing",
        "subprocess",
        *HEAVY,
    }
    stages = {".".join(m.split(".")[:2]) for m in loaded if m.startswith("compiler.")}
    known = (
        "algebra",
        "api",
        "certificate",
        "codegen",
        "errors",
        "arrays",
        "fast_dataclass",
        "jit",
        "solvers",
        "persistent_cache",
        "scene",
        "source",
        "source_file",
    )
    assert stages <= {
        f"compiler.{m}" for m in known
    }  # algebra: ranges of functions of time, between whose zeros a run is cut


@pytest.mark.parametrize("model", ["manipulator.bg", "oscillator.bg", "drag.bg"])
def test_a_run_of_a_model_seen_before_loads_no_stage_of_the_compiler(kernels: Path, model: str) -> None:
    first, _ = whole_run(kernels, "run", f"models/{model}")
    again, loaded = whole_run(kernels, "run", f"models/{model}")
    assert again == first and loaded == set()


def entries(folder: Path) -> int:
    return len(list(folder.iterdir()))


class TestPrograms:
    TEXT = 'import Spring from "parts.bg"\nmodel A {\nSpring s\nI mass : p = 1 kg*v { start v = 1 [m/s] }\ns.end -> mass\noutput x = s.k.x\nexperiment e { simulate 0 .. 1 s }\n}\n'
    PARTS = "model Spring {\nport end : translation\nC k : F = %s [N/m]*x\nend -> k\n}\n"

    def run(self, place: Path, **settings: object) -> float:
        return bondgraph.load(place / "a.bg").simulate(target="native", **settings).final("x")  # type: ignore[arg-type]

    def test_what_is_kept_belongs_to_texts_scenes_and_imports(self, folder: Path, tmp_path: Path) -> None:
        text = self.TEXT.replace("s.end -> mass", "1 body\nbody -> mass\nbody -> s.end")
        (tmp_path / "a.bg").write_text(text)
        (tmp_path / "parts.bg").write_text(self.PARTS % 4)
        first = self.run(tmp_path)
        count = entries(folder)
        assert self.run(tmp_path) == first and entries(folder) == count
        (tmp_path / "parts.bg").write_text(self.PARTS % 9)
        second = self.run(tmp_path)
        assert abs(second) != pytest.approx(abs(first), rel=0.1)
        assert self.run(tmp_path, settings={"mass.v": 2.0} if False else None) == second
        (tmp_path / "a.bg").write_text(text.replace("1 [m/s]", "2 [m/s]"))
        assert self.run(tmp_path) == pytest.approx(2 * second)

    def test_no_result_is_kept(self, folder: Path) -> None:
        model = MODELS / "rlc.bg"
        bondgraph.load(model).simulate(target="native")
        count = entries(folder)
        for points in (5, 50):
            assert (
                len(bondgraph.load(model).simulate(target="native", points=points, rtol=1e-8, to=0.01).time) == points
            )
        assert entries(folder) == count
