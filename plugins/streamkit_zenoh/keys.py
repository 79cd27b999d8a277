"""The keys of zenoh that streamkit uses: where records go, and who is there."""

from urllib.parse import quote, unquote

import zenoh

RECORDS = "tracks"
ALIVE = "alive"
# Receivers' tokens lie apart from the users' keys: a receiver's key may have wildcards, a token's not.
LISTENING = "streamkit/listening"


class InvalidKey(ValueError):
    """A text is no key, or has wildcards where one key is needed."""


def records_key(key: str) -> str:
    """The key expression of the records: `uav/1` gives `uav/1/tracks`, and `uav/*` gives `uav/*/tracks`.

    A text that ends in `/tracks` is taken as it is.

    Raises:
        InvalidKey: zenoh does not take it.
    """
    expression = key if key == RECORDS or key.endswith(f"/{RECORDS}") else f"{key}/{RECORDS}"
    try:
        return str(zenoh.KeyExpr(expression))
    except zenoh.ZError:
        raise InvalidKey(
            f"a key must be words joined by single slashes, without # ? $, got {key!r}; "
            "write for example uav/1"
        ) from None


def publication_key(key: str) -> str:
    """The one key records are published at.

    Raises:
        InvalidKey: it is none, or has wildcards.
    """
    expression = records_key(key)
    if "*" in expression:
        raise InvalidKey(f"a publisher's key must not have wildcards, got {key!r}; write for example uav/1")
    return expression


def alive_key(records: str) -> str:
    """Where a publisher of `records` shows that it lives: `uav/1/tracks` gives `uav/1/alive`."""
    return records.removesuffix(RECORDS) + ALIVE


def listening_key(session: str, records: str) -> str:
    """Where a receiver shows that it listens; carries its key expression, escaped into one word."""
    return f"{LISTENING}/{session}/{quote(records, safe='')}"


def listens_to(token: str, records: str) -> bool:
    """Whether a receiver's token says that it receives what is published at `records`."""
    try:
        return zenoh.KeyExpr(unquote(token.rsplit("/", 1)[-1])).includes(records)
    except zenoh.ZError:
        return False
