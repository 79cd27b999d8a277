"""KML of a flight: where the camera was, where it headed, and what it saw of the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from xml.sax.saxutils import escape

import numpy as np

from streamkit import Pose
from streamkit.geometry.camera import ground_coordinates
from streamkit.geometry.homography import corners
from streamkit.geometry.posed_camera import posed_camera
from streamkit_tracks.file_formats import KML, iso_text, kml_line, xml_text

CORNERS = 4
ABOVE_GROUND = ("above take-off", "above ground")  # of what is nearly level, the same
VALUES = {
    "field_of_view": "Horizontal field of view, deg",
    "sensor_azimuth": "Azimuth of the sensor to the platform, deg",
    "sensor_elevation": "Elevation of the sensor to the platform, deg",
}
HEAD = (
    f"{KML.head}\n"
    '<Style id="path"><LineStyle><color>ff00c8ff</color><width>3</width></LineStyle></Style>\n'
    '<Style id="view"><LineStyle><color>ffffffff</color></LineStyle>'
    "<PolyStyle><color>30ffffff</color></PolyStyle></Style>\n"
    '<Schema id="pose">'
    + "".join(
        f'<gx:SimpleArrayField name="{name}" type="float"><displayName>{text}</displayName>'
        "</gx:SimpleArrayField>"
        for name, text in VALUES.items()
    )
    + "</Schema>\n"
)


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A pose and its time, UTC; None if unknown."""

    pose: Pose
    time: datetime | None


def path_placemark(points: Sequence[PathPoint], name: str) -> str:
    """The flight path: a gx:Track with the heading, and further values where telemetry has them.

    A line where a time is unknown: of a gx:Track, everything may be left empty but the times.
    """
    poses = [point.pose for point in points]
    times = [iso_text(point.time) for point in points if point.time is not None]
    places = [
        (f"{pose.longitude:.7f}", f"{pose.latitude:.7f}", f"{pose.altitude or 0:.1f}") for pose in poses
    ]
    head = f"<Placemark><name>{escape(xml_text(name))}</name><styleUrl>#path</styleUrl>"
    mode = f"<altitudeMode>{_altitude_mode(poses)}</altitudeMode>"
    if len(times) < len(points):
        return f"{head}{kml_line([','.join(place) for place in places], mode)}</Placemark>\n"
    lines = [
        f"{head}<gx:Track>",
        mode,
        *(f"<when>{time}</when>" for time in times),
        *(f"<gx:coord>{' '.join(place)}</gx:coord>" for place in places),
        *(f"<gx:angles>{_angles(pose.heading)}</gx:angles>" for pose in poses),
        '<ExtendedData><SchemaData schemaUrl="#pose">',
    ]
    for field, values in zip(VALUES, zip(*map(_values, poses), strict=True), strict=True):
        cells = "".join(f"<gx:value>{_degrees(value)}</gx:value>" for value in values)
        lines.append(f'<gx:SimpleArrayData name="{field}">{cells}</gx:SimpleArrayData>')
    return "\n".join([*lines, "</SchemaData></ExtendedData></gx:Track></Placemark>\n"])


def view_placemark(outline: Sequence[tuple[float, float]], time: datetime | None, lasts_s: float) -> str:
    """What the camera saw: a polygon of latitudes and longitudes, shown for `lasts_s` from a time on."""
    ring = " ".join(f"{longitude:.7f},{latitude:.7f}" for latitude, longitude in (*outline, outline[0]))
    span = ""
    if time is not None:
        end = time + timedelta(seconds=lasts_s)
        span = f"<TimeSpan><begin>{iso_text(time)}</begin><end>{iso_text(end)}</end></TimeSpan>"
    return (
        f"<Placemark>{span}<styleUrl>#view</styleUrl><Polygon><tessellate>1</tessellate><outerBoundaryIs>"
        f"<LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>\n"
    )


def view_outline(
    pose: Pose, shape: tuple[int, int] | None, ground_altitude_m: float | None
) -> Sequence[tuple[float, float]]:
    """Latitudes and longitudes of what the corners of a frame show; empty where unknown.

    Args:
        pose: of the frame; corners that it has are those.
        shape: height and width of the frame, px; None if unknown.
        ground_altitude_m: of the ground, with the datum of the pose; None to take it from the pose.
    """
    if len(pose.corners) == CORNERS:
        return pose.corners
    camera = "unknown" if shape is None else posed_camera(pose, shape, ground_altitude_m)
    if shape is None or isinstance(camera, str):
        return ()
    places = ground_coordinates(camera, corners(shape))
    if not np.isfinite(places).all():  # the horizon is in view
        return ()
    return [(latitude, longitude) for latitude, longitude in places.tolist()]


def _values(pose: Pose) -> tuple[float | None, float | None, float | None]:
    view, sensor = pose.field_of_view, pose.sensor_angles
    return (view and view[0], sensor and sensor[0], sensor and sensor[1])


def _altitude_mode(poses: Sequence[Pose]) -> str:
    """What a viewer measures the altitudes from."""
    if any(pose.altitude is None for pose in poses):
        return "clampToGround"
    return "relativeToGround" if poses[0].source.endswith(ABOVE_GROUND) else "absolute"


def _angles(heading: float | None) -> str:
    """Heading, tilt and roll of the symbol that a viewer draws, deg: level."""
    return "" if heading is None else f"{_degrees(heading)} 0 0"


def _degrees(angle: float | None) -> str:
    return "" if angle is None else f"{math.degrees(angle):.2f}"
