"""Records as bytes: JSON, MessagePack, CBOR and protocol buffers, each with its schema's name."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import msgspec

if TYPE_CHECKING:
    from streamkit_zenoh.wire.protobuf import ProtobufMessage

# A record of ten thousand tracks has 3 MB; more is no record.
RECORD_LIMIT_BYTES = 4 * 1024 * 1024
REPLACEMENT = "\ufffd".encode()


class Form(enum.StrEnum):
    """How a record becomes bytes."""

    JSON = "json"
    MSGPACK = "msgpack"
    CBOR = "cbor"
    PROTOBUF = "protobuf"


class BadPayload(ValueError):
    """Bytes that are no record; says why."""


class MissingLibrary(ImportError):
    """A form needs a library that is not installed."""


Record = TypeVar("Record", bound=msgspec.Struct)


class Codec(Generic[Record]):
    """Turns records of one kind into bytes and back.

    Args:
        kind: the record's type; its field `schema` names it.
        schema: that name, `streamkit.tracks/1`.
        form: how.

    Raises:
        MissingLibrary: the form's library is not installed; names it.
    """

    def __init__(self, kind: type[Record], schema: str, form: Form) -> None:
        self.form = form
        self.schema = schema
        self.media_type = f"application/{form}"
        self.encoding = f"{self.media_type};{schema}"
        self._kind = kind
        makers: dict[Form, Callable[[], tuple[Callable[[Any], bytes], Callable[[Any], Record]]]] = {
            Form.JSON: self._json,
            Form.MSGPACK: self._msgpack,
            Form.CBOR: self._cbor,
            Form.PROTOBUF: self._protobuf,
        }
        self._encode, self._decode = makers[form]()

    def encode(self, record: Record) -> bytes:
        """The record as bytes."""
        return self._encode(record)

    def decode(self, data: bytes) -> Record:
        """Reads and checks a record; fields it does not know are skipped.

        Raises:
            BadPayload: the data is too large, or no record of this kind.
        """
        if len(data) > RECORD_LIMIT_BYTES:
            raise BadPayload(
                f"{len(data)} bytes are too many for a record, {RECORD_LIMIT_BYTES} is the limit"
            )
        try:
            return self._decode(data)
        except Exception as error:
            reason = str(error).partition("\n")[0][:200] or type(error).__name__
            raise BadPayload(f"no {self.schema} in {self.form}: {reason} [{len(data)} bytes]") from None

    def _json(self) -> tuple[Callable[[Any], bytes], Callable[[Any], Record]]:
        return msgspec.json.Encoder().encode, msgspec.json.Decoder(self._kind).decode

    def _msgpack(self) -> tuple[Callable[[Any], bytes], Callable[[Any], Record]]:
        decode = msgspec.msgpack.Decoder(self._kind).decode

        def checked(data: bytes) -> Record:
            record = decode(data)
            _demand_finite(msgspec.to_builtins(record))
            return record

        return msgspec.msgpack.Encoder().encode, checked

    def _cbor(self) -> tuple[Callable[[Any], bytes], Callable[[Any], Record]]:
        try:
            import cbor2
        except ImportError:
            raise _missing("cbor", "cbor2") from None

        def decode(data: bytes) -> Record:
            # With strict errors cbor2 5.9 never frees an error about bad text, nor the stack it carries.
            record = self._converted(cbor2.loads(data, str_errors="replace"))
            if REPLACEMENT in msgspec.json.encode(record) and REPLACEMENT not in data:
                raise ValueError("a text is no UTF-8")
            return record

        return lambda record: cbor2.dumps(msgspec.to_builtins(record)), decode

    def _protobuf(self) -> tuple[Callable[[Any], bytes], Callable[[Any], Record]]:
        try:
            from streamkit_zenoh.wire.protobuf import ProtobufMessage
        except ImportError:
            raise _missing("protobuf", "protobuf") from None
        message: ProtobufMessage = ProtobufMessage(self._kind.__name__)
        return lambda record: message.encode(msgspec.to_builtins(record)), lambda data: self._converted(
            message.decode(data)
        )

    def _converted(self, fields: Any) -> Record:
        record = msgspec.convert(fields, self._kind)
        _demand_finite(msgspec.to_builtins(record))
        return record


def form_of(encoding: str) -> Form | None:
    """The form that a zenoh encoding names; JSON where it says nothing, None for another one's."""
    media_type = encoding.partition(";")[0]
    if media_type in ("", "zenoh/bytes", "zenoh/string", "application/octet-stream", "text/json"):
        return Form.JSON
    return next((form for form in Form if media_type == f"application/{form}"), None)


def _demand_finite(value: Any) -> None:
    """JSON has no infinite numbers, and a record may have none in any form."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"numbers must be finite, got {value}")
    elif isinstance(value, dict):
        for item in value.values():
            _demand_finite(item)
    elif isinstance(value, list | tuple):
        for item in value:
            _demand_finite(item)


def _missing(form: str, library: str) -> MissingLibrary:
    return MissingLibrary(
        f"encoding={form} needs the library {library}, which is not installed; "
        "install it with: pip install 'streamkit[encodings]'"
    )
