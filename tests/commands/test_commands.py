"""The command line as a user meets it: exit codes, files, messages."""

from __future__ import annotations

import csv
import gc
import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from bondgraph.commands import commands, manual

WRONG = "model A {\n  C c : F = k*x\n}\n"


def run(*arguments: str) -> Result:
    return CliRunner().invoke(commands, [*arguments])


@pytest.fixture
def wrong(tmp_path: Path) -> str:
    path = tmp_path / "wrong.bg"
    path.write_text(WRONG)
    return str(path)


def test_check_tells_the_place(wrong: str) -> None:
    assert run("check", "models/rlc.bg", "models/manipulator.bg").exit_code == 0
    found = run("check", wrong)
    assert found.exit_code == 1
    assert f"{wrong}:2:13: BG101" in found.stderr
    assert found.stdout == ""


def test_a_package_that_is_missing() -> None:
    """No defect, and nothing that is wrong with the file."""
    code = "import sys; sys.modules['sympy'] = None; from bondgraph.commands import commands; commands(['equations', 'models/rlc.bg'])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.returncode == 2
    assert "the package `sympy` is not installed; `pip install bondgraph-lang`" in found.stderr
    assert "defect" not in found.stderr


def test_who_calls_the_command_keeps_the_collector() -> None:
    """Only a process that ends with a command does without: else all circles would stay, of hundreds of MB in a few thousand models."""
    frozen = gc.get_freeze_count()
    assert gc.isenabled() and run("check", "models/rlc.bg").exit_code == 0
    assert gc.isenabled() and gc.get_freeze_count() == frozen


def test_check_as_json(wrong: str) -> None:
    found = run("check", "--json", "models/rlc.bg", wrong)
    told = json.loads(found.stdout)
    assert found.exit_code == 1
    assert told["schema"] == "bondgraph-check/1"
    assert told["diagnostics"][0] | {"message": "", "help": ""} == {
        "file": wrong, "line": 2, "column": 13, "code": "BG101", "message": "", "help": "",
    }  # fmt: skip


def test_run_writes_values_in_si(tmp_path: Path) -> None:
    out, archive = tmp_path / "r.csv", tmp_path / "r.npz"
    found = run("run", "models/rlc.bg", "--points", "5", "--to", "20 ms", "--out", str(out))
    assert found.exit_code == 0, found.stderr
    rows = list(csv.reader(out.read_text().splitlines()))
    assert rows[0] == ["time [s]", "u [V]", "i [A]"]
    assert [float(r[0]) for r in rows[1:]] == pytest.approx([0, 0.005, 0.01, 0.015, 0.02])
    assert run("run", "models/rlc.bg", "--points", "5", "--out", str(archive)).exit_code == 0
    with np.load(archive) as arrays:
        assert arrays["u"][-1] == float(rows[-1][1])


def test_run_as_json_with_settings() -> None:
    found = run("run", "models/rlc.bg", "--set", "U=10 V", "--set", "R=20 ohm", "--to", "0.5", "--energy", "--json")
    told = json.loads(found.stdout)
    assert told["schema"] == "bondgraph-result/1"
    assert told["outputs"]["u"]["final"] == pytest.approx(10, rel=1e-5)
    assert told["energy"]["supplied"] == pytest.approx(1e-5 * 100, rel=1e-4)


