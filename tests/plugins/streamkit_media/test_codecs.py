from fractions import Fraction
from pathlib import Path

import pytest
from av.codec.codec import UnknownCodecError

from streamkit import Caps
from streamkit_media.codecs import (
    CODED_CAPS,
    MEDIA_TYPES,
    CodecParameters,
    caps_parameters,
    caps_rate,
    coded_caps,
    decoder_for,
    stream_parameters,
    stream_rate,
)
from streamkit_media.container import open_container, video_stream


@pytest.mark.parametrize("codec", [*MEDIA_TYPES, "msmpeg4v3", "rawvideo", "ffv1"])
def test_parameters_survive_caps_and_their_text(codec: str) -> None:
    """What a decoder needs comes back from caps, also after these were written and read as text."""
    named = codec in MEDIA_TYPES
    given = CodecParameters(
        codec,
        640,
        480,
        bytes([1, 0x42, 0, 255]),
        tag=0 if named else int.from_bytes(b"div3", "little"),
        bits=0 if named else 24,
        pixel_format="" if named else "yuv420p",
    )
    caps = coded_caps(given, Fraction(30000, 1001))
    assert caps.is_fixed
    assert caps_parameters(Caps(str(caps))) == given
    assert caps_rate(Caps(str(caps))) == Fraction(30000, 1001)


@pytest.mark.parametrize("codec", [*MEDIA_TYPES, "msmpeg4v3", "cinepak"])
def test_every_codec_fits_the_template(codec: str) -> None:
    """The caps of any codec are a subset of what decode takes."""
    assert coded_caps(CodecParameters(codec)) <= Caps(CODED_CAPS)


def test_unknown_size_and_rate_are_left_out() -> None:
    """A missing value is left out, never written as 0."""
    assert str(coded_caps(CodecParameters("h264"))) == "video/x-h264"
    assert caps_rate(Caps("video/x-h264")) is None


def test_other_caps_have_no_codec() -> None:
    """Caps of something else are refused."""
    with pytest.raises(KeyError, match="no codec has the caps video/x-raw"):
        caps_parameters(Caps("video/x-raw"))


def test_caps_of_a_stream(small_video: Path) -> None:
    """Codec, size, rate and codec headers of a file's stream are in its caps."""
    with open_container(str(small_video)) as container:
        stream = video_stream(container, "small")
        caps = coded_caps(stream_parameters(stream), stream_rate(stream))
        headers = stream.codec_context.extradata
    assert (caps.name, caps["width"], caps["height"], caps["framerate"]) == (
        "video/x-h264",
        64,
        48,
        Fraction(25),
    )
    assert headers is not None
    assert caps["codec_data"] == headers.hex()


def test_av1_is_decoded_in_software() -> None:
    """FFmpeg's first decoder named av1 needs hardware; the software one is chosen."""
    assert decoder_for("av1").name == "libdav1d"


def test_an_unknown_codec_is_refused() -> None:
    """A codec without decoder is an error."""
    with pytest.raises(UnknownCodecError):
        decoder_for("nosuchcodec")
