"""Decoding on a graphics processor, where one is there."""

from __future__ import annotations

from pathlib import Path

from av.codec.hwaccel import HWAccel, hwdevices_available
from av.error import FFmpegError

AUTO, NONE = "auto", "none"
# In this order; each only where the machine has the device, because asking a driver for one may take seconds.
DEVICES = {
    "cuda": ("/dev", "nvidia[0-9]*"),
    "vaapi": ("/dev/dri", "renderD*"),
    "videotoolbox": ("/System/Library/Frameworks", "VideoToolbox.framework"),
}


def accelerator(wanted: str) -> tuple[HWAccel | None, str]:
    """The accelerator for auto, none or a device of FFmpeg, and its name; None and why for software."""
    if wanted == NONE:
        return None, "software"
    present = [name for name, (folder, pattern) in DEVICES.items() if any(Path(folder).glob(pattern))]
    names = present if wanted == AUTO else [wanted]
    built_in = hwdevices_available()
    for name in names:
        if name not in built_in:
            continue
        try:
            return HWAccel(name, allow_software_fallback=True), name
        except (FFmpegError, ValueError, RuntimeError, OSError):
            continue
    reason = "no device" if wanted == AUTO else f"{wanted} is not available here"
    return None, f"software: {reason}"
