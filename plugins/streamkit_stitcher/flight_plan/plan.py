"""A flight strip before the flight: ground covered, frames needed, time between keyframes."""

import math
from dataclasses import dataclass
from typing import Final

_MAX_IMAGES: Final = 100_000


@dataclass(frozen=True)
class GeodeticPoint:
    """A position: degrees, WGS84."""

    latitude: float
    longitude: float


@dataclass(frozen=True)
class FlightPlan:
    """A planned strip.

    Attributes:
        length_m: of the strip, on the ellipsoid.
        heading: at its start, rad clockwise from north.
        footprint_m: ground across and along one frame.
        images: frames of the whole strip at the planned overlap.
        interval_s: time between two of them.
        sampling_m: ground per pixel.
    """

    length_m: float
    heading: float
    footprint_m: tuple[float, float]
    images: int
    interval_s: float
    sampling_m: float


def parse_strip(text: str) -> tuple[GeodeticPoint, GeodeticPoint]:
    """Parses "longitude,latitude,longitude,latitude".

    Raises:
        ValueError: it is not four numbers, or they are not positions on earth.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 4 or not all(math.isfinite(value) for value in values):
        raise ValueError(
            f"strip must be longitude,latitude of its first and of its last frame, got {text!r}; "
            "write strip=-46.84,-23.51,-46.83,-23.51"
        )
    ends = GeodeticPoint(values[1], values[0]), GeodeticPoint(values[3], values[2])
    for end in ends:
        if not (-90 <= end.latitude <= 90 and -180 <= end.longitude <= 180):
            raise ValueError(
                f"strip: latitude must lie in -90 to 90 and longitude in -180 to 180, got {text!r}; "
                "longitude comes first"
            )
    return ends


def plan_strip(
    ends: tuple[GeodeticPoint, GeodeticPoint],
    altitude_m: float,
    field_of_view: float,
    overlap: float,
    speed_m_s: float,
    shape: tuple[int, int],
) -> FlightPlan:
    """Plans a strip flown along the height of the frames.

    Args:
        ends: centres of the first and the last frame.
        altitude_m: above the ground.
        field_of_view: horizontal, of a camera that looks straight down, rad.
        overlap: of consecutive frames, 0 to below 1.
        speed_m_s: over the ground.
        shape: height and width of the frames, px.

    Raises:
        ValueError: a value is out of range, or the strip needs more than 100 000 frames.
        ImportError: pyproj is missing.

    Source: Zhang, Liu and Qu, Research on feature extraction method of UAV video image based on target
    tracking, section 2.1, steps 1 to 3; geodesic lengths after Karney, Algorithms for geodesics, 2013.
    """
    import pyproj

    if not (altitude_m > 0 and speed_m_s > 0 and 0 <= overlap < 1):
        raise ValueError(
            f"altitude and speed must be above 0 and the overlap in 0 to 1, got {altitude_m} m, "
            f"{speed_m_s} m/s and {overlap}"
        )
    azimuth, _, length = pyproj.Geod(ellps="WGS84").inv(
        ends[0].longitude, ends[0].latitude, ends[1].longitude, ends[1].latitude
    )
    across = 2 * altitude_m * math.tan(field_of_view / 2)
    along = across * shape[0] / shape[1]
    step = along * (1 - overlap)
    images = math.ceil(length / step - 1e-9) + 1
    if images > _MAX_IMAGES:
        raise ValueError(
            f"a strip of {length:.0f} m takes {images} frames at steps of {step:.2f} m; at most "
            f"{_MAX_IMAGES} are possible: check altitude, field of view and overlap"
        )
    return FlightPlan(
        float(length), math.radians(azimuth), (across, along), images, step / speed_m_s, across / shape[1]
    )
