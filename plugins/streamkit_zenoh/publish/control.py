"""Control: live properties of the pipeline's elements, listed and set by queries at KEY/control."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import msgspec
import zenoh

from streamkit import Element, StreamkitError
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_zenoh.keys import CONTROL
from streamkit_zenoh.publish.numbered_stream import Publisher
from streamkit_zenoh.wire.messages import (
    CONTROL_SCHEMA,
    ControlReply,
    ControlRequest,
    LiveProperty,
    PropertyChange,
    read_request,
)

# More requests than a person makes; the oldest of more stays without reply.
CAPACITY = 32


class Control:
    """Answers queries at KEY/control about the pipeline's elements in a thread of its own, `executor`."""

    def __init__(self, publisher: Publisher, elements: Callable[[], Sequence[Element]]) -> None:
        self._key = f"{publisher.root}/{CONTROL}"
        self._elements = elements
        self._changes: dict[tuple[str, str], PropertyChange] = {}
        self.executor = BackgroundExecutor("zenoh control", publisher.failed, capacity=CAPACITY)
        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self._queryable = publisher.session.declare_queryable(self._key, handler)

    def changes(self) -> tuple[PropertyChange, ...]:
        """The properties that were set, each with its last value."""
        return tuple(self._changes.copy().values())

    def abandon(self) -> None:
        """Drops the requests that wait."""
        self.executor.abandon()

    def close(self) -> None:
        """Undeclares the queryable; the executor is its owner's to close."""
        self._queryable.undeclare()  # type: ignore[no-untyped-call]

    def _reply(self, asked: str, payload: bytes) -> ControlReply:
        """The reply to a query for `asked`; sets a property if the payload requests it."""
        if not payload:
            return ControlReply(schema=CONTROL_SCHEMA, properties=tuple(live_properties(self._elements())))
        try:
            if asked != self._key:
                raise ValueError(f"a request names one publisher, {self._key}, got {asked}")
            found = self._set(read_request(payload))
        except (ValueError, StreamkitError) as error:
            return ControlReply(schema=CONTROL_SCHEMA, error=str(error))
        return ControlReply(schema=CONTROL_SCHEMA, properties=(found,))

    def _take(self, query: zenoh.Query) -> None:
        self.executor.submit_dropping(lambda: self._answer(query))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            payload = b"" if query.payload is None else query.payload.to_bytes()
            reply = self._reply(str(query.key_expr), payload)
            encoding = zenoh.Encoding(f"application/json;{CONTROL_SCHEMA}")
            query.reply(self._key, msgspec.json.encode(reply), encoding=encoding)

    def _set(self, request: ControlRequest) -> LiveProperty:
        element = next((one for one in self._elements() if full_name(one) == request.element), None)
        if element is None:
            raise ValueError(
                f"no element {request.element!r} in the pipeline; ask without payload for those that it has"
            )
        declaration = element.find_property(request.property)
        if not declaration.live or declaration.readonly:
            raise ValueError(
                f"{request.element}: property {declaration.spelling} cannot change while playing; "
                "stop the pipeline to set it"
            )
        try:
            element.set_property(declaration.name, request.value)
        except StreamkitError:
            raise
        except Exception as error:
            # The property's owner is a plugin: whatever it raises is an answer, not the end of this thread.
            raise declaration.refusal(
                request.value, f"{type(error).__name__}: {error}", element.name
            ) from None
        found = next(item for item in live_properties([element]) if item.property == declaration.spelling)
        shown = "" if found.value is None else str(found.value)
        change = PropertyChange(element=found.element, property=found.property, value=shown)
        self._changes[found.element, found.property] = change
        element.post_message("property-set", property=found.property, value=shown, by="control")
        return found


def full_name(element: Element) -> str:
    """The name of an element, after that of its bin."""
    return f"{element.parent}/{element.name}" if element.parent else element.name


def live_properties(elements: Sequence[Element]) -> Iterator[LiveProperty]:
    """What may change while the pipeline plays; secrets are masked."""
    for element in elements:
        for declaration in element.properties.values():
            if declaration.live and not declaration.readonly:
                yield LiveProperty(
                    element=full_name(element),
                    factory=element.factory,
                    property=declaration.spelling,
                    type=declaration.kind.__name__,
                    value=declaration.to_json(getattr(element, declaration.attribute)),
                    choices=declaration.choices,
                    minimum=declaration.to_json(declaration.minimum),
                    maximum=declaration.to_json(declaration.maximum),
                    unit=declaration.unit,
                    doc=declaration.doc,
                )
