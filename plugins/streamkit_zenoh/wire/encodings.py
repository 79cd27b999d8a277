"""Records as bytes: JSON, MessagePack, CBOR and protocol buffers."""

from __future__ import annotations

import enum
import functools
import json
import threading
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgspec

# A record of ten thousand tracks has 3 MB.
RECORD_LIMIT_BYTES = 4 * 1024 * 1024
REPLACEMENT = "\ufffd".encode()
# Held while msgspec looks into a type for the first time: another thread must not decode it meanwhile.
_inspecting_type = threading.Lock()


class Encoding(enum.StrEnum):
    """Serialisation format of a record."""

    JSON = "json"
    MSGPACK = "msgpack"
    CBOR = "cbor"
    PROTOBUF = "protobuf"


LIBRARIES = {Encoding.CBOR: "cbor2", Encoding.PROTOBUF: "protobuf"}


class BadPayload(ValueError):
    """Bytes that are not a valid record; the message says why."""


class MissingLibrary(ImportError):
    """An encoding needs a library that is not installed."""


Record = TypeVar("Record", bound=msgspec.Struct)


class Codec(Generic[Record]):
    """Encodes and decodes records of one type, whose schema has this name, `streamkit.tracks/1`.

    Attributes:
        content_type: encoding and schema as zenoh's encoding holds them.

    Raises:
        MissingLibrary: the encoding's library is not installed; names it.
    """

    def __init__(self, kind: type[Record], schema: str, encoding: Encoding) -> None:
        self.encoding = encoding
        self.content_type = f"application/{encoding};{schema}"
        self._schema = schema
        self.encode: Callable[[Record], bytes] = msgspec.json.encode
        with _inspecting_type:
            self._decode: Callable[[bytes], Record] = msgspec.json.Decoder(kind).decode
        if encoding is not Encoding.JSON:
            try:
                self.encode, loads = _serialiser(encoding, kind.__name__)
            except ImportError:
                raise MissingLibrary(
                    f"encoding={encoding} needs the library {LIBRARIES[encoding]}, which is not installed; "
                    "install it with: pip install 'streamkit[encodings]'"
                ) from None
            self._decode = lambda data: _checked(msgspec.convert(loads(data), kind), data)

    def decode(self, data: bytes) -> Record:
        """Decodes and validates a record; unknown fields are skipped.

        Raises:
            BadPayload: the data is too large, or not a record of this type.
        """
        if len(data) > RECORD_LIMIT_BYTES:
            raise BadPayload(
                f"{len(data)} bytes are too many for a record, {RECORD_LIMIT_BYTES} is the limit"
            )
        try:
            return self._decode(data)
        except Exception as error:
            reason = str(error).partition("\n")[0][:200] or type(error).__name__
            raise BadPayload(f"no {self._schema} in {self.encoding}: {reason} [{len(data)} bytes]") from None


@functools.cache
def _codec(kind: type[Record], schema: str, encoding: Encoding) -> Codec[Record]:
    return Codec(kind, schema, encoding)


def decode_message(kind: type[Record], schema: str, content_type: str, data: bytes) -> Record:
    """Decodes and validates a record in the encoding that its zenoh encoding names.

    Raises:
        BadPayload: it is none, or its encoding is unknown or its library not installed.
    """
    encoding = encoding_of(content_type)
    if encoding is None:
        raise BadPayload(f"{content_type[:80]!r} is no encoding of records")
    try:
        codec: Codec[Record] = _codec(kind, schema, encoding)
    except MissingLibrary as error:
        raise BadPayload(str(error)) from None
    return codec.decode(data)


def encoding_of(content_type: str) -> Encoding | None:
    """The encoding that a zenoh encoding names: JSON for an unspecific one, None for another."""
    media_type = content_type.partition(";")[0]
    if media_type in ("", "zenoh/bytes", "zenoh/string", "application/octet-stream", "text/json"):
        return Encoding.JSON
    return next((encoding for encoding in Encoding if media_type == f"application/{encoding}"), None)


def _serialiser(encoding: Encoding, message: str) -> tuple[Callable[[Any], bytes], Callable[[bytes], Any]]:
    """The functions that write a record, and read its fields, in another encoding than JSON."""
    if encoding is Encoding.MSGPACK:
        return msgspec.msgpack.encode, msgspec.msgpack.decode
    if encoding is Encoding.CBOR:
        import cbor2

        # With strict errors cbor2 5.9 leaks the exception about invalid text, and the stack it refers to.
        loads = functools.partial(cbor2.loads, str_errors="replace")
        return lambda record: cbor2.dumps(msgspec.to_builtins(record)), loads
    from streamkit_zenoh.wire.protobuf import ProtobufMessage

    fields = ProtobufMessage(message)
    return lambda record: fields.encode(msgspec.to_builtins(record)), fields.decode


def _checked(record: Record, data: bytes) -> Record:
    """The record; raises ValueError where JSON could not have its values."""
    try:
        json.dumps(msgspec.to_builtins(record), allow_nan=False)
    except ValueError:
        raise ValueError("numbers must be finite") from None
    if REPLACEMENT in msgspec.json.encode(record) and REPLACEMENT not in data:
        raise ValueError("text is not UTF-8")
    return record


def decode_json(data: bytes, kind: type[Record]) -> Record:
    """Decodes and validates a JSON message of any sender.

    Raises:
        ValueError: it is none of this kind.
    """
    try:
        return msgspec.json.decode(data, type=kind)
    except RecursionError as error:
        raise ValueError(str(error)) from None
