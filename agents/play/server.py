"""The server of `planarm play`: pages, and one session for each page over a websocket, on this machine only."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib import resources
from typing import Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from agents.console import COMPILING
from agents.play.session import Message, Session, catalogue, failure, first_policy
from envs.rendering.document import palette_document

HOST = "127.0.0.1"
FRAMES = 40
"""Frames a second."""
PATIENCE = 1.0
"""Time between two messages that say what a page is waiting for, s."""
LONGEST_MESSAGE = 10_000
"""Characters of a message that a page may send."""

_KINDS = {"html": "text/html", "js": "text/javascript", "css": "text/css"}
_FILES = {
    "": ("agents.play", "static/play.html"),
    "play.js": ("agents.play", "static/play.js"),
    "scene.js": ("agents.pages", "scene.js"),
    "style.css": ("agents.pages", "style.css"),
}
_Advanced = tuple[list[dict[str, Any]], dict[str, Any]]  # answers, and the frame
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'",
}


def application(
    first: Mapping[str, Any], *, settings: Mapping[str, Any], level: str | None, allow_code: bool
) -> Starlette:
    """The pages and the websocket.

    Args:
        first: what a new page plays, a `Choice` as a document.
        settings: of every environment.
        level: of the task of ``first``.
        allow_code: whether models of Stable-Baselines3 may be loaded.
    """

    async def play(socket: WebSocket) -> None:
        if not _same_origin(socket):
            await socket.close(code=1008)
            return
        await socket.accept()
        levels = {} if level is None else {first["env"]: level}
        chosen = list(first["policies"]) != [first_policy(first["env"])]
        await socket.send_json(
            {
                "kind": "welcome",
                "tasks": catalogue(),
                "first": first,
                "chosen": chosen,
                "palette": palette_document(),
            }
        )
        offered = tuple(first["policies"])
        session = Session(allow_code=allow_code, settings=settings, levels=levels, offered=offered)
        await _Page(socket, session).run()

    routes = [Route(f"/{name}", _file) for name in _FILES]
    middleware = [Middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"])]
    return Starlette(routes=[*routes, WebSocketRoute("/play", play)], middleware=middleware)


async def _file(request: Request) -> Response:
    package, path = _FILES[request.url.path.lstrip("/")]
    text = resources.files(package).joinpath(path).read_text(encoding="utf-8")
    return Response(text, media_type=_KINDS[path.rpartition(".")[2]], headers=_HEADERS)


def _same_origin(socket: WebSocket) -> bool:
    """Whether a page of this server asks: other pages in the browser may not."""
    headers = socket.headers
    return bool(headers.get("origin") == f"http://{headers.get('host')}")


class _Page:
    """One open page: takes its messages, advances its session in a thread, sends frames."""

    def __init__(self, socket: WebSocket, session: Session) -> None:
        self._socket, self._session = socket, session
        self._inbox: asyncio.Queue[Message] = asyncio.Queue(maxsize=200)
        # One thread a page: numba's code and planners run beside the server, one at a time.
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="planarm-page")
        self._bounding: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Until the page is closed."""
        reader = asyncio.create_task(self._read())
        writer = asyncio.create_task(self._play())
        try:
            _, unfinished = await asyncio.wait([reader, writer], return_when=asyncio.FIRST_COMPLETED)
            for each in unfinished:
                each.cancel()
            for ended in await asyncio.gather(reader, writer, return_exceptions=True):
                if isinstance(ended, Exception) and not isinstance(ended, WebSocketDisconnect):
                    raise ended  # unexpected: the server prints it, and closes the page's socket
        finally:
            if self._bounding is not None:
                self._bounding.cancel()
            self._thread.submit(self._session.close)
            self._thread.shutdown(wait=False)

    async def _read(self) -> None:
        """Put the page's messages into the inbox until the page has gone."""
        while (received := await self._socket.receive())["type"] == "websocket.receive":
            try:
                await self._inbox.put(_message(received.get("text")))
            except (ValueError, RecursionError) as error:
                await self._complain(error)

    async def _play(self) -> None:
        loop = asyncio.get_running_loop()
        last = loop.time()
        while True:
            began = loop.time()
            answers, frame = await self._explain_waiting(
                loop.run_in_executor(self._thread, self._advance, began - last, self._messages())
            )
            last = began
            for answer in answers:
                await self._send(answer)
                if answer["kind"] == "episode":
                    self._find_bound()
            await self._send(frame)
            await asyncio.sleep(max(0.0, began + 1.0 / FRAMES - loop.time()))

    async def _explain_waiting(self, advancing: asyncio.Future[_Advanced]) -> _Advanced:
        """Wait for the page's thread; every second the page is sent what it is waiting for."""
        compiled = COMPILING.functions
        while not (await asyncio.wait({advancing}, timeout=PATIENCE))[0]:
            count = COMPILING.functions - compiled
            text = f"Compiling, once: {count} functions so far. Later runs load them." if count else "Computing …"
            await self._send({"kind": "wait", "text": text})
        return advancing.result()

    def _find_bound(self) -> None:
        """Compute the best known value in another thread, and send it if the page still plays that episode."""
        if self._bounding is not None:
            self._bounding.cancel()
        compute = self._session.best_known()
        if compute is not None:
            self._bounding = asyncio.create_task(self._send_bound(compute))

    async def _send_bound(self, compute: Callable[[], str]) -> None:
        text = await asyncio.get_running_loop().run_in_executor(None, compute)
        with suppress(WebSocketDisconnect):
            await self._send({"kind": "bound", "text": text})

    def _messages(self) -> list[Message]:
        """All that have come; of choices, restarts, changes of one control, and places of the mouse, the last."""
        latest: dict[Any, Message] = {}
        for number in range(self._inbox.qsize()):
            message = self._inbox.get_nowait()
            lasting = message.do in ("choose", "restart", "change", "mouse")
            key = (message.do, message.key, message.index) if lasting else number
            latest.pop(key, None)
            latest[key] = message
        return list(latest.values())

    def _advance(self, seconds: float, messages: list[Message]) -> _Advanced:
        """In the page's thread: take messages, advance, and give answers and the frame."""
        answers = []
        for message in messages:
            if (answer := self._answer(message)) is not None:
                answers.append(answer)
        try:
            self._session.advance(seconds)
        except BaseException as error:  # of a policy of the user's own, which can fail in any way
            answers.append({"kind": "error", "text": self._session.stop(error)})
        return answers, self._session.frame()

    def _answer(self, message: Message) -> dict[str, Any] | None:
        """The session's answer to a message; a note if it refuses, or if a policy fails."""
        try:
            return self._session.take(message)
        except BaseException as error:  # of a policy, or of what makes it
            refused = isinstance(error, ValueError | ModuleNotFoundError) and message.do != "step"
            return {"kind": "error", "text": " ".join(str(error).split()) if refused else failure(error)}

    async def _complain(self, error: Exception) -> None:
        await self._send({"kind": "error", "text": " ".join(str(error).split())[:500]})

    async def _send(self, document: Mapping[str, Any]) -> None:
        """Send a document; raises WebSocketDisconnect if the page has gone."""
        text = json.dumps(document, separators=(",", ":"), allow_nan=False)
        try:
            await self._socket.send_text(text)
        except RuntimeError as error:
            raise WebSocketDisconnect from error


def _message(text: str | None) -> Message:
    """The message of a page from the text that it sent; None where it sent bytes. Raises ValueError for any other."""
    if text is None:
        raise ValueError("a message must be text")
    if len(text) > LONGEST_MESSAGE:
        raise ValueError(f"a message of {len(text)} characters; at most {LONGEST_MESSAGE}")
    document = json.loads(text)
    if not isinstance(document, dict):
        raise ValueError("a message must be a JSON object")
    return Message.parse(document, "message")


def open_socket(port: int) -> socket.socket:
    """A listening socket on this machine; port 0 is a free one.

    Raises:
        ValueError: if the port is taken or not allowed.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()  # so that a page that is opened at once waits for the server
    except (OSError, OverflowError) as error:
        listening.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise ValueError(f"port {port} cannot be used ({reason}): leave --port out for a free one") from None
    return listening
