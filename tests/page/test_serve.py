"""The live server: whom it answers, and in a browser how a page follows its file and its sliders."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bondgraph.presentation.page.serve import Server, Session
from bondgraph.presentation.page.serve.server import Guard
from bondgraph.presentation.page.serve.session import Stopped, TimedExecutor
from bondgraph.presentation.page.serve.settings import base_settings
from tests.compiling import MODELS

TEXT = """model Swing {
  parameter m = 2 kg, k = 8 [N/m], r: N*s/m = 0.5, m_half = m/2
  input push = 1 N
  MSe drive : F = push
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x
  R  damper : F = r*v
  drive -> body -> mass, spring, damper
  output x = spring.x
  experiment go { simulate 0 .. 60 s; report x in m }
  experiment swept { sweep k = 8 [N/m], 4 [N/m]; equilibrium; report x in m }
}
"""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Server, Path]]:
    path = tmp_path / "swing.bg"
    path.write_text(TEXT, encoding="utf-8")
    server = Server(Session(path))
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    server.start()
    thread.start()
    yield server, path
    server.end()
    thread.join()


def ask(server: Server, path: str, body: Any = None, **headers: str) -> tuple[int, str]:
    """A request as a client of any kind would send it; the token of the server and its own name unless others are given."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    given = {"Host": f"127.0.0.1:{server.server_port}", "X-Bondgraph-Token": server.guard.token}
    given |= {key.replace("_", "-"): value for key, value in headers.items()}
    connection.putrequest("GET" if body is None else "POST", path, skip_host=True)
    data = b"" if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
    if body is not None:
        given.setdefault("Content-Length", str(len(data)))
    for key, value in given.items():
        if value:
            connection.putheader(key, value)
    connection.endheaders(data or None)
    answer = connection.getresponse()
    found = answer.status, answer.read().decode()
    connection.close()
    return found


def test_it_listens_to_this_machine_alone(served: tuple[Server, Path]) -> None:
    server, _ = served
    assert server.server_address[0] == "127.0.0.1"
    assert server.guard.address.startswith(f"http://127.0.0.1:{server.server_port}/?token=")


