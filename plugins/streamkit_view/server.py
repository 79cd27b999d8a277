"""The server: the page's files, and a websocket for each page."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import time
from collections.abc import AsyncIterator, Callable
from importlib.resources import files
from pathlib import PurePath

import msgspec
import uvicorn
import zenoh
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from streamkit import mask_secrets
from streamkit_view.access import Access, AccessControl, log_once
from streamkit_view.basemap import Basemap
from streamkit_view.feed import Feed
from streamkit_view.hub import Hub
from streamkit_view.messages import STATE, PageMessage, text_message
from streamkit_view.page_socket import Ask, PageSocket
from streamkit_view.playback import PlayedPipeline, PrintedLine
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.keys import CONTROL
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.wire.encodings import decode_json
from streamkit_zenoh.wire.messages import CONTROL_SCHEMA, ControlReply, ControlRequest

PAGE_LIMIT = 64
ANSWER_LIMIT_BYTES = 1024
STATE_EVERY_S = 0.5
TRY_LATER = 1013
SCRIPT = "text/javascript"
MEDIA_TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": SCRIPT,
    ".mjs": SCRIPT,
    ".svg": "image/svg+xml",
}
CLOSE_LIMIT_S = 2.0
REPLY_LIMIT_S = 3.0
REPLY_LIMIT_BYTES = 1 << 20


class ViewServer:
    """Serves the page with what the hub has for it.

    `states` makes the messages with the states of all feeds; `ask` passes a request to the pipeline of one.
    """

    def __init__(
        self,
        hub: Hub,
        states: Callable[[], list[PageMessage]],
        ask: Ask,
        access: Access,
        basemap: Basemap | None,
    ) -> None:
        self._hub = hub
        self._states = states
        self._ask = ask
        self._basemap = basemap
        self._files = page_files()
        self._server = uvicorn.Server(
            uvicorn.Config(
                Starlette(
                    routes=[
                        Route("/", self._file),
                        Route("/basemap", self._send_basemap),
                        Route("/{name}", self._file),
                        WebSocketRoute("/feed", self._page),
                    ],
                    middleware=[Middleware(AccessControl, access=access)],
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

    async def serve(self, bound: socket.socket) -> None:
        """Serves on a bound socket until SIGINT, SIGTERM or `stop`."""
        await self._server.serve(sockets=[bound])

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
        return Response(self._files[name], media_type=MEDIA_TYPES[PurePath(name).suffix])

    async def _send_basemap(self, _request: Request) -> Response:
        basemap = self._basemap
        if basemap is None:
            return PlainTextResponse("there is no base map\n", status_code=404)
        if isinstance(basemap.content, bytes):
            return Response(basemap.content, media_type=basemap.media_type)
        return FileResponse(basemap.content, media_type=basemap.media_type)

    async def _page(self, websocket: WebSocket) -> None:
        await websocket.accept()
        if self._hub.pages >= PAGE_LIMIT:
            log_once(f"more than {PAGE_LIMIT} pages")
            await websocket.close(TRY_LATER)
            return
        if await PageSocket(websocket, self._hub, self._ask, self._basemap).serve():
            log_once("a page that reads nothing is cut off")
            self._abort(websocket)

    def _abort(self, websocket: WebSocket) -> None:
        """Resets the connection: a close, and the kernel too, would wait for the page to read."""
        client = None if websocket.client is None else tuple(websocket.client)
        for connection in list(self._server.server_state.connections):
            if getattr(connection, "client", None) == client and connection.transport is not None:
                resetting = struct.pack("ii", 1, 0)  # on, and no time for what is under way
                socket_of_page = connection.transport.get_extra_info("socket")
                socket_of_page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, resetting)
                connection.transport.abort()


def page_files() -> dict[str, bytes]:
    """The files of the page and its libraries by name. All are read once: no request names a path."""
    return {
        entry.name: entry.read_bytes()
        for folder in ("page", "vendor")
        for entry in (files("streamkit_view") / folder).iterdir()
        if PurePath(entry.name).suffix in MEDIA_TYPES
    }


def run_server(
    keys: list[str],
    bound: socket.socket,
    access: Access,
    connect: str | None,
    config: str | None,
    playback: PlayedPipeline | None,
    basemap: Basemap | None,
    *,
    on_created: Callable[[ViewServer], object],
) -> None:
    """Serves the page until its server is stopped.

    Args:
        keys: of the publishers shown, a feed each.
        bound: socket that the server listens on.
        access: who may see and control.
        connect: of the zenoh session, see `SessionSettings`.
        config: likewise.
        playback: a pipeline that is played for the page, or None.
        basemap: of the map, or None.
        on_created: called with the server before anything can block, so that a signal can stop it.

    Raises:
        OSError: zenoh cannot open its session.
        ValueError: a key or an endpoint is malformed.
    """
    hub = Hub(len(keys), playback.start if playback else lambda: None)
    feeds: list[Feed] = []

    def states() -> list[PageMessage]:
        failure, waiting = (playback.failure, playback.progress) if playback else ("", "")
        printed = playback.printed if playback else PrintedLine()
        if connect is not None and not list(zenoh_session.info.transports()):
            failure = f"No connection to {mask_secrets(connect)}; retrying."
        now_s = time.monotonic()
        spans = [history.span_s(now_s) for history in hub.history]
        found = [
            feed.state(span_s, failure, waiting, printed) for feed, span_s in zip(feeds, spans, strict=True)
        ]
        return [text_message(STATE, at, msgspec.json.encode(state)) for at, state in enumerate(found)]

    def ask(feed: int, request: ControlRequest | None) -> ControlReply:
        return ask_control(zenoh_session, feeds[feed].key, request)

    server = ViewServer(hub, states, ask, access, basemap)
    on_created(server)
    zenoh_session = open_session(SessionSettings(connect=connect, config=config))
    try:
        for index, key in enumerate(keys):
            feeds.append(Feed(zenoh_session, key, index, hub.deliver, playback.title if playback else ""))
        asyncio.run(server.serve(bound))
    finally:
        undeclare = [call for feed in feeds for call in feed.close()]
        close_session(zenoh_session, CLOSE_LIMIT_S, undeclare=undeclare)


def ask_control(session: zenoh.Session, key: str, request: ControlRequest | None) -> ControlReply:
    """Sets a live property of the pipeline at a key, or with None asks for all; waits a few seconds."""
    payload = None if request is None else msgspec.json.encode(request)
    try:
        for reply in session.get(f"{key}/{CONTROL}", payload=payload, timeout=REPLY_LIMIT_S):
            if reply.ok is not None and len(data := reply.ok.payload.to_bytes()) <= REPLY_LIMIT_BYTES:
                return decode_json(data, ControlReply)
        error = f"nothing answers at {key}/{CONTROL}; the publisher's zenohsink needs control=true"
    except (ValueError, zenoh.ZError) as failure:
        error = f"the reply at {key}/{CONTROL} is invalid: {failure}"
    return ControlReply(schema=CONTROL_SCHEMA, error=error)
