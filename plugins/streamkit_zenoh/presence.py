"""Presence of publishers and receivers by zenoh's liveliness tokens, rivals at a key, and delivery."""

import os
import socket
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import NamedTuple, Self
from urllib.parse import quote, unquote

import zenoh

from streamkit_zenoh.keys import ALIVE, LISTENING, alive_key, listening_key, listens_to
from streamkit_zenoh.wire.numbering import RecentDict

# Tokens come from the network: their number is bounded.
TOKEN_LIMIT = 10_000
CONFIRM_LIMIT_S = 5.0
QUERY_LIMIT_S = 2.0
GRACE_S = 1.0  # for a publisher that was killed to be missed
POLL_S = 0.1
EXCLUSIVE, SHARED, TAKEOVER = "exclusive", "shared", "takeover"
# Runs of this process whose session may still be closing in the background.
_ENDED: set[int] = set()


class LivelinessWatch:
    """Keeps the set of live tokens that match a key expression.

    A session reports tokens it knew before in a thread of its own, possibly after such a token's end. A token
    that is reported after its end is therefore queried, and counts again only if it replies.

    `changed` is called from zenoh's thread with the number of live tokens, after each change; `appeared` with
    each live token, before it is counted.
    """

    def __init__(
        self,
        session: zenoh.Session,
        expression: str,
        changed: Callable[[int], None] = lambda _count: None,
        appeared: Callable[[str], None] = lambda _token: None,
    ) -> None:
        self._session = session
        self._tokens: set[str] = set()
        self._ends: RecentDict[str, int] = RecentDict()  # how often each token has ended
        self._closed = False
        self._lock = threading.Lock()
        self._changed = changed
        self._appeared = appeared
        # Called in zenoh's own thread, so that a token's end follows the records sent before it.
        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self._subscriber = session.liveliness().declare_subscriber(expression, handler, history=True)

    def _take(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._lock:
                self._tokens.discard(token)
                self._ends[token] = self._ends.get(token, 0) + 1
                count = len(self._tokens)
            self._changed(count)
        elif not self._add(token, 0):
            self._query(token, self._ends.get(token, 0))

    def _add(self, token: str, ends: int) -> bool:
        """Adds a live token; False if it has ended more often than `ends`."""
        with self._lock:
            if self._closed or self._ends.get(token, 0) != ends:
                return False
            if len(self._tokens) < TOKEN_LIMIT:
                self._tokens.add(token)
            count = len(self._tokens)
        self._appeared(token)
        self._changed(count)
        return True

    def _query(self, token: str, ends: int) -> None:
        """Adds a token once it replies, unless it ends first."""

        def replied(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._add(token, ends)

        # In a thread of its own: zenoh holds a lock during the callback, and `changed` may query.
        handler = zenoh.handlers.Callback(replied, indirect=True)
        self._session.liveliness().get(token, handler, timeout=CONFIRM_LIMIT_S)

    def tokens(self) -> list[str]:
        """The live tokens."""
        with self._lock:
            return sorted(self._tokens)

    def close(self) -> None:
        """Stops watching."""
        with self._lock:
            self._closed = True
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def published_keys(session: zenoh.Session, limit_s: float) -> list[str]:
    """The keys of all publishers that a session reaches, as far as they reply within the limit."""
    replies = session.liveliness().get(
        alive_key("**"), zenoh.handlers.FifoChannel(TOKEN_LIMIT), timeout=limit_s
    )
    tokens = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
    return sorted(token.removesuffix(f"/{ALIVE}") for token in tokens)


def declare_receiver(session: zenoh.Session, records: str) -> list[Callable[[], object]]:
    """Shows that records of this key expression are received; returns the calls that undeclare it.

    Declare the subscriber first. Publishers may then ask whether all was received, as `wait_until_delivered`.
    """
    key = listening_key(str(session.info.zid()), records)

    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(key, b"")

    queryable = session.declare_queryable(key, zenoh.handlers.Callback(reply, indirect=False))
    token = session.liveliness().declare_token(key)
    return [token.undeclare, queryable.undeclare]


def wait_until_delivered(
    session: zenoh.Session,
    records: str,
    receivers: LivelinessWatch,
    limit_s: float,
    cancelled: threading.Event,
) -> bool:
    """Waits until receivers with a token, and a router in between, have received all; whether they have.

    A query of the lowest priority follows everything sent before. Without it the end of a session overtakes
    records under way, which are then lost.
    """
    tokens = [token for token in receivers.tokens() if listens_to(token, records)]
    # No queryable has this key; a router in between ends the query once it has come to it.
    queried = [*tokens, f"{LISTENING}/none/{session.info.zid()}"]
    finished = threading.Semaphore(0)

    def ignore(reply: zenoh.Reply) -> None:
        """Only the end of the replies counts."""

    for key in queried:
        session.get(
            key,
            zenoh.handlers.Callback(ignore, finished.release, indirect=False),
            # zenoh also ends a query without reply, which must not count as one.
            timeout=limit_s + 5.0,
            priority=zenoh.Priority.BACKGROUND,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
    deadline_s, count = time.monotonic() + limit_s, 0
    while count < len(queried) and time.monotonic() < deadline_s and not cancelled.is_set():
        count += finished.acquire(timeout=0.05)
    return count == len(queried)


def wait_for_receivers(
    publisher: zenoh.Publisher,
    receivers: LivelinessWatch,
    wanted: int,
    limit_s: float,
    cancelled: threading.Event,
) -> bool:
    """Waits until records reach `wanted` receivers; False at the time limit or when cancelled.

    zenoh reports whether a publisher has any subscriber, not how many. For one receiver any subscriber
    counts; for more, those with a receiver token are counted.
    """
    records, deadline_s = str(publisher.key_expr), time.monotonic() + limit_s
    while not cancelled.is_set():
        if is_matching(publisher) and (
            wanted <= 1 or sum(listens_to(token, records) for token in receivers.tokens()) >= wanted
        ):
            return True
        if time.monotonic() >= deadline_s:
            return False
        cancelled.wait(0.02)
    return False


def is_matching(publisher: zenoh.Publisher | None) -> bool:
    """Whether a publisher has a subscriber; False without a publisher, and once its session is closed."""
    if publisher is None:
        return False
    try:
        # zenoh's stub declares a bool; the library returns an object that is always true.
        return bool(getattr(publisher.matching_status, "matching", False))
    except zenoh.ZError:
        return False


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
