"""Completion of the command line, the list of commands, and the examples of the help texts."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete, get_completion_class
from click.testing import CliRunner

from bondgraph.commands import COMMANDS, EXAMPLES, commands
from tests.compiling import MODELS

COMPLETER = ShellComplete(commands, {}, "bondgraph", "_BONDGRAPH_COMPLETE")
MODEL = """model Rc {
  parameter R = 1 ohm
  input U = 0 V
  MSe source : u = U
  1  loop   : electric
  R  r      : u = R*i
  C  c      : q = 1 F*u
  source -> loop -> r, c
  output charge = c.q, current = loop.i
  experiment step { simulate 0 .. 3 s; set U = 1 V }
  experiment swing { simulate 0 .. 3 s; set U = 1 V*sin(1 [rad/s]*time) }
}
"""


def completed(*words: str, typed: str = "") -> list[str]:
    return [item.value for item in COMPLETER.get_completions(list(words), typed)]


def test_names_of_the_model_in_the_file(tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.mktemp("models") / "rc.bg"
    file.write_text(MODEL)
    assert completed("run", str(file), "-e") == ["step", "swing"]
    assert completed("modes", str(file), "-e", typed="sw") == ["swing"]
    assert completed("run", str(file), "--set") == ["R=", "U="]
    assert completed("run", "-e", "step", str(file), "--output", typed="c") == ["charge", "current"]
    assert completed("bode", str(file), "--input") == completed("invert", str(file), "--by") == ["U"]
    for command, option in (
        ("sweep", "--over"),
        ("montecarlo", "--vary"),
        ("continue", "--along"),
        ("fit", "--parameter"),
    ):
        assert completed(command, str(file), option) == ["R=", "U="]
    assert completed("sensitivity", str(file), "--by") == ["R", "U"]
    assert completed("invert", str(file), "--want", typed="c") == ["charge=", "current="]
    assert completed("run", str(file), "--set", typed="R=2 k") == ["R=2 kohm"]
    assert completed("run", str(file), "--set", typed="R=2")[0] == "R=2ohm" and not completed(
        "run", str(file), "--set", typed="R="
    )
    assert completed("sweep", str(file), "--over", typed="U=1, 2.5e3 m") == ["U=1, 2.5e3 mV"]
    assert completed("run", str(MODELS / "oscillator.bg"), "--set", typed="k=5 [") == ["k=5 [N/m]"]
    assert (
        completed("run", str(file), "--set", typed="R2=2") == completed("run", str(file), "--set", typed="R=r2") == []
    )
    assert "state_equations" in completed("show", str(file), "--stage")
    assert completed("run", str(file.with_name("missing.bg")), "-e") == []
    file.write_text("model Rc {")
    assert completed("run", str(file), "-e") == []


def test_words_that_bash_cuts_at_equal_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    """It gets what follows the sign; in quotes, which it does not cut, the whole."""
    found = get_completion_class("bash")
    assert found is not None and "nospace" in found.source_template
    completer = found(commands, {}, "bondgraph", "_BONDGRAPH_COMPLETE")
    for cut, answer in (
        ("k\n=\n5", "plain,5[N/m]"),
        ("'k=5 ", "plain,k=5 [N/m]"),
        ("m\n=\n5l", "plain,5lb"),
        ("k\n=", ""),
    ):
        words = f"bondgraph\nrun\n{MODELS / 'oscillator.bg'}\n--set\n{cut}"
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(words.count("\n")))
        assert completer.complete() == answer


def test_a_missing_option_tells_what_it_takes(tmp_path: Path) -> None:
    """The names of the model in the file, and an example; where no model can be read, the example alone."""
    file = tmp_path / "rc.bg"
    file.write_text(MODEL)
    for command in ("montecarlo", "sweep", "continue"):
        told = CliRunner().invoke(commands, [command, str(file)]).output
        assert told.endswith(f"\nIt takes one of R, U\nExample: bondgraph {command} {EXAMPLES[command]}\n"), told
    for line, taken in (("fit FILE --data x.csv", "R, U"), ("invert FILE", "U"), ("show FILE", "syntax, graph, ")):
        told = CliRunner().invoke(commands, line.replace("FILE", str(file)).split()).output
        assert f"\nIt takes one of {taken}" in told and f"\nExample: bondgraph {line[:3]}" in told
    assert "It takes" not in CliRunner().invoke(commands, ["run"]).output
    file.write_text("model Rc {")
    told = CliRunner().invoke(commands, ["sweep", str(file)])
    assert told.exit_code == 2 and "It takes" not in told.output and "\nExample: bondgraph sweep " in told.output


def test_commands_near_a_wrong_one() -> None:
    assert completed(typed="ru") == ["run"]
    found = CliRunner().invoke(commands, ["rum"])
    assert found.exit_code == 2 and "there is no command `rum`: did you mean `run`?" in found.output
    for line, hint in (("simulate", "run"), (f"{MODELS / 'rlc.bg'}", f"run {MODELS / 'rlc.bg'}")):
        assert f"did you mean `{hint}`?" in CliRunner().invoke(commands, [line]).output
    for line in ("run m.bg push_it", "modes m.bg push_it"):
        assert "(push_it)\nAn experiment is named with `-e`.\n" in CliRunner().invoke(commands, line.split()).output
    assert "`-e`" not in CliRunner().invoke(commands, ["manual", "x"]).output
    for near in ("rlc", "rcl.bg", "rlc.bgg"):
        told = CliRunner().invoke(commands, ["check", str(MODELS / near)]).output
        assert f"did you mean `{MODELS / 'rlc.bg'}`?" in told
    assert "did you mean" not in CliRunner().invoke(commands, ["run", str(MODELS / "none" / "rlc.bg")]).output


def test_the_list_has_every_command() -> None:
    listed = CliRunner().invoke(commands, ["--help"]).output
    assert all(f"\n  {name} " in listed for name in COMMANDS)
    assert "Write a first model to start from\n" in listed  # the first thought alone


@pytest.mark.parametrize("name", COMMANDS)
def test_an_example_of_the_help_is_a_command_line(name: str) -> None:
    command = commands.get_command(commands.make_context("bondgraph", [name]), name)
    assert command is not None and EXAMPLES[name] in (command.epilog or "")
    arguments = shlex.split(EXAMPLES[name])
    context = command.make_context(name, arguments)  # raises for what the command does not take
    assert bool(context.params) == bool(command.params)
