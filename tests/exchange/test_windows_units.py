"""Units for Windows: their libraries run on Linux by the conventions of Windows, and give the bits of the libraries of Linux; one under Wine."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.exchange.functions import TYPES, VERSIONS
from compiler.errors import CompilationFailed
from compiler.jit.machine import object_code
from compiler.linking.layout import SharedLibrary
from compiler.linking.link import link
from tests.event_models import BALL
from tests.exchange.unit_files import FMICallException, instance, read_model_description, run
from tests.linking.windows_loader import called, here, loaded, needs_wine, under_wine

pytestmark = pytest.mark.machine_code
MODELS = Path(__file__).resolve().parents[2] / "models"
KINDS = ("ModelExchange", "CoSimulation")
FOLDERS = {"2": ("linux64", "win64"), "3": ("x86_64-linux", "x86_64-windows")}
# The importer's function for messages has the convention of Linux: it is called by one of Windows that takes its place.
LOGGERS = {
    "2": """@logger = internal global ptr null
@callbacks = internal global [5 x ptr] zeroinitializer
define internal win64cc void @log(ptr %env, ptr %name, i32 %level, ptr %category, ptr %text) {
  %f = load ptr, ptr @logger
  call void (ptr, ptr, i32, ptr, ptr, ...) %f(ptr %env, ptr %name, i32 %level, ptr %category, ptr %text)
  ret void
}
define internal ptr @own(ptr %given) {
  %f = load ptr, ptr %given
  store ptr %f, ptr @logger
  store ptr @log, ptr @callbacks
  %from = getelementptr ptr, ptr %given, i64 4
  %env = load ptr, ptr %from
  %to = getelementptr ptr, ptr @callbacks, i64 4
  store ptr %env, ptr %to
  ret ptr @callbacks
}
""",
    "3": """@logger = internal global ptr null
