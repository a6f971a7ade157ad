"""`report` and `serve` as a user meets them."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from click import Context
from click.testing import CliRunner, Result

from bondgraph.commands import commands
from tests.compiling import ROOT


def run(*arguments: str) -> Result:
    return CliRunner().invoke(commands, [*arguments])


def test_report_writes_a_page(tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    assert run("report", "models/rlc.bg", "-o", str(out)).exit_code == 0
    assert out.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_report_tells_what_is_wrong(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.bg"
    wrong.write_text("model A {\n  C c : F = k*x\n}\n", encoding="utf-8")
    out = tmp_path / "page.html"
    found = run("report", str(wrong), "-o", str(out))
    assert found.exit_code == 1 and "wrong.bg:2:13: BG101" in found.stderr and not out.exists()
    assert run("report", "models/rlc.bg", "-o", str(tmp_path / "page.pdf")).exit_code == 2
    assert run("report", str(tmp_path / "none.bg"), "-o", str(out)).exit_code == 2
    assert run("serve", str(tmp_path / "none.bg")).exit_code == 2


def test_the_container_serves_a_folder() -> None:
    """What it copies is there, and it ends with a call that the command takes."""
    text = (ROOT / "Containerfile").read_text(encoding="utf-8")
    copied = [name for line in re.findall(r"^COPY (.+) \S+$", text, re.MULTILINE) for name in line.split()]
    assert len(copied) == 5 and all((ROOT / name).exists() for name in copied)
    program, name, *options = json.loads(re.findall(r"^CMD (.+)$", text, re.MULTILINE)[0])
    command = commands.get_command(Context(commands), name)
    assert program == "bondgraph" and command is not None
    assert command.make_context(name, options).params["port"] == 8000


def _heeds_interrupts() -> None:
    """Restore Ctrl-C. A shell's background process ignores it, and so would the processes that it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent otherwise there")
def test_serve_says_where_and_ends() -> None:
    command = [sys.executable, "-u", "-m", "bondgraph", "serve", "models/rlc.bg"]
    server = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_heeds_interrupts
    )
    try:
        assert server.stdout is not None
        address = server.stdout.readline().rpartition(" at ")[2].split()[0]
        with urllib.request.urlopen(address, timeout=60) as answer:
            assert answer.read().startswith(b"<!DOCTYPE html>")
            assert answer.headers["X-Frame-Options"] == "DENY" and answer.headers["Referrer-Policy"] == "no-referrer"
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(address.partition("?")[0], timeout=60)
        server.send_signal(signal.SIGINT)
        told, wrong = server.communicate(timeout=60)
        assert server.returncode == 0 and "ended" in told and wrong == ""
    finally:
        server.kill()
        server.communicate()
