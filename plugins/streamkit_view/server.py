"""The server: the page's files, and a websocket for each page."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable
from importlib.resources import files
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from streamkit_view.access import AccessControl, log_once
from streamkit_view.hub import Hub
from streamkit_view.messages import Message
from streamkit_view.viewer import InvalidAnswer, Viewer

PAGE_LIMIT = 64
ANSWER_LIMIT_BYTES = 1024
LOOK_S = 1.0
STATE_EVERY_S = 0.5
POLICY_VIOLATION, TRY_LATER = 1008, 1013
MEDIA_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}


class ViewServer:
    """Serves the page.

    Args:
        hub: has the messages for pages.
        feeds: how many feeds there are.
        states: makes the messages with the states of all feeds.
        token: what a browser must show; "" for none.
    """

    def __init__(self, hub: Hub, feeds: int, states: Callable[[], list[Message]], token: str = "") -> None:
        self._hub = hub
        self._feeds = feeds
        self._states = states
        self._files = page_files()
        self._server = uvicorn.Server(
            uvicorn.Config(
                Starlette(
                    routes=[
                        Route("/", self._file),
                        Route("/{name}", self._file),
                        WebSocketRoute("/feed", self._page),
                    ],
                    middleware=[Middleware(AccessControl, token=token)],
                    lifespan=self._lifespan,
                ),
                log_config=None,
                access_log=False,
                server_header=False,
                ws="websockets-sansio",
                ws_max_size=ANSWER_LIMIT_BYTES,
                ws_per_message_deflate=False,
                ws_ping_interval=None,
                limit_concurrency=4 * PAGE_LIMIT,
                timeout_graceful_shutdown=1,
            )
        )

    async def serve(self, socket: Any) -> None:
        """Serves on a bound socket until SIGINT, SIGTERM or `stop`."""
        await self._server.serve(sockets=[socket])

    def stop(self) -> None:
        """Ends `serve`; may be called from any thread."""
        self._server.should_exit = True

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncIterator[None]:
        self._hub.attach_loop()
        publishing = asyncio.create_task(self._publish_states())
        yield
        publishing.cancel()

    async def _publish_states(self) -> None:
        while True:
            if self._hub.pages:
                for message in self._states():
                    self._hub.publish(message)
            await asyncio.sleep(STATE_EVERY_S)

    async def _file(self, request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in self._files:
            return PlainTextResponse("there is no such page\n", status_code=404)
        return Response(self._files[name], media_type=MEDIA_TYPES[name.rsplit(".", 1)[-1]])

    async def _page(self, websocket: WebSocket) -> None:
        await websocket.accept()
        if self._hub.pages >= PAGE_LIMIT:
            log_once(f"more than {PAGE_LIMIT} pages")
            await websocket.close(TRY_LATER)
            return
        viewer = Viewer()
        changed = self._hub.add(viewer)
        tasks = [
            asyncio.create_task(self._take_answers(websocket, viewer, changed)),
            asyncio.create_task(_send_messages(websocket, viewer, changed)),
            asyncio.create_task(_become_stuck(viewer)),
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            failures = [task.exception() for task in done]
        finally:
            self._hub.remove(viewer)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        failure = next((failure for failure in failures if failure is not None), None)
        if isinstance(failure, InvalidAnswer):
            log_once(f"a page's message: {failure}")
            await websocket.close(POLICY_VIOLATION)
        elif viewer.is_stuck:
            log_once("a page that reads nothing is cut off")
            self._abort(websocket)

    async def _take_answers(self, websocket: WebSocket, viewer: Viewer, changed: asyncio.Event) -> None:
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                received = await websocket.receive()
                if received["type"] != "websocket.receive":
                    return
                name, value = read_answer(received.get("text"))
                if name == "taken":
                    viewer.confirm(value)
                elif value < self._feeds:
                    self._hub.select(viewer, value)
                else:
                    raise InvalidAnswer("it selects a feed that does not exist")
                changed.set()

    def _abort(self, websocket: WebSocket) -> None:
        """Drops the connection: a close would wait for the page to read what is under way."""
        client = None if websocket.client is None else tuple(websocket.client)
        for connection in list(self._server.server_state.connections):
            if getattr(connection, "client", None) == client and connection.transport is not None:
                connection.transport.abort()


async def _send_messages(websocket: WebSocket, viewer: Viewer, changed: asyncio.Event) -> None:
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            changed.clear()
            while (message := viewer.next()) is not None:
                data = message.data
                await (websocket.send_text(data) if isinstance(data, str) else websocket.send_bytes(data))
            await changed.wait()


async def _become_stuck(viewer: Viewer) -> None:
    while not viewer.is_stuck:
        await asyncio.sleep(LOOK_S)


def read_answer(text: object) -> tuple[str, int]:
    """Reads a page's message: `{"taken": COUNT}` or `{"select": FEED}`.

    Raises:
        InvalidAnswer: it is another.
    """
    try:
        answer = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        answer = None
    if isinstance(answer, dict) and len(answer) == 1:
        name, value = next(iter(answer.items()))
        if name in ("taken", "select") and type(value) is int and value >= 0:
            return name, value
    raise InvalidAnswer("it is neither a count of messages taken nor the choice of a feed")


def page_files() -> dict[str, bytes]:
    """The files of the page by name. All are read once: no request names a path."""
    folder = files("streamkit_view") / "page"
    return {
        entry.name: entry.read_bytes()
        for entry in folder.iterdir()
        if entry.name.rsplit(".", 1)[-1] in MEDIA_TYPES
    }
