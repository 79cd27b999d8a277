"""What goes through the control channel of a child process: orders to it, answers and reports from it."""

from __future__ import annotations

import builtins
from typing import Any

import msgspec

from streamkit import errors
from streamkit.crossing.values import ValueDecoder, encode_mapping
from streamkit.errors import ElementFailure, StreamkitError
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.statistics import ElementStatistics, ProcessStatistics

Counters = tuple[list[ElementStatistics], list[ProcessStatistics]]
# Methods of elements that other processes may call; they return plain numbers, a tuple arrives as a list.
QUERIES = ("latency", "duration_ns", "renegotiate")
REBUILT = (errors.StateError, errors.ResourceError, errors.NotNegotiated, errors.PropertyError, OSError)


class Setup(msgspec.Struct, tag=True):
    """The first message to a child: which part of which graph it runs.

    Attributes:
        text, variables: the description.
        number: of the process among those of the graph.
        properties: encoded values of all elements, in order.
        watchdog_s: limit of an element's calls, s.
    """

    text: str
    variables: dict[str, str]
    number: int
    properties: list[dict[str, Any]]
    watchdog_s: float


class Order(msgspec.Struct, tag=True):
    """An order to the child, such as `play`; it answers each one."""

    number: int
    name: str
    arguments: list[Any] = []


class Failure(msgspec.Struct, tag=True):
    """An exception; `kind` is the class of the cause, the rest as in `ElementFailure`."""

    kind: str
    text: str
    element: str = ""
    factory: str = ""
    frame: str = ""
    place: str = ""
    traceback: str = ""


class OrderResult(msgspec.Struct, tag=True):
    """The result of an order."""

    number: int
    value: Any = None
    failure: Failure | None = None


class Posted(msgspec.Struct, tag=True):
    """A message for the bus."""

    kind: str
    source: str
    text: str
    fields: dict[str, Any]
    failure: Failure | None


class Dropped(msgspec.Struct, tag=True):
    """Frames that a link has lost; counted by the parent, because the child's counters may die with it."""

    number: int
    reason: str
    count: int


Report = OrderResult | Posted | Dropped
ENCODER = msgspec.msgpack.Encoder()
REPORTS = msgspec.msgpack.Decoder(Report)
ORDERS = msgspec.msgpack.Decoder(Setup | Order)


def encode_failure(error: BaseException) -> Failure:
    """An exception in a form that crosses."""
    if isinstance(error, ElementFailure):
        cause = error.cause
        return Failure(
            type(cause).__name__, str(cause), error.element, error.factory, error.frame,
            error.place, error.traceback,
        )  # fmt: skip
    return Failure(type(error).__name__, str(error))


def decode_failure(failure: Failure) -> Exception:
    """The exception of the other process: with the same text, and the same class where that is well known."""
    kind = getattr(errors, failure.kind, None) or getattr(builtins, failure.kind, None)
    cause: Exception
    if isinstance(kind, type) and issubclass(kind, REBUILT):
        cause = kind(failure.text)
    elif isinstance(kind, type) and issubclass(kind, StreamkitError):
        cause = StreamkitError(failure.text)
    else:
        cause = StreamkitError(f"{failure.kind}: {failure.text}" if failure.text else failure.kind)
    if not failure.element:
        return cause
    return ElementFailure(
        failure.element, failure.factory, cause, failure.frame, failure.place, failure.traceback
    )


def encode_message(message: Message) -> Posted:
    """A message of the bus in a form that crosses."""
    failure = None if message.error is None else encode_failure(message.error)
    return Posted(str(message.kind), message.source, message.text, encode_mapping(message.fields), failure)


def decode_message(posted: Posted, decoder: ValueDecoder) -> Message:
    """The message of the other process; raises `ValueError` if it is none."""
    fields = {name: decoder.decode(value) for name, value in posted.fields.items()}
    error = None if posted.failure is None else decode_failure(posted.failure)
    return Message(MessageKind(posted.kind), posted.source, posted.text, fields, error)
