"""The server of pages: this computer only, with the secret only, no folder, no foreign page; and its end by Ctrl-C."""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
import urllib.request
from typing import Any

import pytest
from werkzeug.test import Client

from beltcomm.errors import DataError, UsageError
from beltcomm.web.server import HEADERS, LONGEST, PageFiles, application, serve

PAGE = PageFiles("tune")
HOST = {"Host": "127.0.0.1:8000"}


def refuse(_: Any) -> dict[str, Any]:
    raise DataError("the record is damaged")


@pytest.fixture
def client() -> Client:
    answers = {"double": lambda asked: {"twice": 2 * asked["x"]}, "refuse": refuse, "endless": lambda _: {"x": math.inf}}
    return Client(application(PAGE, answers, "secret"))


@pytest.mark.parametrize(("place", "kind"), [("", "text/html"), ("tune.js", "text/javascript"), ("tune.css", "text/css")])
def test_page_and_its_files_are_served(client: Client, place: str, kind: str) -> None:
    answer = client.get(f"/secret/{place}", headers=HOST)
    assert (answer.status_code, answer.mimetype) == (200, kind)
    assert HEADERS.items() <= dict(answer.headers).items()


@pytest.mark.parametrize(
    ("method", "place", "given", "status"),
    [
        ("GET", "/", {}, 404),
        ("GET", "/guess/", {}, 404),
        ("GET", "/guess/tune.js", {}, 404),
        ("POST", "/guess/double", {"json": {"x": 1}}, 404),
        ("GET", "/secret/server.py", {}, 404),
        ("GET", "/secret/../server.py", {}, 404),
        ("GET", "/secret/%2e%2e/%2e%2e/pyproject.toml", {}, 404),
        ("GET", "/secret/double", {}, 405),
        ("GET", "/secret/", {"headers": {"Host": "evil.example"}}, 403),
        ("GET", "/secret/", {"headers": {"Host": "127.0.0.1.evil.example:8000"}}, 403),
        ("GET", "/secret/", {"headers": {"Host": ""}}, 403),
        ("POST", "/secret/double", {"json": {"x": 1}, "headers": HOST | {"Origin": "http://evil.example"}}, 403),
        ("POST", "/secret/double", {"json": {"x": 1}, "headers": HOST | {"Origin": "null"}}, 403),
        ("POST", "/secret/double", {"data": '{"x": 1}', "content_type": "text/plain"}, 415),
        ("POST", "/secret/double", {"data": "{", "content_type": "application/json"}, 400),
        ("POST", "/secret/double", {"data": b"[" + b"1," * LONGEST, "content_type": "application/json"}, 413),
    ],
)
def test_anything_else_is_refused(client: Client, method: str, place: str, given: dict[str, Any], status: int) -> None:
    answer = client.open(place, method=method, **({"headers": HOST} | given))
    assert answer.status_code == status
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]


def test_questions_are_answered(client: Client) -> None:
    own = HOST | {"Origin": "http://127.0.0.1:8000"}
    assert client.post("/secret/double", json={"x": 21}, headers=own).json == {"twice": 42}
    fault = client.post("/secret/double", json={}, headers=own)
    assert (fault.status_code, fault.json) == (500, {"error": "an unexpected error: KeyError: 'x'"})
    assert client.post("/secret/endless", json={}, headers=own).json == {"x": None}
    refusal = client.post("/secret/refuse", json={}, headers=own)
    assert (refusal.status_code, refusal.json) == (422, {"error": "the record is damaged"})


def test_page_needs_nothing_from_outside() -> None:
    """It works without a network: no address but that of SVG's names, no script or style in the page that the browser would refuse."""
    texts = {kind: PAGE.text(kind) for kind in ("html", "css", "js")}
    assert re.findall(r"https?://[^\"' ]*", "".join(texts.values())) == ["http://www.w3.org/2000/svg"]
    assert not re.search(r"\bstyle=|\bon\w+=|<script>|<style>", texts["html"])
    assert "@import" not in texts["css"]


def test_a_port_that_is_taken_is_refused() -> None:
    with serve(PAGE, {}, "secret") as first:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/secret/", first.address)
        port = int(first.address.split(":")[2].split("/")[0])
        with pytest.raises(UsageError, match=f"port {port} of 127.0.0.1 cannot be used"), serve(PAGE, {}, "secret", port):
            pass


def test_ctrl_c_ends_it_quietly() -> None:
    """In a process of its own."""
    program = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from beltcomm.web.server import PageFiles, serve\n"
        "with serve(PageFiles('tune'), {}, 'secret') as served:\n"
        "    print(served.address, flush=True)\n"
        "    served.run()\n"
        "print('ended')\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    address = process.stdout.readline().strip()
    with urllib.request.urlopen(address) as page:  # now it answers, so it is past its beginning
        assert page.status == 200
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "ended\n", "")
