"""Requests to the pipeline of a feed, over its zenohsink's queryable."""

from __future__ import annotations

import msgspec
import zenoh

from streamkit_zenoh.keys import CONTROL
from streamkit_zenoh.wire.control import CONTROL_SCHEMA, ControlReply, ControlRequest
from streamkit_zenoh.wire.encodings import decode_json

LIMIT_S = 3.0
REPLY_LIMIT_BYTES = 1 << 20


def ask_control(session: zenoh.Session, key: str, request: ControlRequest | None) -> ControlReply:
    """Sets a live property, or with None asks for all; waits some seconds at most.

    Args:
        session: an open session.
        key: of the zenohsink.
        request: what to set.
    """
    payload = None if request is None else msgspec.json.encode(request)
    try:
        for reply in session.get(f"{key}/{CONTROL}", payload=payload, timeout=LIMIT_S):
            if reply.ok is not None and len(data := reply.ok.payload.to_bytes()) <= REPLY_LIMIT_BYTES:
                return decode_json(data, ControlReply)
        error = f"nothing answers at {key}/{CONTROL}; the publisher's zenohsink needs control=true"
    except (ValueError, zenoh.ZError) as failure:
        error = f"the reply at {key}/{CONTROL} is invalid: {failure}"
    return ControlReply(schema=CONTROL_SCHEMA, error=error)