def test_an_input_is_set_as_an_expression_of_time() -> None:
    arguments = ("run", "models/dc_motor.bg", "-e", "none", "--to", "20", "--json")
    twelve, ramp = (
        json.loads(run(*arguments, "--set", f"volt={v}").stdout) for v in ("12 V", "12 V*ramp(time, 0 s, 1 s)")
    )
    assert ramp["outputs"]["speed"]["final"] == pytest.approx(twelve["outputs"]["speed"]["final"], rel=1e-6)
    assert ramp["experiment"] is None


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("run", "no_such_file.bg"), 2, "no_such_file.bg"),
        (("run", "models/rlc.bg", "--set", "U"), 2, "NAME=VALUE"),
        (("run", "models/rlc.bg", "--set", "U=3 m"), 1, "BG103"),
        (("run", "models/rlc.bg", "--set", "nothing=3 m"), 1, "nothing"),
        (("run", "models/rlc.bg", "--to", "3 m"), 2, "no time"),
        (("run", "models/rlc.bg", "--out", "r.txt"), 2, ".csv or .npz"),
        (("run", "models/rlc.bg", "--out", "no_such_folder/r.csv"), 2, "no such folder"),
        (("run", "models/rlc.bg", "--points", "1"), 2, "points"),
        (("run", "models/rlc.bg", "-e", "nothing"), 1, "nothing"),
        (("run", "models/mems.bg"), 1, "BG132"),
        (("run", "models/rlc.bg", "-e", "none"), 2, "--to"),
        (("show", "models/rlc.bg", "--stage", "nothing"), 2, "stages are"),
        (("compile", "models/rlc.bg", "-o", "model.txt"), 2, ".py"),
        (("compile", "models/rlc.bg", "-o", "model.py", "--target", "fortran"), 2, "targets are"),
        (("compile", "models/rlc.bg", "-o", "model.py", "--target", "c"), 2, ".c"),
    ],
)
def test_what_cannot_be(arguments: tuple[str, ...], code: int, words: str) -> None:
    found = run(*arguments)
    assert found.exit_code == code, found.output
    assert words in found.stderr
    assert "Traceback" not in found.output


def test_numbers_that_fail(tmp_path: Path) -> None:
    path = tmp_path / "burst.bg"
    path.write_text("plain model Burst { output x = integral(x^2, 1) }")
    found = run("run", str(path), "--to", "2")
    assert found.exit_code == 3
    assert "t = 1" in found.stderr or "t = 0.99" in found.stderr
    assert "`x`" in found.stderr


def test_a_run_that_fails_is_written_up_to_there(tmp_path: Path) -> None:
    path, out = tmp_path / "burst.bg", tmp_path / "r.npz"
    path.write_text("plain model Burst { output x = integral(x^2, 1) }")
    found = run("run", str(path), "--to", "2", "--points", "201", "--out", str(out))
    assert found.exit_code == 3
    assert f"instants are in {out}; `bondgraph run {path} --from {out} --out {out}` goes on from t = " in found.stderr
    with np.load(out) as arrays:
        assert 99 <= len(arrays["time"]) <= 103 and arrays["x"][0] == 1
    told = json.loads(run("run", str(path), "--to", "2", "--json").stdout)
    assert told["stopped"].startswith("it failed: the solver cannot hold")


def test_a_bandwidth_is_told() -> None:
    """The truncated modes are a note, and in the JSON; an invalid frequency is an error."""
    found = run("run", "models/oscillator.bg", "--bandwidth", "1 kHz", "--json")
    assert "note: bandwidth 1 kHz: nothing was left out: nothing in it is faster" in found.stderr
    assert json.loads(found.stdout)["bandwidth"]["frequency"] == 1000
    wrong = run("run", "models/oscillator.bg", "--bandwidth", "1 kg")
    assert wrong.exit_code == 2 and "`1 kg` is no bandwidth: write `50 kHz`, or a number of Hz" in wrong.stderr


