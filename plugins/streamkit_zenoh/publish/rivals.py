"""Other publishers at the same key, found by liveliness tokens that say who they are."""

import os
import socket
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import NamedTuple, Self
from urllib.parse import quote, unquote

import zenoh

from streamkit_zenoh.presence import LivelinessWatch

QUERY_LIMIT_S = 2.0
GRACE_S = 1.0  # for a publisher that was killed to be missed
POLL_S = 0.1
EXCLUSIVE, SHARED, TAKEOVER = "exclusive", "shared", "takeover"
# Runs of this process whose session may still be closing in the background.
_ENDED: set[int] = set()


class KeyInUse(Exception):
    """Another publisher is at the key."""


class Claimant(NamedTuple):
    """Who publishes at a key.

    Attributes:
        claim: exclusive, shared or takeover.
        run: when it began, UTC ns; the first word of every attachment.
        host: its machine.
        process: number of its process.
    """

    claim: str
    run: int
    host: str
    process: int

    @classmethod
    def here(cls, claim: str, run: int) -> Self:
        """A publisher of this process."""
        return cls(claim, run, socket.gethostname(), os.getpid())

    @classmethod
    def of(cls, token: str) -> Self | None:
        """The publisher with a token; None for a token of another form."""
        try:
            claim, run, host, process = token.rsplit("/", 4)[1:]
            return cls(claim, int(run), unquote(host), int(process))
        except ValueError:
            return None

    def token(self, root: str) -> str:
        """The key of its liveliness token."""
        return f"{tokens_at(root)}/{self.claim}/{self.run}/{quote(self.host, safe='') or '-'}/{self.process}"

    def __str__(self) -> str:
        began = datetime.fromtimestamp(self.run // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        return f"run {self.run} on {self.host} (process {self.process}), started {began}"


def tokens_at(root: str) -> str:
    """The key above the tokens of the publishers at a key."""
    return f"{root}/publisher"


def refuse_rivals(session: zenoh.Session, root: str, cancelled: threading.Event) -> None:
    """Raises `KeyInUse` if another publisher stays at the key; one that was just killed is waited for."""
    deadline_s = time.monotonic() + GRACE_S
    while rivals := _others(session, root):
        if cancelled.wait(POLL_S):
            return
        if time.monotonic() >= deadline_s:
            raise KeyInUse(
                f"key={root}: another publisher is there: {rivals[0]}; name another key, end it, or set "
                "takeover=true (it ends) or shared=true (both publish)"
            )


def _others(session: zenoh.Session, root: str) -> list[Claimant]:
    replies = session.liveliness().get(f"{tokens_at(root)}/**", timeout=QUERY_LIMIT_S)
    found = [Claimant.of(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None]
    return [other for other in found if other is not None and other.run not in _ENDED]


class RivalWatch:
    """Shows this publisher to others, and notices one that takes its key over or should not be there.

    Of two exclusive publishers that could not see each other at the start, the later one ends. `found` is
    called from zenoh's thread with why this publisher must end.
    """

    def __init__(
        self, session: zenoh.Session, root: str, own: Claimant, found: Callable[[KeyInUse], None]
    ) -> None:
        self._root, self._own, self._found = root, own, found
        self._token = session.liveliness().declare_token(own.token(root))
        self._watch = LivelinessWatch(session, f"{tokens_at(root)}/**", appeared=self._appeared)

    def _appeared(self, token: str) -> None:
        other, own = Claimant.of(token), self._own
        if other is None or other == own:
            return
        is_later = (other.run, other.host, other.process) > own[1:]
        if other.claim == TAKEOVER and is_later:
            self._found(KeyInUse(f"key={self._root}: taken over by {other}"))
        elif own.claim == EXCLUSIVE and not is_later and other.claim != SHARED:
            self._found(KeyInUse(f"key={self._root}: another publisher was there before: {other}"))

    def close(self) -> None:
        """Stops watching; the key is free for another publisher of this process."""
        _ENDED.add(self._own.run)
        self._watch.close()
