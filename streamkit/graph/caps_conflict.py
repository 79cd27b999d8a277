"""What two pads disagree on, and what to change, in words."""

from __future__ import annotations

from streamkit.element.base import Element
from streamkit.element.pad import Direction
from streamkit.errors import DescriptionError, Place
from streamkit.flow.caps import Caps
from streamkit.flow.video import (
    conversion_remedy,
    is_raw_video,
    misspelt_fields,
    misspelt_formats,
    misspelt_media,
)

RAW = "video/x-raw"
CODED_VIDEO = ("video/", "image/")  # begin the media types of coded packets
MEDIA_SHOWN = 3


def caps_conflict(
    left: str, offered: Caps, right: str, accepted: Caps, place: Place | None, sink: Element
) -> DescriptionError:
    """The error for two pads, by path, whose caps have nothing in common; `sink` is the second's element."""
    text = f"could not link {left} to {right}: they "
    misspelt = dict.fromkeys([*misspelt_media(offered), *misspelt_media(accepted)])
    if remedy := "; ".join(misspelt) or _codec_remedy(offered, accepted, sink):
        text += f"disagree on media type: {left} offers {_media(offered)}; {right} takes {_media(accepted)}"
        return DescriptionError("link", text, place, remedy)
    text += offered.disagreement(accepted, left, right)
    fields = [*misspelt_fields(offered), *misspelt_fields(accepted)]
    formats = [*misspelt_formats(offered), *misspelt_formats(accepted)]
    hints = dict.fromkeys(fields + formats)
    return DescriptionError("link", text, place, "; ".join(hints) or conversion_remedy(offered, accepted))


def _codec_remedy(offered: Caps, accepted: Caps, sink: Element) -> str:
    """What to change where raw video meets an element for coded packets, or the other way; "" elsewhere."""
    if is_raw_video(offered) and _is_coded_video(accepted):
        converter, done = "encode", "decoded"
    elif _is_coded_video(offered) and is_raw_video(accepted):
        converter, done = "decode", "encoded"
    else:
        return ""
    made = [template.caps for template in sink.pad_templates.values() if template.direction is Direction.SRC]
    if any(not caps.is_any and offered.can_intersect(caps) for caps in made):
        return f"the video is {done} before {sink.name}: leave {sink.name} out"
    return f"put {converter} between"


def _is_coded_video(caps: Caps) -> bool:
    names = {structure.name for structure in caps.structures}
    return bool(names) and RAW not in names and all(name.startswith(CODED_VIDEO) for name in names)


def _media(caps: Caps) -> str:
    """The media types of caps; of many, the first."""
    names = list(dict.fromkeys(structure.name for structure in caps.structures))
    left_out = len(names) - MEDIA_SHOWN
    return ", ".join(names[:MEDIA_SHOWN]) + (f" and {left_out} others" if left_out > 0 else "")