def test_it_answers_its_own_pages_alone(served: tuple[Server, Path]) -> None:
    server, _ = served
    port, go = server.server_port, {"experiment": "go", "settings": {}}
    assert ask(server, f"/?token={server.guard.token}", X_Bondgraph_Token="")[0] == 200
    assert ask(server, "/run", go)[0] == 200
    assert ask(server, "/run", go, Origin=f"http://127.0.0.1:{port}", Sec_Fetch_Site="same-origin")[0] == 200
    assert ask(server, "/run", go, Host=f"localhost:{port}")[0] == 200
    refused: list[dict[str, str]] = [
        {"X_Bondgraph_Token": ""}, {"X_Bondgraph_Token": server.guard.token[:-1]}, {"Host": f"evil.example:{port}"}, {"Host": "127.0.0.1"},
        {"Host": ""}, {"Host": f"127.0.0.1:{port + 1}"}, {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Sec_Fetch_Site": "cross-site"},
    ]  # fmt: skip
    for headers in refused:
        assert ask(server, "/run", go, **headers)[0] == 403, headers
        assert ask(server, "/changes?since=0", **headers)[0] == 403, headers
    for path in ("/", "/?token=", "/?token=x", "/?token=%C3%A9"):
        assert ask(server, path)[0] == 403, path


def test_it_runs_its_file_alone(served: tuple[Server, Path]) -> None:
    server, _ = served
    for path in ("/../../etc/passwd", "/swing.bg", "/run", "/models"):
        assert ask(server, path)[0] == 404
    wrong: list[Any] = [
        b"", b"[]", b"\xff", {"experiment": "go"}, {"experiment": "no", "settings": {}}, {"experiment": ["go"], "settings": {}},
        {"experiment": "go", "settings": {"none": 1}},
        b'{"experiment": "go", "settings": {"k": Infinity}}', {"experiment": "go", "settings": [1]},
    ]  # fmt: skip
    for body in wrong:
        assert ask(server, "/run", body)[0] == 400, body
    assert ask(server, "/run", b"{}", Content_Length="99999999")[0] == 413
    assert ask(server, "/run", b"{}", Content_Length="many")[0] == 400


def test_other_addresses_only_where_asked() -> None:
    everywhere, one = Guard("0.0.0.0", 80, "t"), Guard("192.0.2.7", 80, "t")
    assert everywhere.refusal({"Host": "192.0.2.7:80"}, "t") == "" and one.refusal({"Host": "192.0.2.7:80"}, "t") == ""
    assert everywhere.refusal({"Host": "evil.example:80"}, "t") and one.refusal({"Host": "192.0.2.8:80"}, "t")
    assert Guard("::", 80, "t").refusal({"Host": "[2001:db8::1]:80"}, "t") == ""
    assert Guard("127.0.0.1", 80, "t").refusal({"Host": "192.0.2.7:80"}, "t")


def test_runs_with_other_values_compile_nothing(tmp_path: Path) -> None:
    path = tmp_path / "swing.bg"
    path.write_text(TEXT, encoding="utf-8")
    session = Session(path)
    session.load()
    assert session.loaded is not None
    model = session.loaded.watched.model
    assert base_settings(model, "go") == {
        "m": 2.0,
        "k": 8.0,
        "r": 0.5,
        "push": 1.0,
    }  # what follows from others goes with them
    session.run("go", {})
    before = model.compiled
    for k in (4.0, 5.0, 16.0):
        run = json.loads(session.run("go", {"k": k, "push": 2.0, "r": 4.0}))["run"]
        assert final(run) == pytest.approx(2.0 / k, rel=1e-4)
    assert model.compiled == before


def test_where_joints_are_compiles_nothing(tmp_path: Path) -> None:
    path = tmp_path / "rod.bg"
    path.write_text(
        """model Rod {
  parameter l = 1 m, m = 1 kg
  multibody rod : planar {
    gravity = (0, -9.81 [m/s^2])
    body bob { mass = m, at = (l, 0) }
    hinge pin : ground to bob { at = (0, 0) }
  }
  output phi = rod.pin.phi
  experiment go { simulate 0 .. 0.1 s; report phi }
}
""",
        encoding="utf-8",
    )
    session = Session(path)
    session.load()
    assert json.loads(session.run("go", {}))["run"]["notes"] == []
    run = json.loads(session.run("go", {"l": 2.0}))["run"]
    assert run["notes"] == []
    assert final(run) == pytest.approx(-9.81 / 2.0 * 0.1**2 / 2, rel=0.01)  # it falls about a pin: phi'' = g/l


def test_what_decides_more_than_numbers_says_so(tmp_path: Path) -> None:
    path = tmp_path / "chain.bg"
    path.write_text(
        """model Chain {
  parameter n = 2, r: N*s/m = 4
  Se pull : F = 1 N
  1 top : translation
  pull -> top
  for i in 1..n { R drag[i] : F = r*v
    top -> drag[i] }
  output v = top.v
  experiment go { simulate 0 .. 1 s }
}
""",
        encoding="utf-8",
    )
    session = Session(path)
    session.load()
    assert json.loads(session.run("go", {}))["run"]["notes"] == []
    run = json.loads(session.run("go", {"n": 4.0}))["run"]
    assert "`n`" in run["notes"][-1] and "compiled" in run["notes"][-1]
    assert final(run) == pytest.approx(1 / 16)
    assert json.loads(session.run("go", {"r": 2.0}))["run"]["notes"] == []


def final(run: dict[str, Any]) -> float:
    return float(unpacked(run["values"])[-1])


def unpacked(packed: dict[str, str]) -> Any:
    from base64 import b64decode

    import numpy as np

    return np.frombuffer(b64decode(packed["f8"]), "<f8")


def test_sweeps_and_failures_are_told(tmp_path: Path) -> None:
    path = tmp_path / "swing.bg"
    path.write_text(TEXT, encoding="utf-8")
    session = Session(path)
    session.load()
    swept = json.loads(session.run("swept", {"push": 2.0}))
    assert swept["kind"] == "told" and final(swept["plot"]) == pytest.approx(0.5)
    path.write_text(TEXT.replace("F = k*x", "F = 1 [N^0.5/m^0.5]*sqrt(k)*x"), encoding="utf-8")
    session.load()
    assert session.shown.problems == "" and json.loads(session.run("go", {}))["kind"] == "run"
    failed = json.loads(session.run("go", {"k": -1.0}))
    assert failed["kind"] == "failed" and "spring" in failed["told"]


def test_sliders_of_what_is_zero_go_as_far_as_the_text() -> None:
    from bondgraph import load
    from bondgraph.presentation.page.serve.settings import parameters_of

    shown = {p["name"]: p for p in parameters_of(load(MODELS / "manipulator.bg"))}
    assert [(shown[n]["value"], shown[n]["unit"]) for n in ("h", "l_s", "d[1]", "E[2]")] == [
        (38, "um"),
        (1, "mm"),
        (1.95, "um"),
        (158, "GPa"),
    ]
    sizes = {n: p["size"] for n, p in shown.items()}
    assert sizes["fx"] == pytest.approx(30e-6) and sizes["push1"] == 60.0  # a limit of an inversion
    assert sizes["m"] == 0.0  # no torque stands in the text: one is typed first


def test_a_run_without_end_is_stopped() -> None:
    patience = TimedExecutor()

    def long() -> None:
        while True:
            time.sleep(0.01)

    with pytest.raises(Stopped):
        patience.within(0.05, long)
    assert patience.within(5.0, lambda: 7) == 7 and not patience.stop()
    threading.Timer(0.3, lambda: patience.stop(0.1)).start()
    with pytest.raises(Stopped):
        patience.within(20.0, long)
    assert not patience.stop(0.0)


# ---------------------------------------------------------------- in a browser


def until(page: Any, expression: str, patience: float = 60.0) -> Any:
    """Value of an expression, as soon as it is truthy."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        found = page.evaluate(expression)
        if found:
            return found
        time.sleep(0.03)
    raise AssertionError(f"never: {expression}")


CURVE = "document.querySelector('.plot .curve')?.getAttribute('d')"
SLIDER = "document.querySelector('.slider input[type=range][aria-label=\"k\"]')"


def test_the_page_follows_sliders_and_the_file(served: tuple[Server, Path], open_page: Callable[..., Any]) -> None:
    server, path = served
    opened = open_page(server.guard.address)
    page = opened.page
    first = until(page, CURVE)
    page.evaluate(f"{SLIDER}.value = 250; {SLIDER}.dispatchEvent(new Event('input'))")
    second = until(page, f"{CURVE} !== {first!r} && {CURVE}")
    assert page.evaluate("document.querySelector('.slider input[type=text][aria-label^=\"k in\"]').value") == "4 N/m"

    path.write_text(TEXT.replace("F = k*x", "F = k*z"), encoding="utf-8")
    told = until(page, "document.getElementById('problems').innerText")
    assert "swing.bg, line 7, column" in told and "`z`" in told
    assert page.evaluate(CURVE)  # the last page that was fine stays
    path.write_text(TEXT.replace("F = k*x", "F = k*x + 1 [N/m^3]*x^3"), encoding="utf-8")
    until(page, "document.getElementById('problems').innerText === ''")
    third = until(page, f"{CURVE} !== {second!r} && {CURVE}")
    assert third != first and "N/m^3" in page.inner_text("#text")
    assert page.evaluate(f"{SLIDER}.value") == "250"  # what was chosen stays chosen
    origin = f"http://127.0.0.1:{server.server_port}"
    assert opened.console == [] and opened.elsewhere(origin) == []


def test_a_file_that_is_wrong_from_the_start(tmp_path: Path, open_page: Callable[..., Any]) -> None:
    path = tmp_path / "swing.bg"
    path.write_text("model Swing { Se </script><script>alert(1)</script> }", encoding="utf-8")
    server = Server(Session(path))
    server.start()
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    opened = open_page(server.guard.address)
    assert "swing.bg, line 1" in until(opened.page, "document.getElementById('problems').innerText")
    path.write_text(TEXT, encoding="utf-8")
    until(opened.page, CURVE)
    assert opened.console == []
    server.end()


def test_modes_come_by_themselves(served: tuple[Server, Path], open_page: Callable[..., Any]) -> None:
    server, _ = served
    page = open_page(server.guard.address).page
    until(page, "document.querySelectorAll('#choice select option').length > 1")
    page.select_option("#choice select", "0")
    until(page, "document.querySelector('.shares')?.innerText.includes('%')")


def test_all_models_have_sliders() -> None:
    """On parameters and inputs of the model itself, lists among them."""
    from bondgraph import load
    from bondgraph.presentation.page.serve.settings import parameters_of

    names = [p["name"] for p in parameters_of(load(MODELS / "manipulator.bg"))]
    assert {"h", "d[1]", "d[3]", "fx", "push2"} <= set(names) and not any("." in n for n in names)
