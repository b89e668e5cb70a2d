"""The server of pages: this computer only, with the secret only, no folder, no foreign page; and its end by Ctrl-C."""

from __future__ import annotations

import hashlib
import math
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import pytest
from werkzeug.test import Client

from beltcomm.errors import DataError, UsageError
from beltcomm.web import server
from beltcomm.web.server import HEADERS, LONGEST, PAGE, application, serve

HOST = {"Host": "127.0.0.1:8000"}


def refuse(_: Any) -> dict[str, Any]:
    raise DataError("the record is damaged")


@pytest.fixture
def client() -> Client:
    answers = {"double": lambda asked: {"twice": 2 * asked["x"]}, "refuse": refuse, "endless": lambda _: {"x": math.inf}}
    return Client(application(PAGE, answers, "secret"))


@pytest.mark.parametrize(
    ("place", "kind"),
    [("", "text/html"), ("open.js", "text/javascript"), ("open.css", "text/css"), ("uPlot.iife.min.js", "text/javascript")],
)
def test_page_and_its_files_are_served(client: Client, place: str, kind: str) -> None:
    answer = client.get(f"/secret/{place}", headers=HOST)
    assert (answer.status_code, answer.mimetype) == (200, kind)
    assert HEADERS.items() <= dict(answer.headers).items()


@pytest.mark.parametrize(
    ("method", "place", "given", "status"),
    [
        ("GET", "/", {}, 404),
        ("GET", "/guess/", {}, 404),
        ("GET", "/guess/open.js", {}, 404),
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
    """It works without a network: no address, no script or style in the page that the browser would refuse, every file that is named."""
    own = {name: PAGE.text(name) for name in PAGE.beside if not PAGE.beside[name].startswith("vendor/")}
    page = PAGE.text()
    assert not re.findall(r"https?://[^\"' ]*", "".join((page, *own.values())))
    assert not re.search(r"\bstyle=|\bon\w+=|<script>|<style>", page)
    assert not any("@import" in text for name, text in own.items() if name.endswith(".css"))
    named = set(re.findall(r'(?:src|href)="([^"]*)"', page)) - {"data:,"}
    named |= {name for text in own.values() for name in re.findall(r'from "\./([^"]*)"', text)}
    assert named == set(PAGE.beside)


def test_what_is_of_others_is_unchanged_and_has_its_licence() -> None:
    folder = Path(server.__file__).parent / "vendor"
    told = dict(re.findall(r"\| `([^`]+)` \|.*`([0-9a-f]{64})` \|", (folder / "README.md").read_text(encoding="utf-8")))
    shipped = {place.removeprefix("vendor/") for place in PAGE.beside.values() if place.startswith("vendor/")}
    assert set(told) == shipped
    for name, digest in told.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, name
    assert "Permission is hereby granted" in (folder / "uPlot.LICENSE").read_text(encoding="utf-8")


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
        "from beltcomm.web.server import PAGE, serve\n"
        "with serve(PAGE, {}, 'secret') as served:\n"
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
