"""Records as bytes: JSON, MessagePack, CBOR and protocol buffers."""

from __future__ import annotations

import enum
import functools
import json
from collections.abc import Callable
from typing import Generic, TypeVar

import msgspec

# A record of ten thousand tracks has 3 MB.
RECORD_LIMIT_BYTES = 4 * 1024 * 1024
REPLACEMENT = "\ufffd".encode()


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
Functions = tuple[Callable[[Record], bytes], Callable[[bytes], Record]]


class Codec(Generic[Record]):
    """Encodes and decodes records of one type.

    Args:
        kind: the record's type.
        schema: name of its schema, `streamkit.tracks/1`.
        encoding: the serialisation format.

    Attributes:
        content_type: encoding and schema as zenoh's encoding holds them.

    Raises:
        MissingLibrary: the encoding's library is not installed; names it.
    """

    def __init__(self, kind: type[Record], schema: str, encoding: Encoding) -> None:
        self.encoding = encoding
        self.content_type = f"application/{encoding};{schema}"
        self._schema = schema
        makers: dict[Encoding, Callable[[type[Record]], Functions[Record]]] = {
            Encoding.JSON: _json,
            Encoding.MSGPACK: _msgpack,
            Encoding.CBOR: _cbor,
            Encoding.PROTOBUF: _protobuf,
        }
        try:
            self.encode, self._decode = makers[encoding](kind)
        except ImportError:
            raise MissingLibrary(
                f"encoding={encoding} needs the library {LIBRARIES[encoding]}, which is not installed; "
                "install it with: pip install 'streamkit[encodings]'"
            ) from None

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


class Decoder(Generic[Record]):
    """Decodes records of one type, with the schema of this name, in the encoding that each message names."""

    def __init__(self, kind: type[Record], schema: str) -> None:
        self._codec = functools.cache(lambda encoding: Codec(kind, schema, encoding))

    def decode(self, content_type: str, data: bytes) -> Record:
        """Decodes and validates a record.

        Raises:
            BadPayload: it is none, or its encoding is unknown or its library not installed.
        """
        encoding = encoding_of(content_type)
        if encoding is None:
            raise BadPayload(f"{content_type[:80]!r} is no encoding of records")
        try:
            codec: Codec[Record] = self._codec(encoding)
        except MissingLibrary as error:
            raise BadPayload(str(error)) from None
        return codec.decode(data)


def encoding_of(content_type: str) -> Encoding | None:
    """The encoding that a zenoh encoding names: JSON for an unspecific one, None for another."""
    media_type = content_type.partition(";")[0]
    if media_type in ("", "zenoh/bytes", "zenoh/string", "application/octet-stream", "text/json"):
        return Encoding.JSON
    return next((encoding for encoding in Encoding if media_type == f"application/{encoding}"), None)


def _json(kind: type[Record]) -> Functions[Record]:
    return msgspec.json.Encoder().encode, msgspec.json.Decoder(kind).decode


def _msgpack(kind: type[Record]) -> Functions[Record]:
    decode = msgspec.msgpack.Decoder(kind).decode
    return msgspec.msgpack.Encoder().encode, lambda data: _finite(decode(data))


def _cbor(kind: type[Record]) -> Functions[Record]:
    import cbor2

    def decode(data: bytes) -> Record:
        # With strict errors cbor2 5.9 leaks the exception about invalid text, and the stack it refers to.
        record = _finite(msgspec.convert(cbor2.loads(data, str_errors="replace"), kind))
        if REPLACEMENT in msgspec.json.encode(record) and REPLACEMENT not in data:
            raise ValueError("text is not UTF-8")
        return record

    return lambda record: cbor2.dumps(msgspec.to_builtins(record)), decode


def _protobuf(kind: type[Record]) -> Functions[Record]:
    from streamkit_zenoh.wire.protobuf import ProtobufMessage

    message = ProtobufMessage(kind.__name__)
    return (
        lambda record: message.encode(msgspec.to_builtins(record)),
        lambda data: _finite(msgspec.convert(message.decode(data), kind)),
    )


def _finite(record: Record) -> Record:
    """The record; raises ValueError for infinite numbers and NaN, which JSON does not have."""
    try:
        json.dumps(msgspec.to_builtins(record), allow_nan=False)
    except ValueError:
        raise ValueError("numbers must be finite") from None
    return record
