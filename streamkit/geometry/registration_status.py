"""RegistrationStatus: how reliable the registration of a frame is."""

import enum


class RegistrationStatus(enum.StrEnum):
    """How reliable the registration of a frame is.

    `ok` and `still` were measured against a keyframe; `weak` rests on the motion since the previous frame or
    on a part of the frame only; `lost` is predicted; `cut` starts another plane.
    """

    OK = "ok"
    WEAK = "weak"
    LOST = "lost"
    CUT = "cut"
    STILL = "still"
