"""A page for the browser of this computer alone: 127.0.0.1, a secret in its address, and no name but its own."""

from __future__ import annotations

import hmac
import json
import logging
import re
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from werkzeug.exceptions import BadRequest, Forbidden, HTTPException, NotFound, UnsupportedMediaType
from werkzeug.routing import Map, Rule
from werkzeug.wrappers import Request, Response

from beltcomm.errors import BeltcommError, UsageError
from beltcomm.outside import from_json
from beltcomm.result import jsonable

if TYPE_CHECKING:
    from _typeshed.wsgi import WSGIApplication

HOST = "127.0.0.1"
#: Names under which this computer's own browser knows the page.  Another one is a foreign site whose name was bent to this computer.
OWN_NAMES = (HOST, "localhost")
#: Bytes of a question at most; threads that answer.
LONGEST, THREADS = 65536, 4
KINDS = {"html": "text/html; charset=utf-8", "css": "text/css; charset=utf-8", "js": "text/javascript; charset=utf-8"}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_PORT = re.compile(r":\d+\Z")
Answers = Mapping[str, Callable[[Any], Mapping[str, Any]]]


@dataclass(frozen=True)
class PageFiles:
    """Files of a page, by the names under which a browser asks, and no other file.

    Attributes
    ----------
    html : str
        Of the page itself.
    beside : Mapping[str, str]
        Of others, each with its place in this package.
    """

    html: str
    beside: Mapping[str, str]

    def text(self, name: str = "") -> str:
        """A file by its name.

        Parameters
        ----------
        name : str
            "" for the page.

        Raises
        ------
        KeyError
            For one that is no part of it.
        """
        place = self.beside[name] if name else self.html
        return files("beltcomm.web").joinpath(place).read_text(encoding="utf-8")


_PARTS = ("open", "words", "chart", "laboratory", "record", "design", "live", "runs")
#: The page of ``beltcomm open``.
PAGE = PageFiles(
    "open.html",
    {name: name for name in ("open.css", *(f"{part}.js" for part in _PARTS))}
    | {name: f"vendor/{name}" for name in ("uPlot.iife.min.js", "uPlot.min.css")},
)


@dataclass(frozen=True)
class ServedPage:
    """A page that is served.

    Attributes
    ----------
    address : str
        For a browser here.
    run : callable
        Until KeyboardInterrupt.
    end : callable
        The same from another thread.
    """

    address: str
    run: Callable[[], None]
    end: Callable[[], None]


def application(page: PageFiles, answers: Answers, token: str) -> WSGIApplication:
    """The page under /TOKEN/, its files beside it, and every answer to a POST of JSON to /TOKEN/NAME.

    An answer that raises BeltcommError becomes 422 with the sentence.   Anything without the token is not found, under another host's name
    or from another site's page forbidden.

    Parameters
    ----------
    page : PageFiles
    answers : Answers
        By the last part of their address.
    token : str
        Long enough that nobody guesses it.
    """
    rules = [Rule("/<secret>/", endpoint="html", methods=["GET"])]
    rules += [Rule(f"/<secret>/{name}", endpoint=f"file {name}", methods=["GET"]) for name in page.beside]
    rules += [Rule(f"/<secret>/{name}", endpoint=f"answer {name}", methods=["POST"]) for name in answers]
    places = Map(rules, strict_slashes=True, redirect_defaults=False)

    def answered(request: Request) -> Response:
        _own(request)
        endpoint, values = places.bind_to_environ(request.environ).match()
        if not hmac.compare_digest(values["secret"].encode(), token.encode()):
            raise NotFound
        if endpoint.startswith("answer "):
            return _answer(answers[endpoint.removeprefix("answer ")], _asked(request))
        name = endpoint.removeprefix("file ") if endpoint.startswith("file ") else ""
        return Response(page.text(name), content_type=KINDS[(name or page.html).rpartition(".")[2]])

    @Request.application
    def serve_one(request: Request) -> Response:
        request.max_content_length = LONGEST
        try:
            response = answered(request)
        except HTTPException as problem:
            response = Response(f"{problem.description}\n", problem.code, content_type="text/plain; charset=utf-8")
        response.headers.update(HEADERS)
        return response

    return serve_one


@contextmanager
def serve(page: PageFiles, answers: Answers, token: str, port: int = 0) -> Iterator[ServedPage]:
    """A page on 127.0.0.1.

    Parameters
    ----------
    page : PageFiles
    answers : Answers
        What it may ask, by name.
    token : str
        Secret part of its address.
    port : int
        0 takes a free one.

    Raises
    ------
    UsageError
        For one that is taken.
    """
    from waitress import wasyncore
    from waitress.server import create_server

    try:
        listening = socket.create_server((HOST, port))
    except OSError as problem:
        raise UsageError(
            f"port {port} of {HOST} cannot be used: {problem.strerror or problem}; leave --port out to take a free one"
        ) from None
    logging.getLogger("waitress.queue").setLevel(logging.ERROR)  # a question that waits a moment for a thread is no news
    connected: dict[int, Any] = {}

    def disconnect() -> None:
        wasyncore.close_all(connected)  # with nobody left to listen to, the server's loop ends

    server = create_server(
        application(page, answers, token),
        map=connected,
        sockets=[listening],
        threads=THREADS,
        ident=None,
        max_request_body_size=LONGEST,  # refused by its announcement, not waited for
    )
    try:
        yield ServedPage(
            f"http://{HOST}:{listening.getsockname()[1]}/{token}/", server.run, lambda: server.trigger.pull_trigger(disconnect)
        )
    finally:
        server.task_dispatcher.shutdown()
        disconnect()
        listening.close()


def _own(request: Request) -> None:
    """Raise Forbidden for a foreign name of this computer, and for a page of another site that asks."""
    host = request.headers.get("Host", "")
    if _PORT.sub("", host) not in OWN_NAMES:
        raise Forbidden(f"this page is for {HOST} only")
    origin = request.headers.get("Origin")
    if origin is not None and origin != f"http://{host}":
        raise Forbidden("another site asks; this page answers its own only")


def _asked(request: Request) -> Any:
    if request.mimetype != "application/json":
        raise UnsupportedMediaType("questions are JSON")
    try:
        return from_json(request.get_data())
    except ValueError:
        raise BadRequest("this is no JSON") from None


def _answer(answer: Callable[[Any], Mapping[str, Any]], asked: Any) -> Response:
    status = 200
    try:
        found: Mapping[str, Any] = answer(asked)
    except BeltcommError as problem:
        found, status = {"error": str(problem)}, 422
    except Exception as problem:  # what nobody thought of, as on the command line: a sentence there, the details for -v
        logging.getLogger("beltcomm.web").info("an answer failed", exc_info=True)
        found, status = {"error": f"an unexpected error: {type(problem).__name__}: {problem}"}, 500
    try:
        text = json.dumps(found, allow_nan=False)
    except (TypeError, ValueError):  # numbers that are not finite, arrays: rare, and looking for them takes longer than the rest
        text = json.dumps(jsonable(found), allow_nan=False)
    return Response(text, status, content_type="application/json")
