"""Messages to the page: text is JSON, binary is a JSON header and the bytes of an image or packet."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass

VIDEO, TRACKS, FRAME, MOSAIC = "video", "tracks", "frame", "mosaic"
HELLO, STATE, SKIPPED, CONTROL, BACK = "hello", "state", "skipped", "control", "back"


@dataclass(frozen=True, slots=True)
class PageMessage:
    """A message to pages.

    Attributes:
        kind: one of the constants of this module.
        feed: index of its feed.
        data: what is sent; shared by all pages.
        is_keyframe: whether decoding can begin with this packet.
    """

    kind: str
    feed: int
    data: str | bytes
    is_keyframe: bool = False


def text_message(kind: str, feed: int, body: bytes) -> PageMessage:
    """A message whose `body` is a JSON value."""
    return PageMessage(kind, feed, f'{{"type":"{kind}","feed":{feed},"body":{body.decode()}}}')


def binary_message(
    kind: str, feed: int, body: bytes, payload: bytes, extra: dict[str, object], *, is_keyframe: bool = False
) -> PageMessage:
    """A message with a payload: length of the header (uint32, little endian), the header, the payload."""
    header = f'{{"type":"{kind}","feed":{feed},"extra":{json.dumps(extra)},"body":{body.decode()}}}'.encode()
    return PageMessage(kind, feed, struct.pack("<I", len(header)) + header + payload, is_keyframe)
