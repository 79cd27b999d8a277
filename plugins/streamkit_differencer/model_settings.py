"""What the background model is to do, and what it says that it did."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Event(enum.StrEnum):
    """What the model did at a frame, beyond learning."""

    NONE = "none"
    GAIN = "gain"
    RESET = "reset"


@dataclass(frozen=True, slots=True)
class ModelSettings:
    """What the model is to do.

    Attributes:
        interval: tau of equation 2, frames.
        quiet_frames: lambda of equation 1, frames, 1 to 255.
        change_threshold: T_s of equation 2, grey levels.
        foreground_threshold: smallest T_F of equation 4, grey levels.
        noise_gain: standard deviations of a pixel's own noise that raise its T_F; 0 is one T_F for all.
        coefficient: alpha of equation 3, per frame.
        tolerance: error of registration to bear, canvas px; the differencer chooses where it is negative.
        weak: share of its threshold from which a pixel beside foreground is foreground too, so that the
            tolerance hides no grey part of a thing; 1 is none, and without tolerance there is none.
        gradient_gain: share of the local range that raises T_s, and T_F until a pixel's noise is known.
        frame_threshold: share of changed pixels from which the whole model is begun anew.
        absorb_frames: frames after which a thing that stands still becomes background, 0 to 255.
        three_frame: whether pixels without background are judged by the difference of three frames; it finds
            more in the first half second, but large things in fragments.
        shadow: whether shadows are told from things.
        flicker: whether what turns to foreground and back all the time is left out.
        ghost: whether things that were learnt as ground and have left are noticed.
    """

    interval: int = 3
    quiet_frames: int = 12
    change_threshold: float = 18.0
    foreground_threshold: float = 7.0
    noise_gain: float = 4.0
    coefficient: float = 0.08
    tolerance: int = -1
    weak: float = 0.5
    gradient_gain: float = 0.3
    frame_threshold: float = 0.6
    absorb_frames: int = 60
    three_frame: bool = False
    shadow: bool = False
    flicker: bool = False
    ghost: bool = True
