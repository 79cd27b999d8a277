"""Raw video: caps and array layouts."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from streamkit.errors import did_you_mean
from streamkit.flow.caps import Caps, Structure
from streamkit.flow.caps_values import Value
from streamkit.flow.frame import Frame

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SIDEWAYS = (90, 270)  # degrees
CHANNELS = {"BGR": 3, "RGB": 3, "BGRA": 4, "RGBA": 4}
LUMA_FORMATS = ("GRAY8", "I420", "NV12")
FORMATS = (*LUMA_FORMATS, *CHANNELS)
LUMA_CAPS = "video/x-raw, format={ GRAY8, I420, NV12 }"

FIELDS = (
    "format", "width", "height", "framerate", "max-framerate", "views", "interlace-mode", "field-order",
    "pixel-aspect-ratio", "chroma-site", "colorimetry", "multiview-mode", "multiview-flags",
)  # fmt: skip

NTSC = Fraction(1000, 1001)
# Relative: 23.976, 29.97 and 59.94 are a millionth off what they stand for, 29.98 is 300 times that.
ROUNDING = Fraction(1, 100_000)

# What videoconvert, videoscale and videorate can make.
CONVERTIBLE = (
    f"video/x-raw, format={{ {', '.join(FORMATS)} }}, width=[ 1, 32767 ], height=[ 1, 32767 ], "
    "framerate=[ 0/1, 2147483647/1 ]"
)
OF_ANY_SIZE = f"video/x-raw, format={{ GRAY8, {', '.join(CHANNELS)} }}"
CONVERTERS = {
    "videoconvert": ("format",),  # inserted where links are made; a format may also come with a frame
    "videoscale": ("width", "height"),
    "videorate": ("framerate",),
    "videoscale ! videorate": ("width", "height", "framerate"),
}


def exact_rate(rate: float | Fraction) -> Fraction:
    """The frame rate that a decimal number stands for: 29.97 is 30000/1001, 12.5 is 25/2."""
    rate = Fraction(rate)
    standard = round(rate / NTSC) * NTSC
    if abs(standard - rate) < ROUNDING * rate:
        return standard
    return rate.limit_denominator(1_000_000) or rate


def misspelt_fields(caps: Caps) -> list[str]:
    """A line for each field of raw video that it does not have, and whose name is like one that it has.

    A decimal number for the frame rate counts as misspelt, too: it is a fraction, and fits no other caps.
    """
    unknown = [
        (name, did_you_mean(name, FIELDS))
        for structure in caps.structures
        if structure.name == "video/x-raw"
        for name in structure.fields
        if name not in FIELDS
    ]
    rates = [structure.fields.get("framerate") for structure in caps.structures]
    decimal = [exact_rate(rate) for rate in rates if isinstance(rate, int | float)]
    return [f"video/x-raw has no field {name}; {hint}" for name, hint in unknown if hint] + [
        f"framerate is a fraction; write framerate={rate.numerator}/{rate.denominator}" for rate in decimal
    ]


def misspelt_media(caps: Caps) -> list[str]:
    """A line for each media type that is like that of raw video, which other types of video are not."""
    names = [structure.name for structure in caps.structures if structure.name != "video/x-raw"]
    # GStreamer 0.10's video/x-raw-yuv is alike by 0.85, video/x-av1 by 0.82.
    hints = [(name, did_you_mean(name, ["video/x-raw"], 0.84)) for name in names]
    return [f"{name}: {hint}" for name, hint in hints if hint]


def misspelt_formats(caps: Caps) -> list[str]:
    """A line for each pixel format of raw video that is like one of streamkit's, and none of them."""
    formats = [structure.fields.get("format") for structure in caps.structures]
    # Names in small letters have a hint of their own, as all words do.
    unknown = [name for name in formats if isinstance(name, str) and name.upper() not in FORMATS]
    hints = [(name, did_you_mean(name, FORMATS)) for name in unknown]
    return [f"no element of streamkit has the format {name}; {hint}" for name, hint in hints if hint]


def is_raw_video(caps: Caps) -> bool:
    """Whether all structures of caps are of raw video."""
    return {structure.name for structure in caps.structures} == {"video/x-raw"}


def is_turned_for_display(caps: Caps) -> bool:
    """Whether frames of coded video are to be mirrored or rotated for display, as `decode` does."""
    return bool(caps.get("flipped") or caps.get("rotation"))


