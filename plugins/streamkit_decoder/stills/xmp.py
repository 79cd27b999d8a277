"""Position and attitude out of the XMP packet that DJI aircraft write into photographs."""

from __future__ import annotations

import re
from typing import Final

# An attribute or an element, as the writer pleased; the packet is searched and not parsed, since it is input
# that nobody vouches for and nothing but a few numbers is wanted.
_NUMBER: Final = rb"\s*[\"']?\s*([-+]?\d{1,12}(?:\.\d{1,20})?)\s*[\"'<]"
_FIELD: Final = re.compile(rb"drone-dji:(\w{1,40})\s*[=>]" + _NUMBER)


def read_fields(packet: bytes) -> dict[str, float]:
    """The numbers of the name space `drone-dji` by their names, such as `GimbalPitchDegree`.

    Args:
        packet: the XMP packet, UTF-8.
    """
    return {name.decode("ascii", "replace"): float(number) for name, number in _FIELD.findall(packet)}
