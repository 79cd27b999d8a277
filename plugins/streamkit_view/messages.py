"""Messages to the page and its answers.

To the page text is JSON, binary is a JSON header and a payload, as an image or packet; answers are JSON.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
from msgspec import structs

from streamkit_zenoh.wire.encodings import decode_json
from streamkit_zenoh.wire.messages import ControlRequest

VIDEO, TRACKS, FRAME, MOSAIC, TILE = "video", "tracks", "frame", "mosaic", "tile"
HELLO, STATE, SKIPPED, CONTROL, BACK = "hello", "state", "skipped", "control", "back"
BACK_LIMIT_S = 3600
Identity = tuple[str, int, tuple[int, int] | None]
Natural = Annotated[int, msgspec.Meta(ge=0, le=2**53)]


@dataclass(frozen=True, slots=True)
class PageMessage:
    """A message to pages.

    Attributes:
        kind: one of the constants of this module.
        feed: index of its feed.
        data: what is sent; shared by all pages.
        is_keyframe: whether decoding can begin with this packet.
        part: column and row of a tile of the mosaic.
    """

    kind: str
    feed: int
    data: str | bytes
    is_keyframe: bool = False
    part: tuple[int, int] | None = None

    @property
    def identity(self) -> Identity:
        """What it is about: a later message replaces those of its identity, but for video and records."""
        return self.kind, self.feed, self.part

    def is_void_after(self, later: PageMessage) -> bool:
        """Whether a later message replaces this one: a tile goes with the mosaic that it is of, too."""
        return self.identity == later.identity or (
            self.kind == TILE and later.kind == MOSAIC and self.feed == later.feed
        )


def text_message(kind: str, feed: int, body: bytes) -> PageMessage:
    """A message whose `body` is a JSON value."""
    return PageMessage(kind, feed, f'{{"type":"{kind}","feed":{feed},"body":{body.decode()}}}')


def binary_message(
    kind: str,
    feed: int,
    body: bytes,
    payload: bytes,
    *,
    is_keyframe: bool = False,
    part: tuple[int, int] | None = None,
) -> PageMessage:
    """A message with a payload: length of the header (uint32, little endian), the header, the payload."""
    header = f'{{"type":"{kind}","feed":{feed},"body":{body.decode()}}}'.encode()
    return PageMessage(kind, feed, struct.pack("<I", len(header)) + header + payload, is_keyframe, part)


class InvalidAnswer(ValueError):
    """A page sent something that pages do not send."""


class PageAnswer(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A message of a page, with exactly one field.

    Attributes:
        taken: how many messages the page has taken in all.
        select: index of the feed that it shows.
        back: how many seconds to go back in time; 0 is live.
        control: a live property to set; None asks for all of them.
        stills: whether it shows images of the feed, having no video that it can decode.
    """

    taken: Natural | msgspec.UnsetType = msgspec.UNSET
    select: Natural | msgspec.UnsetType = msgspec.UNSET
    back: Annotated[int, msgspec.Meta(ge=0, le=BACK_LIMIT_S)] | msgspec.UnsetType = msgspec.UNSET
    control: ControlRequest | msgspec.UnsetType | None = msgspec.UNSET
    stills: bool | msgspec.UnsetType = msgspec.UNSET


def read_answer(text: object) -> tuple[str, Any]:
    """Reads a page's message: name and value of its field.

    Raises:
        InvalidAnswer: it is another.
    """
    given: dict[str, Any] = {}
    if isinstance(text, str):
        with suppress(ValueError):
            given = structs.asdict(decode_json(text.encode(), PageAnswer))
    given = {name: value for name, value in given.items() if value is not msgspec.UNSET}
    if len(given) != 1:
        raise InvalidAnswer(
            "it is no count of messages taken, choice of a feed, time to go back, or request to control"
        )
    return given.popitem()
