"""From received bytes to track records, in whichever of the forms they came."""

from streamkit import TrackRecord
from streamkit_zenoh.receive.reception import Received
from streamkit_zenoh.wire.forms import BadPayload, Codec, Form, MissingLibrary, form_of
from streamkit_zenoh.wire.records import TRACKS_SCHEMA


class RecordDecoder:
    """Decodes records; the encoding of each message says how."""

    def __init__(self) -> None:
        self._codecs: dict[Form, Codec[TrackRecord]] = {}

    def decode(self, message: Received) -> TrackRecord:
        """The record of a message.

        Raises:
            BadPayload: it is none, or in a form that is not known or not installed here.
        """
        form = form_of(message.encoding)
        if form is None:
            raise BadPayload(f"{message.encoding[:80]!r} is no encoding of records")
        try:
            codec = self._codecs.get(form)
            if codec is None:
                codec = self._codecs[form] = Codec(TrackRecord, TRACKS_SCHEMA, form)
        except MissingLibrary as error:
            raise BadPayload(str(error)) from None
        return codec.decode(message.payload)
