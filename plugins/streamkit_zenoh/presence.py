"""Who is there: publishers that live, and receivers that listen, shown by zenoh's liveliness tokens."""

import threading
from collections import OrderedDict
from collections.abc import Callable

import zenoh

from streamkit_zenoh.keys import LISTENING, alive_key, listening_key, listens_to
from streamkit_zenoh.wire.numbering import remember

# Tokens come from the network: their number is bounded.
TOKEN_LIMIT = 10_000
CONFIRM_LIMIT_S = 5.0


class Watch:
    """Keeps the set of tokens below a key expression.

    A session tells a watch of the tokens it knew before in a thread of its own, which may come after such a
    token's end. So a token told after its end is asked for: only one that answers is there again.

    Args:
        session: an open session.
        expression: which tokens.
        changed: called from zenoh's thread with the number of tokens there, after each change.
        appeared: called from zenoh's thread with each token that is there, before it is counted.
    """

    def __init__(
        self,
        session: zenoh.Session,
        expression: str,
        changed: Callable[[int], None] | None = None,
        appeared: Callable[[str], None] | None = None,
    ) -> None:
        self._session = session
        self._tokens: set[str] = set()
        self._ended: OrderedDict[str, int] = OrderedDict()  # how often each has ended
        self._closed = False
        self._lock = threading.Lock()
        self._changed = changed
        self._appeared = appeared
        # Called in zenoh's own thread, so that a token's end is seen behind the records sent before it.
        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self._subscriber = session.liveliness().declare_subscriber(expression, handler, history=True)

    def _take(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._lock:
                self._tokens.discard(token)
                remember(self._ended, token, self._ended.get(token, 0) + 1)
                count = len(self._tokens)
            self._tell(count)
        elif not self._appears(token, 0):
            self._confirm(token, self._ended.get(token, 0))

    def _appears(self, token: str, ends: int) -> bool:
        """Notes a token that is there; False where it has ended more often than said."""
        if self._appeared is not None:
            self._appeared(token)
        with self._lock:
            if self._closed or self._ended.get(token, 0) != ends:
                return False
            if len(self._tokens) < TOKEN_LIMIT:
                self._tokens.add(token)
            count = len(self._tokens)
        self._tell(count)
        return True

    def _confirm(self, token: str, ends: int) -> None:
        """Takes a token as there once somebody says so, unless it ends first."""

        def answered(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._appears(token, ends)

        # In a thread of its own: zenoh holds a lock while it tells answers, and `changed` may ask for more.
        handler = zenoh.handlers.Callback(answered, indirect=True)
        self._session.liveliness().get(token, handler, timeout=CONFIRM_LIMIT_S)

    def _tell(self, count: int) -> None:
        if self._changed is not None:
            self._changed(count)

    def count(self, wanted: Callable[[str], bool] = lambda token: True) -> int:
        """How many tokens are there that are wanted."""
        with self._lock:
            return sum(wanted(token) for token in self._tokens)

    def tokens(self, wanted: Callable[[str], bool]) -> list[str]:
        """The tokens that are there and wanted."""
        with self._lock:
            return sorted(token for token in self._tokens if wanted(token))

    def close(self) -> None:
        """Stops watching."""
        with self._lock:
            self._closed = True
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def show_publisher(session: zenoh.Session, records: str) -> zenoh.LivelinessToken:
    """Shows that records are published at this key, for as long as the session is open.

    Leave the token to the session's close: taken back by itself, its end overtakes records under way.
    """
    return session.liveliness().declare_token(alive_key(records))


def show_receiver(session: zenoh.Session, records: str) -> zenoh.LivelinessToken:
    """Shows that records of this key expression are received; declare the subscriber first."""
    return session.liveliness().declare_token(listening_key(str(session.info.zid()), records))


def confirm_receiver(session: zenoh.Session, records: str) -> zenoh.Queryable[None]:
    """Lets publishers ask whether everything they have sent has been taken: see `wait_until_taken`."""
    key = listening_key(str(session.info.zid()), records)

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(key, b"")

    return session.declare_queryable(key, zenoh.handlers.Callback(answer, indirect=False))


def wait_until_taken(
    session: zenoh.Session, records: str, receivers: Watch, limit_s: float, cancelled: threading.Event
) -> bool:
    """Waits until what was sent has been taken by receivers that show themselves, and by a router between.

    A question of the lowest priority comes behind all that was sent before. Without it the end of a session
    overtakes records that are under way, and they are lost.

    Returns:
        Whether all have answered, or there was nobody to ask.
    """
    tokens = receivers.tokens(lambda token: listens_to(token, records))
    # Nobody answers at this key; a router on the way says so when it has come to the question.
    asked = [*tokens, f"{LISTENING}/nobody/{session.info.zid()}"]
    left = threading.Semaphore(0)

    def ignore(reply: zenoh.Reply) -> None:
        """Only the end of the answers counts."""

    for key in asked:
        session.get(
            key,
            zenoh.handlers.Callback(ignore, left.release, indirect=False),
            # zenoh ends a question that is not answered, too: that must not look like an answer.
            timeout=limit_s + 5.0,
            priority=zenoh.Priority.BACKGROUND,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
    waited_s, answered = 0.0, 0
    while answered < len(asked) and waited_s < limit_s and not cancelled.is_set():
        if left.acquire(timeout=0.05):
            answered += 1
        else:
            waited_s += 0.05
    return answered == len(asked)


def watch_receivers(session: zenoh.Session, appeared: Callable[[str], None] | None = None) -> Watch:
    """Watches every receiver that shows itself; see `Watch` for `appeared`."""
    return Watch(session, f"{LISTENING}/**", appeared=appeared)


def wait_for_receivers(
    publisher: zenoh.Publisher, receivers: Watch, wanted: int, limit_s: float, cancelled: threading.Event
) -> bool:
    """Waits until records would reach `wanted` receivers.

    zenoh tells a publisher whether it has any subscriber, not how many. So for one receiver that is asked,
    and any subscriber counts; for more, those that show themselves with `show_receiver` are counted.

    Returns:
        Whether they are there; False when the time is over or the wait was cancelled.
    """
    records = str(publisher.key_expr)
    left_s = limit_s
    while not cancelled.is_set():
        # zenoh's stub says bool, the library gives an object that is always true.
        matching = getattr(publisher.matching_status, "matching", False)
        if matching and (wanted <= 1 or receivers.count(lambda token: listens_to(token, records)) >= wanted):
            return True
        if left_s <= 0:
            return False
        cancelled.wait(0.02)
        left_s -= 0.02
    return False
