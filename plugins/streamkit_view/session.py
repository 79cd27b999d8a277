"""One run of `streamkit view`: zenoh session, feeds and server, until a signal."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import sys
import time

import msgspec
from msgspec import structs

from streamkit import mask_secrets
from streamkit_view.access import LOG, Access
from streamkit_view.basemap import Basemap
from streamkit_view.control import ask_control
from streamkit_view.feed import Feed
from streamkit_view.hub import Hub
from streamkit_view.messages import STATE, PageMessage, text_message
from streamkit_view.playback import PlayedPipeline
from streamkit_view.server import ViewServer
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.wire.control import ControlReply, ControlRequest

CLOSE_LIMIT_S = 2.0


def run_server(
    keys: list[str],
    bound: socket.socket,
    access: Access,
    connect: str | None,
    config: str | None,
    playback: PlayedPipeline | None = None,
    basemap: Basemap | None = None,
) -> None:
    """Serves the page until SIGINT or SIGTERM.

    Raises:
        OSError: zenoh cannot open its session.
        ValueError: a key or an endpoint is malformed.
    """
    LOG.addHandler(logging.StreamHandler(sys.stderr))
    hub = Hub(len(keys), playback.start if playback else lambda: None)
    feeds: list[Feed] = []

    def states() -> list[PageMessage]:
        failure, waiting = (playback.failure, playback.progress) if playback else ("", "")
        is_alone = connect is not None and not list(zenoh_session.info.transports())
        if is_alone:
            failure = f"No connection to {mask_secrets(connect or '')}; retrying."
        now_s = time.monotonic()
        found = []
        for index, feed in enumerate(feeds):
            state = structs.replace(
                feed.state(failure, waiting), history_s=round(hub.history[index].span_s(now_s), 1)
            )
            found.append(text_message(STATE, index, msgspec.json.encode(state)))
        return found

    def ask(feed: int, request: ControlRequest | None) -> ControlReply:
        return ask_control(zenoh_session, feeds[feed].key, request)

    server = ViewServer(hub, len(keys), states, ask, access, basemap)
    for number in (signal.SIGINT, signal.SIGTERM):
        # A signal may come before the server handles signals itself; it raises them again at its end.
        signal.signal(number, lambda _number, _frame: server.stop())
    zenoh_session = open_session(SessionSettings(connect=connect, config=config))
    try:
        for index, key in enumerate(keys):
            feeds.append(Feed(zenoh_session, key, index, hub.deliver, playback.title if playback else ""))
        asyncio.run(server.serve(bound))
    finally:
        undeclare = [call for feed in feeds for call in feed.close()]
        close_session(zenoh_session, CLOSE_LIMIT_S, undeclare=undeclare)
