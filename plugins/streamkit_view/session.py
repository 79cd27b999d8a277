"""One run of `streamkit view`: zenoh session, feeds and server."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable

import msgspec
import zenoh

from streamkit import mask_secrets
from streamkit_view.access import Access
from streamkit_view.basemap import Basemap
from streamkit_view.feed import Feed
from streamkit_view.hub import Hub
from streamkit_view.messages import STATE, PageMessage, text_message
from streamkit_view.playback import PlayedPipeline, PrintedLine
from streamkit_view.server import ViewServer
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.keys import CONTROL
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.wire.control import CONTROL_SCHEMA, ControlReply, ControlRequest
from streamkit_zenoh.wire.encodings import decode_json

CLOSE_LIMIT_S = 2.0
REPLY_LIMIT_S = 3.0
REPLY_LIMIT_BYTES = 1 << 20


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
