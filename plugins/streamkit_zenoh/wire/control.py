"""Requests to change live properties of a pipeline at KEY/control, and the replies."""

from __future__ import annotations

from typing import Literal

import msgspec

from streamkit_zenoh.wire.encodings import decode_json

CONTROL_SCHEMA: Literal["streamkit.control/1"] = "streamkit.control/1"
REQUEST_LIMIT_BYTES = 4096
Value = bool | int | float | str | None


class ControlRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The payload of a query that sets a property; a query without payload asks for all live properties.

    Attributes:
        element: name in the pipeline.
        property: its live property.
        value: the new value; a text is read as in a description.
    """

    element: str
    property: str
    value: Value


class LiveProperty(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A property that may change while the pipeline plays.

    Attributes:
        element, property: names, as in a request.
        factory: type of the element.
        type: bool, int, float, str, Fraction, Caps, or the name of an enumeration.
        value: at the moment.
        choices: the words of an enumeration.
        minimum, maximum, unit, doc: as `streamkit inspect` prints them.
    """

    element: str
    factory: str
    property: str
    type: str
    value: Value = None
    choices: tuple[str, ...] = ()
    minimum: Value = None
    maximum: Value = None
    unit: str = ""
    doc: str = ""


class ControlReply(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The reply to a query.

    Attributes:
        schema: name and version of the schema.
        error: why nothing was set.
        properties: all live properties, or the one that was set.
    """

    schema: Literal["streamkit.control/1"]
    error: str | None = None
    properties: tuple[LiveProperty, ...] = ()


def read_request(data: bytes) -> ControlRequest:
    """Decodes and validates a request.

    Raises:
        ValueError: it is too large, or none.
    """
    if len(data) > REQUEST_LIMIT_BYTES:
        raise ValueError(f"a request has at most {REQUEST_LIMIT_BYTES} bytes, got {len(data)}")
    try:
        return decode_json(data, ControlRequest)
    except ValueError as error:
        raise ValueError(f'{error}; write {{"element": NAME, "property": NAME, "value": VALUE}}') from None
