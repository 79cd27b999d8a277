"""The websocket of one page: messages to it, its answers, and its requests to pipelines."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from streamkit_view.access import log_once
from streamkit_view.basemap import Basemap
from streamkit_view.history import replay
from streamkit_view.hub import Hub, Viewer
from streamkit_view.messages import BACK, CONTROL, HELLO, InvalidAnswer, read_answer, text_message
from streamkit_zenoh.wire.messages import CONTROL_SCHEMA, ControlReply, ControlRequest

POLL_S = 1.0
REQUEST_LIMIT = 16
POLICY_VIOLATION = 1008
NO_TOKEN = "changes need the token: open the address that `streamkit view` printed"

Ask = Callable[[int, ControlRequest | None], ControlReply]


class PageSocket:
    """Serves one page until it leaves, sends nonsense or is stuck.

    `ask` passes a request to the pipeline of a feed, and gives its reply within some seconds.
    """

    def __init__(self, websocket: WebSocket, hub: Hub, ask: Ask, basemap: Basemap | None) -> None:
        self._websocket = websocket
        self._hub = hub
        self._ask = ask
        self._may_control = bool(websocket.scope.get("may_control"))
        self._basemap = None if basemap is None else {"corners": basemap.corners}
        self._viewer = Viewer()
        self._replay: asyncio.Task[None] | None = None
        self._requests: asyncio.Queue[tuple[int, ControlRequest | None]] = asyncio.Queue(REQUEST_LIMIT)

    async def serve(self) -> bool:
        """Returns at the end; True if the page reads nothing, so that its connection must be dropped."""
        viewer = self._viewer
        hello = msgspec.json.encode({"control": self._may_control, "basemap": self._basemap})
        viewer.offer(text_message(HELLO, 0, hello))  # before what the hub has for a new page
        self._hub.add(viewer)
        works = (self._take_answers, self._send_messages, self._reply_to_requests, self._become_stuck)
        tasks = [asyncio.create_task(work()) for work in works]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._hub.remove(viewer)
            self._end_replay()
            failures = [task.exception() for task in tasks if task.done() and not task.cancelled()]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        failure = next(filter(None, failures), None)
        if isinstance(failure, InvalidAnswer):
            log_once(f"a page's message: {failure}")
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # the page may be gone already
                await self._websocket.close(POLICY_VIOLATION)
        return failure is None and viewer.is_stuck

    async def _take_answers(self) -> None:
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                received = await self._websocket.receive()
                if received["type"] != "websocket.receive":
                    return
                name, value = read_answer(received.get("text"))
                if name == "taken":
                    self._viewer.confirm(value)
                elif name == "control":
                    self._queue(value)
                elif name == "back":
                    self._go_back(value)
                elif name == "stills":
                    self._viewer.shows_stills = value
                elif value < len(self._hub.history):
                    self._end_replay()
                    self._hub.select(self._viewer, value)
                else:
                    raise InvalidAnswer("it selects a feed that does not exist")

    def _go_back(self, back_s: int) -> None:
        """Shows the past; what comes after the answer `back` belongs to it."""
        viewer = self._viewer
        self._end_replay()
        feed = viewer.feed
        viewer.select(feed, is_live=back_s == 0)
        viewer.offer(text_message(BACK, feed, msgspec.json.encode({"s": back_s})))
        if back_s:
            self._replay = asyncio.create_task(replay(self._hub.history[feed], back_s, viewer.offer))
        else:
            self._hub.greet(viewer)

    def _end_replay(self) -> None:
        if self._replay is not None:
            self._replay.cancel()
            self._replay = None

    def _queue(self, request: ControlRequest | None) -> None:
        if self._requests.full():
            raise InvalidAnswer(f"it makes more than {REQUEST_LIMIT} requests without waiting")
        self._requests.put_nowait((self._viewer.feed, request))

    async def _reply_to_requests(self) -> None:
        while True:
            feed, request = await self._requests.get()
            if self._may_control:
                reply = await asyncio.to_thread(self._ask, feed, request)
            else:
                log_once("a request to control without the token")
                reply = ControlReply(schema=CONTROL_SCHEMA, error=NO_TOKEN)
            body = msgspec.json.encode({"request": request, "reply": reply})
            self._viewer.offer(text_message(CONTROL, feed, body))

    async def _send_messages(self) -> None:
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                self._viewer.changed.clear()
                while (message := self._viewer.next()) is not None:
                    data = message.data
                    if isinstance(data, str):
                        await self._websocket.send_text(data)
                    else:
                        await self._websocket.send_bytes(data)
                await self._viewer.changed.wait()

    async def _become_stuck(self) -> None:
        while not self._viewer.is_stuck:
            await asyncio.sleep(POLL_S)
