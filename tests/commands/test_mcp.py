"""The server for assistants, through a client of the protocol in this process."""

from __future__ import annotations

import asyncio
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.compiling import MODELS

pytest.importorskip("mcp")

TEXT = (MODELS / "rlc.bg").read_text(encoding="utf-8")


def called(*calls: tuple[str, dict[str, Any]]) -> list[str]:
    """Return what some tools say."""
    from mcp.client import Client

    from bondgraph.commands.mcp import tools

    async def session() -> list[str]:
        async with Client(tools()) as client:
            assert len((await client.list_tools()).tools) == 8
            answers = [await client.call_tool(name, arguments) for name, arguments in calls]
        assert not any(a.is_error for a in answers)
        return ["".join(part.text for part in a.content) for a in answers]

    with ThreadPoolExecutor(1) as thread:  # a browser of another test leaves a loop in this one
        return thread.submit(asyncio.run, session()).result()


def test_a_mistake_is_told_and_mended() -> None:
    wrong = TEXT.replace("-> loop", "-> lop")
    told, mended = map(json.loads, called(("check", {"text": wrong}), ("corrections", {"text": wrong})))
    assert [(d["code"], d["line"]) for d in told["diagnostics"]] == [(c["code"], c["line"]) for c in mended]
    assert mended[0]["text"] == TEXT


def test_runs_and_analyses_are_those_of_the_command_line(tmp_path: Path) -> None:
    run, modes, drawn, equations = called(
        ("simulate", {"text": TEXT, "settings": {"R": "20 ohm"}, "to": "2 ms", "points": 3}),
        ("modes", {"file": str(MODELS / "rlc.bg")}),
        ("draw", {"text": TEXT}),
        ("equations", {"text": TEXT}),
    )
    summary, _, values = run.partition("\n}\n")
    found = json.loads(summary + "}")
    assert found["schema"] == "bondgraph-result/1" and found["outputs"]["i"]["maximum"] > 0
    assert [float(line.split(",")[0]) for line in values.splitlines()[1:]] == [0.0, 1e-3, 2e-3]
    assert json.loads(modes)["modes"][0]["frequency"] == pytest.approx(503.292121)  # 1/(2 pi sqrt(L C))
    assert drawn.startswith("<svg") and "d/dt inductor.lambda" in equations


def test_what_is_wrong_is_an_answer() -> None:
    answers = called(
        ("simulate", {"text": "model A {"}),
        ("simulate", {"file": "none.bg"}),
        ("simulate", {"text": TEXT, "settings": {"Q": "1"}}),
        ("draw", {"text": TEXT, "mechanism": "arm"}),
    )
    for answer, words in zip(
        answers, ("BG007", "No such file", "Parameters and inputs: R, L", "mechanism"), strict=True
    ):
        assert words in answer and "Traceback" not in answer, answer


def test_reference_and_library_are_searched() -> None:
    titles, events, diode = called(("language", {}), ("language", {"section": "12"}), ("library", {"words": "Diode"}))
    assert "12. Events" in titles and events.startswith("## 12. Events") and "Shockley" in diode