def display_size(caps: Caps) -> tuple[int, int] | None:
    """Width and height of the frames of coded video as `decode` gives them, px; None if unknown."""
    width, height = caps.get("width"), caps.get("height")
    if not (isinstance(width, int) and isinstance(height, int)):
        return None
    return (height, width) if caps.get("rotation") in SIDEWAYS else (width, height)


def conversion_remedy(offered: Caps, accepted: Caps) -> str:
    """What to put between raw video of two formats, sizes or rates, as "put videoscale between", or ""."""
    convertible = Caps(CONVERTIBLE)
    if not all(is_raw_video(caps) and caps.can_intersect(convertible) for caps in (offered, accepted)):
        return ""
    sizes = (offered.get("width"), offered.get("height"))
    is_odd = any(isinstance(size, int) and size % 2 for size in sizes)
    for element, fields in CONVERTERS.items():
        if offered.without_fields(*fields).can_intersect(accepted.without_fields(*fields)):
            if element == "videoconvert" and is_odd and not accepted.can_intersect(Caps(OF_ANY_SIZE)):
                return "frames of I420 and NV12 have even sizes; ask for GRAY8 or BGR"
            return f"put {element} between"
    return ""


def raw_video_caps(pixel_format: str, width: int, height: int, framerate: Fraction | None = None) -> Caps:
    """Fixed caps of raw video.

    Args:
        pixel_format: GRAY8, I420, NV12, BGR, RGB, BGRA or RGBA.
        width: px.
        height: px.
        framerate: frames/s; None omits the field.
    """
    fields: dict[str, Value] = {"format": pixel_format, "width": width, "height": height}
    if framerate is not None:
        fields["framerate"] = framerate
    return Caps((Structure("video/x-raw", fields),))


def luma(frame: Frame) -> NDArray[np.uint8]:
    """The luma plane of a raw video frame: uint8[height, width], a view.

    Raises:
        TypeError: the frame's format has no luma plane.
    """
    pixel_format = frame.caps.get("format")
    if pixel_format == "GRAY8":
        return frame.data  # type: ignore[no-any-return]
    if pixel_format in LUMA_FORMATS:
        return frame.data[: frame.caps["height"]]  # type: ignore[no-any-return]
    raise TypeError(
        f"luma needs a frame of format {', '.join(LUMA_FORMATS)}, got {pixel_format!r}: "
        "put videoconvert before this element, or ask for one of these formats on its sink pad"
    )


def check_output(item: object, method: str) -> None:
    """Raises `TypeError` or `ValueError` unless a method gave a frame whose array is what its caps say."""
    if not isinstance(item, Frame):
        remedy = "put data into a frame with frame.replace(data=...)"
        raise TypeError(f"{method} gives frames, got {type(item).__name__}: {remedy}")
    check_layout(item)


def check_layout(frame: Frame, *, needs_array: bool = False) -> None:
    """Checks that the array of a raw video frame is what its caps say.

    Unknown formats are not checked, nor, unless `needs_array`, is data that is no array: sinks may store it.

    Raises:
        ValueError: shape or type differ.
        TypeError: the caps are text.
    """
    if not isinstance(frame.caps, Caps):
        raise TypeError(f"the caps of a frame must be Caps, got {frame.caps!r}: write Caps({frame.caps!r})")
    data, structures = frame.data, frame.caps.structures
    shape = getattr(data, "shape", None)
    if (shape is None and not needs_array) or not structures or structures[0].name != "video/x-raw":
        return
    pixel_format, width, height = (structures[0].fields.get(name) for name in ("format", "width", "height"))
    if not isinstance(width, int) or not isinstance(height, int):
        return
    wanted: tuple[int, ...]
    if pixel_format in LUMA_FORMATS:
        wanted = (height if pixel_format == "GRAY8" else height * 3 // 2, width)
    elif isinstance(pixel_format, str) and pixel_format in CHANNELS:
        wanted = (height, width, CHANNELS[pixel_format])
    else:
        return
    kind = getattr(data, "dtype", None)
    if shape != wanted or kind != "uint8":
        rule = f"{pixel_format} of {width} x {height} px is uint8{list(wanted)}"
        remedy = "give the frame the caps of what it holds"
        if shape is None or kind is None:
            make = "frombuffer" if isinstance(data, bytes | bytearray | memoryview) else "array"
            remedy = f"make it an array, as np.{make}(data, np.uint8).reshape{wanted} does"
            raise ValueError(f"{rule}, got {type(data).__name__}: {remedy}")
        if shape == wanted:
            remedy = "make it uint8, as np.clip(data, 0, 255).astype(np.uint8) does"
        raise ValueError(f"{rule}, got {kind}{list(shape)}: {remedy}")
