"""Codecs: FFmpeg's names and parameters to caps, and back."""

from __future__ import annotations

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


def video_caps(stream: VideoStream) -> Caps:
    """Fixed caps of a stream's packets, with what a decoder must know before the first."""
    context = stream.codec_context
    try:
        tag = int.from_bytes(context.codec_tag.encode("ascii"), "little")
    except UnicodeDecodeError:
        tag = 0
    return coded_caps(
        context.codec.canonical_name,
        context.width,
        context.height,
        context.extradata or b"",
        stream_rate(stream),
        codec_tag=tag,
        bits=context.bits_per_coded_sample,
        pixel_format=context.pix_fmt or "",
    )


def stream_rate(stream: VideoStream) -> Fraction | None:
    """Frames per second of a stream: measured, else declared by the codec, else guessed; None if unknown."""
    for rate in (stream.average_rate, stream.codec_context.framerate, stream.guessed_rate):
        if rate is not None and 0 < rate < 100_000:
            return Fraction(rate)
    return None


def coded_caps(
    codec: str,
    width: int = 0,
    height: int = 0,
    extradata: bytes = b"",
    framerate: Fraction | None = None,
    **details: int | str,
) -> Caps:
    """Fixed caps of packets; a missing value is left out.

    Args:
        codec: FFmpeg's canonical name.
        width: px; 0 if unknown.
        height: px; 0 if unknown.
        extradata: codec headers kept outside the packets.
        framerate: frames per second; None if unknown.
        details: `codec_tag` (the container's four characters as an integer), `bits` (of a coded sample) and
            `pixel_format` (FFmpeg's name) of a codec that has no media type of its own.
    """
    name, fixed = MEDIA_TYPES.get(codec, (OTHER, {}))
    fields: dict[str, int | str | Fraction] = dict(fixed)
    if name == OTHER:
        fields |= {"codec": codec, **{key: value for key, value in details.items() if value}}
    if width and height:
        fields |= {"width": width, "height": height}
    if framerate is not None:
        fields["framerate"] = framerate
    if extradata:
        fields["codec_data"] = extradata.hex()
    return Caps((Structure(name, fields),))


def codec_of(caps: Caps) -> str:
    """FFmpeg's name of the codec of packets.

    Raises:
        KeyError: no codec has these caps.
    """
    if caps.name == OTHER:
        return str(caps["codec"])
    for codec, (name, fields) in MEDIA_TYPES.items():
        if name == caps.name and all(caps.get(key, value) == value for key, value in fields.items()):
            return codec
    raise KeyError(f"no codec has the caps {caps}")


def extradata_of(caps: Caps) -> bytes:
    """The codec headers in caps of packets; b"" where the packets hold them."""
    return bytes.fromhex(str(caps.get("codec_data", "")))


def size_of(caps: Caps) -> tuple[int, int]:
    """Width and height in caps, px; 0 where they are unknown."""
    width, height = caps.get("width", 0), caps.get("height", 0)
    return (width, height) if isinstance(width, int) and isinstance(height, int) else (0, 0)


def caps_rate(caps: Caps) -> Fraction | None:
    """Frames per second of caps; None where they have none."""
    rate = caps.get("framerate")
    return Fraction(rate) if isinstance(rate, int | Fraction) and rate > 0 else None


def is_same_format(caps: Caps, other: Caps) -> bool:
    """Whether packets of both caps may stand in one file."""
    return caps is other or caps.without_fields("framerate") == other.without_fields("framerate")


def decoder_for(codec: str) -> Codec:
    """FFmpeg's software decoder of a codec.

    Raises:
        UnknownCodecError: this FFmpeg has none.
    """
    return Codec(DECODERS.get(codec, codec), "r")
