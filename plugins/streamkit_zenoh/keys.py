"""The zenoh keys that streamkit uses: streams below a user's key, and liveliness tokens."""

from urllib.parse import quote, unquote

import zenoh

TRACKS = "tracks"
TRACK = "track"
FRAME = "frame"
MOSAIC = "mosaic"
VIDEO = "video"
STATUS = "status"
SCHEMA = "schema"
ALIVE = "alive"
CONTROL = "control"
STREAMS = (TRACKS, FRAME, MOSAIC, VIDEO, STATUS)
# Receivers' tokens lie outside the users' keys: a receiver's key may have wildcards, a token may not.
LISTENING = "streamkit/listening"
# Query parameter that holds the name of the asking receiver.
RECEIVER = "receiver"


class InvalidKey(ValueError):
    """A text is not a key, or has wildcards where one key is needed."""


def records_key(key: str) -> str:
    """The key expression of the records: `uav/1` gives `uav/1/tracks`, and `uav/*` gives `uav/*/tracks`.

    A text that ends in `/tracks` stays as it is, and so does the key of one track, `uav/1/track/7`.

    Raises:
        InvalidKey: zenoh does not accept it.
    """
    words = key.split("/")
    return _checked(key, key) if len(words) > 2 and words[-2] == TRACK else stream_key(key, TRACKS)


def stream_key(key: str, stream: str) -> str:
    """The key expression of one of the streams below a key: `uav/1` and `frame` give `uav/1/frame`.

    A text that ends in the stream's name stays as it is.

    Raises:
        InvalidKey: zenoh does not accept it.
    """
    return _checked(key if key.rpartition("/")[2] == stream else f"{key}/{stream}", key)


def _checked(expression: str, key: str) -> str:
    try:
        if any(word != word.strip() for word in expression.split("/")):  # zenoh takes even a lone space
            raise zenoh.ZError
        return str(zenoh.KeyExpr(expression))
    except zenoh.ZError:
        raise InvalidKey(
            f"a key must be words joined by single slashes, without # ? $ or a space at an end, got {key!r}; "
            "write for example uav/1"
        ) from None


def publication_root(key: str) -> str:
    """The key below which a publisher's streams are: `uav/1` and `uav/1/tracks` give `uav/1`.

    Raises:
        InvalidKey: zenoh does not accept it, it has wildcards, or nothing precedes `tracks`.
    """
    root = root_of(stream_key(key, TRACKS))
    if "*" in root:
        raise InvalidKey(f"a publisher's key must not have wildcards, got {key!r}; write for example uav/1")
    if not root:
        raise InvalidKey(f"a publisher's key must be more than {key!r}; write for example uav/1")
    return root


def root_of(expression: str) -> str:
    """The key above the stream: `uav/1/tracks` and `uav/1/track/7` give `uav/1`."""
    words = expression.split("/")
    if len(words) > 1 and words[-2] == TRACK:
        return "/".join(words[:-2])
    return "/".join(words[:-1]) if words[-1] in STREAMS else expression


def alive_key(expression: str) -> str:
    """Key of a publisher's liveliness token: `uav/1/tracks` gives `uav/1/alive`."""
    root = root_of(expression)
    return f"{root}/{ALIVE}" if root else ALIVE


def listening_key(session: str, records: str) -> str:
    """Key of a receiver's liveliness token: the id of its session, its key expression escaped into a word."""
    return f"{LISTENING}/{session}/{quote(records, safe='')}"


def listens_to(token: str, records: str) -> bool:
    """Whether the receiver with this token receives what is published at `records`."""
    try:
        return zenoh.KeyExpr(unquote(token.rsplit("/", 1)[-1])).includes(records)
    except zenoh.ZError:
        return False
