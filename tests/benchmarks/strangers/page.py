"""Attacks on the page of a run: foreign sites and names, guessed addresses, broken requests, values, two pages at once, markup in names."""

from __future__ import annotations

import concurrent.futures
import hashlib
import json
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from beltcomm.app.serve import RunPage
from strangers.outcome import NEVER, Outcome, judged

GROUP = "page"
#: s for an answer; a proof takes longest.
PATIENCE_S, PROOF_S = 15.0, 240.0
MARKUP = "<img src=x id=pwned onerror=alert(1)>\x1b[31m\u202e"
JSON = "application/json"


@dataclass
class Page:
    """A page that ``beltcomm open`` serves for a run."""

    run: Path
    port: int
    token: str
    process: subprocess.Popen[str]
    said: list[str] = field(default_factory=list)

    def raw(self, request: bytes, patience_s: float = PATIENCE_S, shut: bool = False) -> tuple[int, bytes]:
        """Status and answer to the bytes of a request; 0 where the connection ends without one, -1 where nothing comes."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=patience_s) as line:
            try:
                line.sendall(request)
                if shut:
                    line.shutdown(socket.SHUT_WR)
                answer = b""
                while more := line.recv(1 << 16):
                    answer += more
                    if (head := answer.find(b"\r\n\r\n")) >= 0:
                        length = re.search(rb"(?i)content-length: (\d+)", answer[:head])
                        if length and len(answer) >= head + 4 + int(length[1]):
                            break
            except TimeoutError:
                return -1, b""
            except OSError:
                pass
        match = re.match(rb"HTTP/1\.[01] (\d{3})", answer)
        return (int(match[1]) if match else 0), answer

    def ask(
        self,
        path: str = "{token}/begin",
        method: str = "POST",
        body: bytes = b'{"run": "", "asked": {}}',
        headers: Mapping[str, str | None] | None = None,
        patience_s: float = PATIENCE_S,
    ) -> tuple[int, bytes]:
        """A request as a browser would make it, but for what is given.   headers : further ones, None leaves one out."""
        own = f"127.0.0.1:{self.port}"
        given = {"Host": own, "Origin": f"http://{own}", "Content-Type": JSON, "Content-Length": str(len(body)), "Connection": "close"}
        lines = [f"{name}: {value}" for name, value in {**given, **(headers or {})}.items() if value is not None]
        head = f"{method} /{path.format(token=self.token)} HTTP/1.1\r\n" + "\r\n".join(lines) + "\r\n\r\n"
        return self.raw(head.encode("latin-1") + body, patience_s)

    def answer(self, name: str, asked: Any, patience_s: float = PATIENCE_S, run: Any = "") -> tuple[int, Any]:
        """An answer of the page to a question.   run : beside the one that is shown."""
        body = json.dumps({"run": run, "asked": asked}).encode()
        status, whole = self.ask(f"{{token}}/{name}", body=body, patience_s=patience_s)
        text = whole.partition(b"\r\n\r\n")[2].decode("utf-8", "replace")
        try:
            return status, json.loads(text)
        except ValueError:
            return status, text

    @property
    def lives(self) -> bool:
        """Whether it still answers its own page."""
        return self.process.poll() is None and self.ask()[0] == 200

    def own_files(self) -> dict[str, str]:
        """Of the run, but for what is written line by line."""
        return {
            str(path.relative_to(self.run)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in self.run.rglob("*")
            if path.is_file() and path.suffix not in (".txt", ".jsonl") and "kept" not in path.parts
        }


@contextmanager
def served(run: Path, *words: str) -> Iterator[Page]:
    """``beltcomm open`` on a run, ended by Ctrl-C."""
    command = [sys.executable, "-m", "beltcomm", "open", str(run), "--no-browser", *words]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "400"},
    ) as process:
        assert process.stderr is not None
        said: list[str] = []
        for line in process.stderr:
            said.append(line)
            if found := re.search(r"http://127\.0\.0\.1:(\d+)/([\w-]+)/", line):
                break
        else:
            raise RuntimeError("".join(said))
        page = Page(run, int(found[1]), found[2], process, said)
        reader = threading.Thread(target=lambda: said.extend(process.stderr or ()), daemon=True)
        reader.start()
        try:
            yield page
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                said.append("Traceback (most recent: it did not end by Ctrl-C)")
            reader.join(PATIENCE_S)


Attack = Callable[[Page], tuple[int, bytes]]


def requests(own: Page) -> dict[str, tuple[Attack, tuple[int, ...]]]:
    """By name: a request, and the statuses that refuse it."""
    host, port = f"127.0.0.1:{own.port}", own.port
    found: dict[str, tuple[Attack, tuple[int, ...]]] = {}

    def header(name: str, statuses: tuple[int, ...] = (403,), **given: str | None) -> None:
        headers = {key.replace("_", "-"): value for key, value in given.items()}
        found[name] = (lambda page: page.ask(headers=headers)), statuses

    for origin in (
        "http://evil.example",
        "null",
        f"https://{host}",
        f"http://127.0.0.1:{port + 1}",
        f"http://localhost:{port}",
        f"http://{host}.evil.example",
        f"http://{host}@evil.example",
        "",
        "file://",
    ):
        header(f"origin {origin!r}", Origin=origin)
    for name in ("evil.example", "", f"{host}.evil.example", f"evil.example:{port}", f"[::1]:{port}", f"0.0.0.0:{port}", f"{host}@evil"):
        header(f"host {name!r}", (400, 403), Host=name)
    header("without a host", (400, 403), Host=None)
    double = f"POST /{own.token}/begin HTTP/1.1\r\nHost: {host}\r\nHost: evil.example\r\nContent-Length: 0\r\n\r\n".encode()
    found["two hosts"] = (lambda page: page.raw(double)), (400, 403, 415)

    def place(name: str, path: str, method: str = "POST", statuses: tuple[int, ...] = (404,)) -> None:
        found[name] = (lambda page: page.ask(path, method)), statuses

    token = own.token
    for name, path in {
        "no token": "design-begin",
        "wrong token": "x" * len(token) + "/begin",
        "half a token": token[:-1] + "/begin",
        "longer token": token + "a/begin",
        "other case": token.swapcase() + "/begin",
        "empty token": "/begin",
        "zero behind the token": token + "%00/begin",
        "two tokens": f"{token}/{token}/begin",
    }.items():
        place(name, path)
    for path in (
        "{token}/../server.py",
        "{token}/..%2f..%2fpyproject.toml",
        "{token}/%2e%2e/%2e%2e/etc/passwd",
        "{token}/..\\..\\axis.yaml",
        "{token}/open.js/../../../etc/passwd",
        "{token}/open.js%00.css",
        "//etc/passwd",
        "{token}//etc/passwd",
    ):
        place(f"path {path}", path, "GET", (404, 400))
    for method in ("GET", "PUT", "DELETE", "TRACE", "OPTIONS", "CONNECT", "post"):
        place(f"method {method}", "{token}/begin", method, (405, 400, 404))
    found["form of another site"] = (lambda page: page.ask(headers={"Content-Type": "text/plain", "Origin": None})), (415,)
    found["100 MB announced"] = (lambda page: page.ask(headers={"Content-Length": "100000000"})), (413,)
    found["1 MB sent"] = (lambda page: page.ask(body=b"[" + b"1," * 500_000 + b"1]")), (413, 0)
    found["length below zero"] = (lambda page: page.ask(headers={"Content-Length": "-1"})), (400,)
    found["length of letters"] = (lambda page: page.ask(headers={"Content-Length": "many"})), (400,)
    smuggled = (
        f"POST /{token}/begin HTTP/1.1\r\nHost: {host}\r\nContent-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\nffffffffff\r\n".encode()
    )
    found["chunk of 1 TB"] = (lambda page: page.raw(smuggled, shut=True)), (400, 413, 415, 0)
    for name, body in {
        "cut off": b"{",
        "5000 digits": b"[" + b"9" * 5000 + b"]",
        "deep": b"[" * 30_000 + b"]" * 30_000,
        "other bytes": b"\xff\xfe\x00",
        "empty": b"",
    }.items():
        found[f"JSON {name}"] = (lambda page, body=body: page.ask("{token}/design-update", body=body)), (400, 422)  # type: ignore[misc]
    found["head of 1 MB"] = (lambda page: page.ask(headers={"X": "a" * 1_000_000})), (400, 431, 0)
    found["websocket"] = (
        (lambda page: page.ask(method="GET", headers={"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Key": "eA=="})),
        (405, 400),
    )
    found["TLS"] = (lambda page: page.raw(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(300), shut=True)), (400, 0)
    found["HTTP/2"] = (lambda page: page.raw(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", shut=True)), (400, 404, 403, 405, 505, 0)
    return found


def values(page: Page) -> dict[str, tuple[str, Any]]:
    """By name: what no control holds; each is answered 422 with a sentence."""
    setting = page.answer("design-begin", {})[1]["setting"]
    wrong: dict[str, tuple[str, Any]] = {
        "nothing": ("design-update", None),
        "a list": ("design-track", [setting]),
        "one more control": ("design-update", {**setting, "__class__": "x"}),
        "one less": ("design-reach", {k: v for k, v in setting.items() if k != "payload_kg"}),
        "preset that is none": ("design-preset", {"setting": setting, "kind": "__init__", "pace": MARKUP}),
        "unhashable preset": ("design-preset", {"setting": setting, "kind": [], "pace": {}}),
        "saved beyond its range": ("design-save", {**setting, "payload_kg": 1e300}),
    }
    for name, value in {
        "phase_margin_deg": float("nan"),
        "suppression_db": float("inf"),
        "payload_kg": -1.0,
        "position_m": "0.1",
        "prefilter": MARKUP,
        "velocity_filter_s": 10**300,
        "loaded": 1,
        "position_phase_margin_deg": True,
    }.items():
        wrong[f"{name} = {str(value)[:12]}"] = (
            "design-save" if name in ("prefilter", "loaded") else "design-update",
            {**setting, name: value},
        )
    return wrong


def attacks(base: Path, folder: Path) -> Iterator[Outcome]:
    """All of them.   base : a commissioned run.   folder : for copies of it."""
    run = folder / "page"
    shutil.copytree(base, run)
    with served(run) as page:
        before = page.own_files()
        for name, (attack, statuses) in requests(page).items():
            status, answer = attack(page)
            broken = "it was answered" if status == 200 else "" if page.lives else "the page is dead"
            weak = f"status {status}, not {statuses}" if status not in statuses else ""
            if status > 0 and b"default-src 'none'" not in answer and status not in (400, 413, 431, 505):
                weak = weak or "without a policy"
            yield judged(GROUP, name, broken, weak)
        for name, (question, value) in values(page).items():
            status, said = page.answer(question, value)
            sentence = isinstance(said, dict) and isinstance(said.get("error"), str)
            yield judged(
                GROUP, name, "" if page.lives else "the page is dead", "" if (status, sentence) == (422, True) else f"{status} {said}"
            )
        yield from foreign_runs(page)
        yield from misshapen(page)
        yield judged(GROUP, "nothing was written by any of these", "files changed" if page.own_files() != before else "")
        yield slow(page)
        yield from at_once(page)
        yield removed(page)
    told = "".join(page.said)
    yield judged(GROUP, "what the terminal said", next((word for word in NEVER if word in told), ""))
    yield from names(base, folder)


def foreign_runs(page: Page) -> Iterator[Outcome]:
    """Names of runs that are none beside the one shown: each is 422 with a sentence."""
    for run in ("..", "/etc", "../page", "page/results", "nothing", "\x00", MARKUP, "a" * 5000, None, 1, ["page"], {"page": 1}):
        status, said = page.answer("begin", {}, run=run)
        sentence = isinstance(said, dict) and isinstance(said.get("error"), str)
        broken = "it was answered" if status == 200 else "" if page.lives else "the page is dead"
        yield judged(GROUP, f"run {str(run)[:12]!r}", broken, "" if (status, sentence) == (422, True) else f"{status} {said}")


def misshapen(page: Page) -> Iterator[Outcome]:
    """Every question that the page knows, asked with what it never sends: answered or 422, never an unexpected error."""
    own = RunPage(page.run)
    own.close()
    for name in sorted({*own.answers, "session-state", "session-offers", "session-start"}):
        if name not in ("words", "design-save"):  # what is saved is tried apart
            for asked in ([1, "x"], MARKUP, {"__class__": None}):
                status, said = page.answer(name, asked, PROOF_S)
                broken = f"{status} {said}" if status not in (200, 422) else "" if page.lives else "the page is dead"
                yield judged(GROUP, f"{name} asked {str(asked)[:12]}", broken)


def slow(page: Page) -> Outcome:
    """Connections that never end their question: the page answers others."""
    lines = [socket.create_connection(("127.0.0.1", page.port)) for _ in range(60)]
    for line in lines:
        line.sendall(b"POST /x HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Le")
    began = time.monotonic()
    lives = page.lives
    took_s = time.monotonic() - began
    for line in lines:
        line.close()
    return judged(
        GROUP, "60 questions that do not end", "" if lives else "the page is dead", f"others wait {took_s:.0f} s" if took_s > 5 else ""
    )


def at_once(page: Page) -> Iterator[Outcome]:
    """Two pages of one run, and another command at work on it."""
    setting = page.answer("design-begin", {})[1]["setting"]
    with served(page.run) as other, concurrent.futures.ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda one: one.answer("design-save", setting, PROOF_S), (page, other, page, other)))
    replaced = sorted(str(said.get("replaced", said)) for _, said in found)
    refused = [said for status, said in found if status == 422]
    kept = [name for name in replaced if name.startswith("designs/") and not (page.run / name).is_file()]
    lost = len(set(replaced)) + len(refused) < len(found) or any(status not in (200, 422) for status, _ in found)
    yield judged(GROUP, "four saves of two pages", f"{found}" if lost or kept else "")
    command = [sys.executable, "-m", "beltcomm", "fit", str(page.run)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as busy:
        time.sleep(1.5)
        status, said = page.answer("design-save", setting, PROOF_S)
        busy.wait()
    yield judged(GROUP, "saved while another command is at work", "" if status in (200, 422) else f"{status} {said}")


def removed(page: Page) -> Outcome:
    """The run goes while its page is open."""
    setting = page.answer("design-begin", {})[1]["setting"]
    gone = page.run.with_name("gone")
    page.run.rename(gone)
    try:
        status, said = page.answer("design-save", setting, PROOF_S)
        sentence = isinstance(said, dict) and isinstance(said.get("error"), str)
        left = page.run.exists()
    finally:
        shutil.rmtree(page.run, ignore_errors=True)
        gone.rename(page.run)
    broken = "" if page.lives else "the page is dead"
    return judged(GROUP, "the run's folder is gone", broken, "" if status == 422 and sentence and not left else f"{status} {said}")


def names(base: Path, folder: Path) -> Iterator[Outcome]:
    """Markup in names: of the axis, the run's folder, the move's file; on the page as a browser makes it, and in the report."""
    run = folder / "named <img src=x id=pwned>"
    shutil.copytree(base, run)
    axis = run / "axis.yaml"
    text = re.sub(r"(?m)^name:.*$", lambda _: f"name: {json.dumps(MARKUP)}", axis.read_text(encoding="utf-8"), count=1)
    axis.write_text(text, encoding="utf-8")
    move = folder / "<img id=pwned>.csv"
    rows = [f"{0.002 * k:.3f},{0.1 + 0.1 * (1 - math.cos(0.00628 * k)):.6f}" for k in range(501)]
    move.write_text("t_s,position_m\n" + "\n".join(rows) + "\n", encoding="utf-8")
    with served(run, "--move", str(move)) as page:
        status, said = page.answer("design-begin", {})
        told = isinstance(said, dict) and said["axis"].startswith("<img")
        yield judged(GROUP, "names travel as JSON", "" if status == 200 and told else f"{status} {said}")
        browser = shutil.which("chromium")
        if browser:
            command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=15000", "--dump-dom"]
            dom = subprocess.run(
                [*command, f"http://127.0.0.1:{page.port}/{page.token}/"], capture_output=True, text=True, timeout=PROOF_S, check=False
            ).stdout
            broken = "the browser made an element of a name" if re.search(r"<img[^>]*pwned", dom) else ""
            yield judged(GROUP, "names in a browser", broken, "" if "&lt;img" in dom else "the names are not shown")
    done = subprocess.run([sys.executable, "-m", "beltcomm", "report", str(run)], capture_output=True, text=True, check=False)
    pages = [path.read_text(encoding="utf-8") for path in run.rglob("*.html")]
    broken = "an element was made of a name" if any(re.search(r"<img[^>]*pwned", text) for text in pages) else ""
    yield judged(
        GROUP, "names in the report", broken or next((word for word in NEVER if word in done.stderr), ""), "" if pages else done.stderr
    )
    obeyed = any(mark in text for text in pages for mark in ("\x1b", "\u202e"))
    yield judged(GROUP, "characters that a browser obeys", "", "one is in the report" if obeyed else "")