def test_a_run_that_goes_on_from_a_file(tmp_path: Path) -> None:
    part, whole = tmp_path / "part.npz", tmp_path / "whole.npz"
    assert run("run", "models/oscillator.bg", "--to", "2 s", "--out", str(part)).exit_code == 0
    assert run("run", "models/oscillator.bg", "--from", str(part), "--points", "26", "--out", str(whole)).exit_code == 0
    expected = json.loads(run("run", "models/oscillator.bg", "--json").stdout)["outputs"]["position"]["final"]
    with np.load(whole) as arrays:
        assert (arrays["time"][0], arrays["time"][-1]) == (0, 5)
        assert arrays["position"][-1] == pytest.approx(expected, rel=1e-5)
    found = run("run", "models/rlc.bg", "--from", str(part))
    assert found.exit_code == 2 and "is of the model `Oscillator`, not of `SeriesRlc`" in found.stderr
    assert run("run", "models/rlc.bg", "--from", str(tmp_path / "none.npz")).exit_code == 2


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for other processes")
def test_an_interrupted_run_is_written_up_to_there(tmp_path: Path) -> None:
    """Ctrl-C after a second of a run that takes hours."""
    path, out = tmp_path / "long.bg", tmp_path / "r.npz"
    path.write_text("plain model Long {\n output x = integral(y, 1)\n output y = integral(3*(1 - x^2)*y - x, 0)\n}\n")
    code = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "import bondgraph.simulation.integration.integration_state as i; was = i.IntegrationState.keep\n"
        "calls = []\ndef keep(self, *a, **k):\n was(self, *a, **k); calls.append(0)\n if len(calls) == 60: signal.raise_signal(signal.SIGINT)\n"
        "i.IntegrationState.keep = keep\nfrom bondgraph.commands import main; main()"
    )
    arguments = ["run", str(path), "--to", "1e5", "--points", "1000001", "--target", "numpy", "--out", str(out)]
    found = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)
    assert found.returncode == 130, found.stderr
    assert f"instants are in {out}" in found.stderr and "interrupted at t = " in found.stderr
    with np.load(out) as arrays:
        assert 5 < len(arrays["time"]) < 1000
        np.testing.assert_allclose(arrays["time"], 0.1 * np.arange(len(arrays["time"])), rtol=1e-9)


def test_files_go_to_the_standard_output(tmp_path: Path) -> None:
    """`-` in place of a file: byte for byte what the file would have, and nothing else; RC = 1 s: 1 - exp(-1) of the voltage after a second."""
    text = "model Rc {\n  Se s : u = 1 V\n  R r : u = 1 ohm*i\n  C c : q = 1 F*u\n  s -> 1(r, c)\n  output u = c.u\n}\n"
    source = tmp_path / "rc.bg"
    source.write_text(text)
    for command, ending in ((("draw",), "svg"), (("compile", "--target", "c"), "c")):
        out = tmp_path / f"out.{ending}"
        kind, *options = command
        assert run(kind, str(source), *options, "-o", str(out)).exit_code == 0
        told = run(kind, str(source), *options, "-o", "-")
        assert told.exit_code == 0 and told.stdout_bytes == out.read_bytes()
    piped = CliRunner().invoke(commands, ["run", "-", "--to", "1 s", "--points", "2", "--out", "-"], input=text)
    head, *rows = piped.stdout.splitlines()
    assert head == "time [s],u [V]" and float(rows[-1].split(",")[1]) == pytest.approx(1 - np.exp(-1), rel=1e-5)
    assert run("library", "Resistor", "-o", "-").stdout.startswith("import Resistor from electric\n")
    for refused, words in ((("compile", str(source), "-o", "-"), "--target"), (("run", str(source), "--json", "--out", "-"), "leave one out")):  # fmt: skip
        found = run(*refused)
        assert found.exit_code == 2 and words in found.stderr


