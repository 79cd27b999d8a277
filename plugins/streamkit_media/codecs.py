"""Codecs: FFmpeg's names and parameters to caps, and back."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from av.codec import Codec
from av.video.stream import VideoStream

from streamkit import Caps, Structure

# FFmpeg's codec name to the media type and fields that GStreamer gives it.
MEDIA_TYPES: dict[str, tuple[str, dict[str, int]]] = {
    "h264": ("video/x-h264", {}),
    "hevc": ("video/x-h265", {}),
    "vvc": ("video/x-h266", {}),
    "av1": ("video/x-av1", {}),
    "vp8": ("video/x-vp8", {}),
    "vp9": ("video/x-vp9", {}),
    "mpeg4": ("video/mpeg", {"mpegversion": 4}),
    "mpeg2video": ("video/mpeg", {"mpegversion": 2}),
    "mpeg1video": ("video/mpeg", {"mpegversion": 1}),
    "h263": ("video/x-h263", {}),
    "theora": ("video/x-theora", {}),
    "mjpeg": ("image/jpeg", {}),
    "png": ("image/png", {}),
    "bmp": ("image/bmp", {}),
    "gif": ("image/gif", {}),
    "tiff": ("image/tiff", {}),
    "webp": ("image/webp", {}),
    "jpeg2000": ("image/jp2", {}),
    "pgm": ("image/x-portable-graymap", {}),
    "ppm": ("image/x-portable-pixmap", {}),
}
OTHER = "video/x-coded"  # any other codec, named by its field `codec`
CODED_CAPS = "; ".join(
    [
        f"{name}{''.join(f', {key}={value}' for key, value in fields.items())}"
        for name, fields in MEDIA_TYPES.values()
    ]
    + [OTHER]
)
# FFmpeg's first decoder of this name works on hardware only.
DECODERS = {"av1": "libdav1d"}


@dataclass(frozen=True)
class CodecParameters:
    """What a decoder must know before the first packet.

    Attributes:
        codec: FFmpeg's canonical codec name.
        width: px; 0 if unknown.
        height: px; 0 if unknown.
        extradata: codec headers kept outside the packets.
        tag: the container's four-character code, as an integer; 0 if none.
        bits: bits per coded sample; 0 if unknown.
        pixel_format: FFmpeg's name, needed by raw video; "" where the codec defines it.
    """

    codec: str
    width: int = 0
    height: int = 0
    extradata: bytes = b""
    tag: int = 0
    bits: int = 0
    pixel_format: str = ""


def stream_parameters(stream: VideoStream) -> CodecParameters:
    """The parameters of a container's video stream."""
    context = stream.codec_context
    try:
        tag = int.from_bytes(context.codec_tag.encode("ascii"), "little")
    except UnicodeDecodeError:
        tag = 0
    return CodecParameters(
        codec=context.codec.canonical_name,
        width=context.width,
        height=context.height,
        extradata=context.extradata or b"",
        tag=tag,
        bits=context.bits_per_coded_sample,
        pixel_format=context.pix_fmt or "",
    )


def stream_rate(stream: VideoStream) -> Fraction | None:
    """Frames per second of a stream: measured, else declared by the codec, else guessed; None if unknown."""
    for rate in (stream.average_rate, stream.codec_context.framerate, stream.guessed_rate):
        if rate is not None and 0 < rate < 100_000:
            return Fraction(rate)
    return None


def coded_caps(parameters: CodecParameters, framerate: Fraction | None = None) -> Caps:
    """Fixed caps of packets; without a framerate where that is None."""
    name, fixed = MEDIA_TYPES.get(parameters.codec, (OTHER, {}))
    fields: dict[str, int | str | Fraction] = dict(fixed)
    if name == OTHER:
        fields |= {"codec": parameters.codec, "codec_tag": parameters.tag, "bits": parameters.bits}
        if parameters.pixel_format:
            fields["pixel_format"] = parameters.pixel_format
    if parameters.width and parameters.height:
        fields |= {"width": parameters.width, "height": parameters.height}
    if framerate is not None:
        fields["framerate"] = framerate
    if parameters.extradata:
        fields["codec_data"] = parameters.extradata.hex()
    return Caps((Structure(name, fields),))


def caps_parameters(caps: Caps) -> CodecParameters:
    """The parameters in fixed caps of packets.

    Raises:
        KeyError: no codec has these caps.
    """
    codec = _codec_of(caps)
    return CodecParameters(
        codec=codec,
        width=_integer(caps, "width"),
        height=_integer(caps, "height"),
        extradata=bytes.fromhex(str(caps.get("codec_data", ""))),
        tag=_integer(caps, "codec_tag"),
        bits=_integer(caps, "bits"),
        pixel_format=str(caps.get("pixel_format", "")),
    )


def caps_rate(caps: Caps) -> Fraction | None:
    """Frames per second of caps; None where they have none."""
    rate = caps.get("framerate")
    return Fraction(rate) if isinstance(rate, int | Fraction) and rate > 0 else None


def decoder_for(codec: str) -> Codec:
    """FFmpeg's software decoder of a codec.

    Raises:
        UnknownCodecError: this FFmpeg has none.
    """
    return Codec(DECODERS.get(codec, codec), "r")


def _codec_of(caps: Caps) -> str:
    if caps.name == OTHER:
        return str(caps["codec"])
    for codec, (name, fields) in MEDIA_TYPES.items():
        if name == caps.name and all(caps.get(key, value) == value for key, value in fields.items()):
            return codec
    raise KeyError(f"no codec has the caps {caps}")


def _integer(caps: Caps, field: str) -> int:
    value = caps.get(field, 0)
    return value if isinstance(value, int) else 0
