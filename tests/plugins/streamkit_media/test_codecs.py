from fractions import Fraction
from pathlib import Path

import pytest
from av.codec.codec import UnknownCodecError

from streamkit import Caps
from streamkit_media.codecs import (
    CODED_CAPS,
    MEDIA_TYPES,
    caps_rate,
    codec_of,
    coded_caps,
    decoder_for,
    extradata_of,
    is_same_format,
    size_of,
    video_caps,
)
from streamkit_media.container import open_container, video_stream


@pytest.mark.parametrize("codec", [*MEDIA_TYPES, "msmpeg4v3", "rawvideo", "ffv1"])
def test_caps_say_what_a_decoder_needs(codec: str) -> None:
    """It comes back from caps, also after these were written and read as text."""
    headers, rate = bytes([1, 0x42, 0, 255]), Fraction(30000, 1001)
    tag = int.from_bytes(b"div3", "little")
    caps = coded_caps(codec, 640, 480, headers, rate, codec_tag=tag, bits=24, pixel_format="yuv420p")
    assert caps.is_fixed
    read = Caps(str(caps))
    assert (codec_of(read), size_of(read), extradata_of(read)) == (codec, (640, 480), headers)
    assert caps_rate(read) == rate
    details = (read.get("codec_tag"), read.get("bits"), read.get("pixel_format"))
    assert details == ((None,) * 3 if codec in MEDIA_TYPES else (tag, 24, "yuv420p"))


@pytest.mark.parametrize("codec", [*MEDIA_TYPES, "msmpeg4v3", "cinepak"])
def test_every_codec_fits_the_template(codec: str) -> None:
    """The caps of any codec are a subset of what decode takes."""
    assert coded_caps(codec) <= Caps(CODED_CAPS)


def test_unknown_size_and_rate_are_left_out() -> None:
    """A missing value is left out, never written as 0."""
    assert str(coded_caps("h264")) == "video/x-h264"
    assert caps_rate(Caps("video/x-h264")) is None
    assert size_of(Caps("video/x-h264")) == (0, 0)


def test_another_rate_is_no_other_format() -> None:
    """Size, codec and headers make the format of a file; the frame rate may change in it."""
    caps = coded_caps("h264", 640, 480, b"a", Fraction(25))
    assert is_same_format(caps, coded_caps("h264", 640, 480, b"a", Fraction(50)))
    assert not is_same_format(caps, coded_caps("h264", 640, 480, b"b", Fraction(25)))


def test_other_caps_have_no_codec() -> None:
    """Caps of something else are refused."""
    with pytest.raises(KeyError, match="no codec has the caps video/x-raw"):
        codec_of(Caps("video/x-raw"))


def test_caps_of_a_stream(small_video: Path) -> None:
    """Codec, size, rate and codec headers of a file's stream are in its caps."""
    with open_container(str(small_video)) as container:
        stream = video_stream(container, "small")
        caps, headers = video_caps(stream), stream.codec_context.extradata
    assert (caps.name, size_of(caps), caps["framerate"]) == ("video/x-h264", (64, 48), Fraction(25))
    assert headers is not None
    assert caps["codec_data"] == headers.hex()


def test_av1_is_decoded_in_software() -> None:
    """FFmpeg's first decoder named av1 needs hardware; the software one is chosen."""
    assert decoder_for("av1").name == "libdav1d"


def test_an_unknown_codec_is_refused() -> None:
    """A codec without decoder is an error."""
    with pytest.raises(UnknownCodecError):
        decoder_for("nosuchcodec")
