"""Replies to queries: the last message of each key, for receivers that come late."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import zenoh

from streamkit_zenoh.keys import RECEIVER


class Reply(NamedTuple):
    """The reply for one key."""

    key: str
    payload: bytes
    encoding: zenoh.Encoding
    attachment: bytes | None = None


# Called with the key expression of a query and the name of the receiver that asks, if it gives one.
Provider = Callable[[zenoh.KeyExpr, str | None], Iterable[Reply]]


class QueryResponder:
    """Replies to queries below a key.

    Args:
        session: an open session.
        root: the key, `uav/1`; queries that match `uav/1/**` are replied to.
        providers: each yields its replies to a query.
        failed: called in zenoh's thread with what a provider raised.
    """

    def __init__(
        self,
        session: zenoh.Session,
        root: str,
        providers: Iterable[Provider],
        failed: Callable[[Exception], None],
    ) -> None:
        self._providers = list(providers)
        self._failed = failed
        handler = zenoh.handlers.Callback(self._reply, indirect=False)
        self._queryable = session.declare_queryable(f"{root}/**", handler)

    def close(self) -> None:
        """Undeclares the queryable."""
        self._queryable.undeclare()  # type: ignore[no-untyped-call]

    def _reply(self, query: zenoh.Query) -> None:
        with query:
            receiver = query.parameters.get(RECEIVER)
            for provider in self._providers:
                try:
                    for key, payload, encoding, attachment in provider(query.key_expr, receiver):
                        query.reply(key, payload, encoding=encoding, attachment=attachment)
                except Exception as error:
                    self._failed(error)
