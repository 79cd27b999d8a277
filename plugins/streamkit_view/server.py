"""The server: the page's files, and a websocket for each page."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
from collections.abc import AsyncIterator, Callable
from importlib.resources import files
from pathlib import PurePath

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from streamkit_view.access import Access, AccessControl, log_once
from streamkit_view.basemap import Basemap
from streamkit_view.hub import Hub
from streamkit_view.messages import PageMessage
from streamkit_view.page_socket import Ask, PageSocket

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
