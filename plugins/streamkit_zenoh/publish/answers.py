"""Answers for those who come late: the last message of each key, and the schemas."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import zenoh

from streamkit_zenoh.keys import RECEIVER
from streamkit_zenoh.wire.schemas import schema_files, schema_index


class Answer(NamedTuple):
    """What is answered for one key."""

    key: str
    payload: bytes
    encoding: zenoh.Encoding
    attachment: bytes | None = None


Provider = Callable[[zenoh.KeyExpr], Iterable[Answer]]
Asking = Callable[[zenoh.KeyExpr, str | None], Iterable[Answer]]


class Answers:
    """Answers queries below a key, each with every message known there whose key is asked for.

    Args:
        session: an open session.
        root: the key, `uav/1`; queries for `uav/1/**` are answered.
        failed: called with what a provider raised, from zenoh's thread.
    """

    def __init__(
        self, session: zenoh.Session, root: str, failed: Callable[[Exception], None] = lambda error: None
    ) -> None:
        self._providers: list[Asking] = []
        self._failed = failed
        handler = zenoh.handlers.Callback(self._answer, indirect=False)
        self._queryable = session.declare_queryable(f"{root}/**", handler)

    def add(self, provider: Provider) -> None:
        """Adds a provider: asked with the key expression of a query, it gives what it has there."""
        self._providers.append(lambda asked, receiver: provider(asked))

    def add_personal(self, provider: Asking) -> None:
        """Adds a provider that is told, too, who asks: the end of the receiver's token, where it says so."""
        self._providers.append(provider)

    def close(self) -> None:
        """Answers no more."""
        self._queryable.undeclare()  # type: ignore[no-untyped-call]

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            receiver = query.parameters.get(RECEIVER)
            for provider in self._providers:
                try:
                    for key, payload, encoding, attachment in provider(query.key_expr, receiver):
                        query.reply(key, payload, encoding=encoding, attachment=attachment)
                except Exception as error:
                    self._failed(error)


def schema_answers(asked: zenoh.KeyExpr, root: str) -> Iterable[Answer]:
    """What is answered below `root`: everything at `root` itself, and each file at `root/NAME`."""
    if asked.intersects(root):
        yield Answer(root, schema_index(), zenoh.Encoding.APPLICATION_JSON)
    for name, content in schema_files().items():
        if asked.intersects(f"{root}/{name}"):
            media_type = "application/schema+json" if name.endswith(".json") else "text/plain"
            yield Answer(f"{root}/{name}", content, zenoh.Encoding(media_type))