def test_a_compiled_module_runs_alone(tmp_path: Path) -> None:
    out = tmp_path / "model.py"
    assert run("compile", "models/manipulator.bg", "-o", str(out)).exit_code == 0
    code = (
        "import model, numpy as np\n"
        "p = model.Parameters(); x = model.start(p)\n"
        "f = model.derivative(0.0, x, p)\n"
        "print(len(x), abs(f).max(), [n for n, _ in model.INPUTS][:2])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split()[:2] == ["12", "0.0"]


def test_equations_and_stages() -> None:
    assert "d/dt mass.p = mass.F" in run("equations", "models/oscillator.bg").stdout
    assert r"\frac{\mathrm{d}}{\mathrm{d}t}" in run("equations", "models/oscillator.bg", "--latex").stdout
    for stage in ("syntax", "graph", "causality", "equations", "reduction", "state_equations", "code", "text"):
        assert run("show", "models/oscillator.bg", "--stage", stage).exit_code == 0


def test_certificate() -> None:
    found = run("certificate", "models/dc_motor.bg")
    assert found.stdout.splitlines()[0].startswith("Motor: linear-implicit ODE, reduced from index 2; 2 states; linear")
    told = json.loads(run("certificate", "models/dc_motor.bg", "--json").stdout)
    assert told["schema"] == "bondgraph-certificate/1"
    assert (told["form"], told["index"], told["dependent"]) == ("linear-implicit ODE", 2, ["load"])
    assert run("certificate", "models/mems.bg").exit_code == 1


def test_a_run_says_what_it_solved() -> None:
    """The run of an experiment that drives the model; the outputs need all states."""
    told = json.loads(run("run", "models/rlc.bg", "--points", "3", "--json").stdout)["certificate"]
    assert (told["form"], told["driven"], told["unneeded"]) == ("explicit ODE", True, [])
    assert "explicit ODE; 2 states" in run("run", "models/rlc.bg", "--points", "3").stdout


def test_new_and_fmt(tmp_path: Path) -> None:
    path = tmp_path / "first.bg"
    assert run("new", str(path)).exit_code == 0
    assert run("new", str(path)).exit_code == 2
    assert run("check", str(path)).exit_code == 0
    assert run("fmt", "--check", str(path)).exit_code == 0
    path.write_text(path.read_text().replace(" = ", "="))
    assert run("fmt", "--check", str(path)).exit_code == 1
    assert run("fmt", str(path)).exit_code == 0
    assert run("fmt", "--check", str(path)).exit_code == 0


def test_python_m_bondgraph() -> None:
    done = subprocess.run([sys.executable, "-m", "bondgraph", "check", "models/rlc.bg"], capture_output=True, text=True)
    certificate = "SeriesRlc: explicit ODE; 2 states; linear; driven"
    assert (done.returncode, done.stdout) == (0, f"{certificate}\n1 file fine\n")


def test_a_file_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Saved with a mistake, saved without, saved as a part in an imported file; then Ctrl-C."""
    model, part = tmp_path / "m.bg", tmp_path / "part.bg"
    text = Path("models/rlc.bg").read_text(encoding="utf-8")
    right = f'import Twice from "part.bg"\n{text}'
    part.write_text("model Twice {\n  port p : electric\n  R r : u = 2 [ohm]*i\n  p -> r\n}\n")
    saves = iter([(model, text.replace("model", "modl", 1)), (model, right), (part, part.read_text() + "\n")])

    def save(_: float) -> None:
        try:
            path, content = next(saves)
        except StopIteration:
            raise KeyboardInterrupt from None
        path.write_text(content)

    model.write_text(text)
    monkeypatch.setattr(import_module("bondgraph.commands.watch"), "sleep", save)
    found = run("watch", str(model), "--to", "1 us")
    assert found.exit_code == 0 and found.stdout.endswith("ended\n")
    told = found.stdout.split(f"-- {model}, ")[1:]
    assert ["switch_on, 0 .. 1 us" in t for t in told] == [True, False, True, True], told
    assert "BG0" in found.stderr


def test_a_manual_in_a_relative_folder_has_an_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(manual, "build", lambda folder: folder)
    assert manual.address_of(manual.pages("site"), None) == (tmp_path / "site" / "index.html").as_uri()


def test_standard_input_is_a_file_too(wrong: str) -> None:
    text = Path("models/rlc.bg").read_text(encoding="utf-8")
    untidy = text.replace("output u", "output   u", 1)
    for arguments in (["check", "-"], ["run", "-", "--to", "1 us"], ["fmt", "--check", "-"]):
        assert CliRunner().invoke(commands, arguments, input=text).exit_code == 0
    assert CliRunner().invoke(commands, ["fmt", "--check", "-"], input=untidy).exit_code == 1
    assert CliRunner().invoke(commands, ["fmt", "-"], input=untidy).stdout == text
    found = CliRunner().invoke(commands, ["check", "-"], input=WRONG.encode("utf-8-sig"))
    assert found.exit_code == 1 and "text:2:13: BG101" in found.stderr
    assert CliRunner().invoke(commands, ["check", "-"], input=b"\xff").exit_code == 2