define internal win64cc void @log(ptr %env, i32 %level, ptr %category, ptr %text) {
  %f = load ptr, ptr @logger
  call void %f(ptr %env, i32 %level, ptr %category, ptr %text)
  ret void
}
define internal ptr @own(ptr %given) {
  store ptr %given, ptr @logger
  ret ptr @log
}
""",
}


def bridge(fmi: str, addresses: dict[str, int]) -> bytes:
    """A library of Linux whose functions call those at some addresses by the convention of Windows."""
    version, rows = VERSIONS[fmi], [LOGGERS[fmi]]
    results = {"status": "i32", "pointer": "ptr", "void": "void"}
    functions = [(row.name, results[row.result], row.arguments) for row in version.rows]
    for name, result, arguments in [*functions, *((text, "ptr", ()) for text in version.texts)]:
        target = f"inttoptr (i64 {addresses[version.prefix + name]} to ptr)"
        text = f"define {called(result, [TYPES[t][1] for _, t in arguments], target, 'win64cc')}"
        for i, (argument, _) in enumerate(arguments):
            if name.startswith("Instantiate") and argument in ("callbacks", "logger"):
                head, call, end = text.partition("call ")
                text = f"{head.replace('%r = ', '')}%own = call ptr @own(ptr %a{i})\n  %r = {call}{end.replace(f'%a{i}', '%own', 1)}"
        rows.append(text.replace("@NAME", f"@{version.prefix}{name}"))
    return link([object_code("\n".join(rows), 0, "linux64")], SharedLibrary("bridge.so", version.exported(), ()))


def exported(source: str | Path, path: Path, fmi: str = "2", experiment: str | None = None) -> bytes:
    """Write a unit for both systems; return its library of Windows."""
    bondgraph.load(source).to_fmu(path / "unit.fmu", experiment, ("linux64", "win64"), fmi)
    with zipfile.ZipFile(path / "unit.fmu") as archive:
        (name,) = (n for n in archive.namelist() if n.startswith(f"binaries/{FOLDERS[fmi][1]}/"))
        assert name.endswith(".dll")
        return archive.read(name)


def cross(path: Path, fmi: str, library: bytes) -> None:
    """Put the library of Windows, behind a bridge, in the place of that of Linux."""
    with zipfile.ZipFile(path / "unit.fmu") as archive:
        files = {n: archive.read(n) for n in archive.namelist()}
    (name,) = (n for n in files if n.startswith(f"binaries/{FOLDERS[fmi][0]}/"))
    files[name] = bridge(fmi, loaded(library))
    with zipfile.ZipFile(path / "unit.fmu", "w") as archive:
        for n, data in files.items():
            archive.writestr(n, data)


@here
@pytest.mark.parametrize("fmi", ["2", "3"])
def test_libraries_of_windows_give_the_same_bits(fmi: str, tmp_path: Path) -> None:
    """Of a ball that bounces, in both ways of running it; and messages come to the importer."""
    library = exported(BALL, tmp_path, fmi)
    wanted = {kind: run(tmp_path, kind) for kind in KINDS}
    cross(tmp_path, fmi, library)
    for kind in KINDS:
        found = run(tmp_path, kind)
        assert len(found) > 100 and all(np.array_equal(found[n], wanted[kind][n]) for n in found.dtype.names)
    with instance(tmp_path) as (unit, _), pytest.raises(FMICallException):
        unit.getReal([999]) if fmi == "2" else unit.getFloat64([999])


@here
@pytest.mark.few(0)
@pytest.mark.parametrize("name", sorted(p.stem for p in MODELS.glob("*.bg")))
def test_models_of_the_gallery_give_the_same_bits(name: str, tmp_path: Path) -> None:
    """Each that a unit can hold, in co-simulation over a quarter of its experiment."""
    fmi = "23"[len(name) % 2]
    model = bondgraph.load(MODELS / f"{name}.bg")
    try:
        library = exported(MODELS / f"{name}.bg", tmp_path, fmi, next(iter(model.experiments), None))
    except (CompilationFailed, RunFailed) as refused:
        assert "unit" in str(refused) or name == "mems"  # a file of parts
        return
    stop = float(read_model_description(str(tmp_path / "unit.fmu")).defaultExperiment.stopTime) / 4
    wanted = run(tmp_path, "CoSimulation", stop_time=stop)
    cross(tmp_path, fmi, library)
    found = run(tmp_path, "CoSimulation", stop_time=stop)
    assert len(found) > 2 and all(np.array_equal(found[n], wanted[n], equal_nan=True) for n in found.dtype.names)


# A program for Wine: it loads the unit, makes steps of it, and writes the values of the first output that it reads to a file.
PROGRAM = """
declare ptr @LoadLibraryA(ptr)
declare ptr @GetProcAddress(ptr, ptr)
declare void @ExitProcess(i32)
declare ptr @fopen(ptr, ptr)
declare i64 @fwrite(ptr, i64, i64, ptr)
declare i32 @fclose(ptr)
@unit = private constant [9 x i8] c"unit.dll\\00"
@file = private constant [7 x i8] c"values\\00"
@way = private constant [3 x i8] c"wb\\00"
@token = private constant [TOKENSIZE x i8] c"TOKEN\\00"
@callbacks = private global [5 x ptr] zeroinitializer
@reference = private constant i32 REFERENCE
NAMES
define void @check(ptr %window, ptr %library, ptr %line, i32 %show) {
  %dll = call ptr @LoadLibraryA(ptr @unit)
FUNCTIONS
  %value = alloca double
  %out = call ptr @fopen(ptr @file, ptr @way)
  %c = call ptr %Instantiate(ptr @unit, i32 1, ptr @token, ptr null, ptr @callbacks, i32 0, i32 0)
  %a0 = call i32 %SetupExperiment(ptr %c, i32 0, double 0.0, double 0.0, i32 0, double 0.0)
  %a1 = call i32 %EnterInitializationMode(ptr %c)
  %a2 = call i32 %ExitInitializationMode(ptr %c)
  br label %steps
steps:
  %time = phi double [ 0.0, %0 ], [ %next, %steps ]
  %a3 = call i32 %DoStep(ptr %c, double %time, double 0.125, i32 1)
  %a4 = call i32 %GetReal(ptr %c, ptr @reference, i64 1, ptr %value)
  %a5 = call i64 @fwrite(ptr %value, i64 8, i64 1, ptr %out)
  %next = fadd double %time, 0.125
  %more = fcmp olt double %next, 2.0
  br i1 %more, label %steps, label %end
end:
  call void %FreeInstance(ptr %c)
  %a6 = call i32 @fclose(ptr %out)
  call void @ExitProcess(i32 7)
  ret void
}
"""
USED = ("Instantiate", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode", "DoStep", "GetReal", "FreeInstance")  # fmt: skip
NEEDED = (("kernel32.dll", frozenset(("LoadLibraryA", "GetProcAddress", "ExitProcess"))), ("ucrtbase.dll", frozenset(("fopen", "fwrite", "fclose"))))  # fmt: skip


@needs_wine
def test_wine_runs_a_unit(tmp_path: Path) -> None:
    """Heights of the ball, in steps of 1/8 s, as on Linux; the mathematical functions of Windows are others."""
    (tmp_path / "unit.dll").write_bytes(exported(BALL, tmp_path))
    description = read_model_description(str(tmp_path / "unit.fmu"))
    (reference,) = (v.valueReference for v in description.modelVariables if v.name == "h")
    names = [f'@{n} = private constant [{len(n) + 5} x i8] c"fmi2{n}\\00"' for n in USED]
    functions = [f"  %{n} = call ptr @GetProcAddress(ptr %dll, ptr @{n})" for n in USED]
    text = PROGRAM.replace("NAMES", "\n".join(names)).replace("FUNCTIONS", "\n".join(functions))
    text = text.replace("TOKENSIZE", str(len(description.guid) + 1)).replace("TOKEN", description.guid)
    objects = [object_code(text.replace("REFERENCE", str(reference)), 0, "win64")]
    (tmp_path / "program.dll").write_bytes(link(objects, SharedLibrary("program.dll", ("check",), NEEDED)))
    assert under_wine(tmp_path / "program.dll") == 7
    found = np.frombuffer((tmp_path / "values").read_bytes())
    wanted = run(tmp_path, "CoSimulation", output_interval=0.125, stop_time=2.0, output=["h"])["h"][1:]
    assert len(found) == 16 and np.abs(found - wanted).max() < 1e-12
