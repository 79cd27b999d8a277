"""Georeferencing and GeoTIFF."""

import math

import numpy as np
import pytest

from streamkit.geometry.homography import centre, inverse, normalised, project, translation
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.mosaic.georeference import GroundView, georeference, local_metres
from streamkit_stitcher.mosaic.geotiff import north_up, to_utm, utm_code, write_geotiff

ORIGIN = GeodeticPoint(46.8, -92.1)
DEGREES = np.array([ORIGIN.latitude, ORIGIN.longitude])
SHAPE = (200, 300)


def fixes_of(pixels, wrong=()):
    """Latitude and longitude of image middles: 0.1 m a pixel, mosaic turned by 30 degrees; some 40 m off."""
    turn = math.radians(30)
    fixes = []
    for number, (x, y) in enumerate(pixels):
        east = 0.1 * (x * math.cos(turn) + y * math.sin(turn))
        north = 0.1 * (x * math.sin(turn) - y * math.cos(turn))
        scale = local_metres(DEGREES[np.newaxis] + 1e-4, ORIGIN)[0] / 1e-4
        shift = 40.0 if number in wrong else 0.0
        fixes.append(DEGREES + np.array([north + shift, east]) / scale[::-1])
    return fixes


def views_of(fixes):
    """What frames show whose middles have positions."""
    return [GroundView(centre(SHAPE)[np.newaxis], fix[np.newaxis]) for fix in fixes]


PIXELS = [(149.5 + 100 * column, 99.5 + 80 * row) for row in range(3) for column in range(6)]
PLACES = [translation(np.array([x - 149.5, y - 99.5])) for x, y in PIXELS]


def test_the_similarity_is_found_in_spite_of_wrong_positions():
    """Scale and turn come out right with one position in nine 40 m off."""
    found = georeference(PLACES, views_of(fixes_of(PIXELS, wrong=(2, 11))))
    assert np.hypot(*found.to_local[:2, 0]) == pytest.approx(0.1, rel=1e-3)
    assert found.median_error_m < 0.05
    assert math.degrees(math.atan2(found.to_local[1, 0], found.to_local[0, 0])) == pytest.approx(30, abs=0.1)


def test_too_few_positions_say_nothing():
    """Two positions, or coincident ones, give no fit."""
    assert georeference(PLACES[:2], views_of(fixes_of(PIXELS[:2]))) is None
    assert georeference(PLACES[:3], views_of([DEGREES] * 3)) is None


@pytest.mark.parametrize(
    ("place", "code"),
    [(ORIGIN, 32615), (GeodeticPoint(-23.5, -46.8), 32723), (GeodeticPoint(10.0, 180.0), 32660)],
)
def test_the_zone_of_a_position(place, code):
    """North and south, east and west, and the last meridian."""
    assert utm_code(place) == code


def test_a_geotiff_is_georeferenced(tmp_path):
    """The pixel below a position has that position's coordinates in the file's zone."""
    pyproj, tifffile = pytest.importorskip("pyproj"), pytest.importorskip("tifffile")
    fixes = fixes_of(PIXELS)
    geo = georeference(PLACES, views_of(fixes))
    image = np.random.default_rng(0).integers(0, 255, (400, 900, 3), dtype=np.uint8)
    write_geotiff(image, tmp_path / "m.tif", geo)
    with tifffile.TiffFile(tmp_path / "m.tif") as file:
        page = file.pages[0]
        assert np.array_equal(page.asarray(), image[:, :, ::-1])
        matrix = np.array(page.tags[34264].value).reshape(4, 4)
        keys = page.tags[34735].value
    assert keys[keys.index(3072) + 3] == 32615
    projection = pyproj.Transformer.from_crs(4326, 32615, always_xy=True)
    for pixel, fix in zip(PIXELS, fixes, strict=True):
        # Raster space has its origin at the corner of the first pixel.
        place = matrix @ [pixel[0] + 0.5, pixel[1] + 0.5, 0, 1]
        assert place[:2] == pytest.approx(projection.transform(*fix[::-1]), abs=0.05)


def test_the_zone_of_the_mosaic():
    """The matrix into the zone has the mosaic's ground sampling distance, up to the grid's own scale."""
    pytest.importorskip("pyproj")
    matrix, _ = to_utm(georeference(PLACES, views_of(fixes_of(PIXELS))))
    assert np.hypot(matrix[0, 0], matrix[1, 0]) == pytest.approx(0.1, rel=2e-3)


def test_turned_north_up_a_mosaic_needs_only_scale_and_corner(tmp_path):
    """After the turn the file's rows run east, which every program can show."""
    pyproj, tifffile = pytest.importorskip("pyproj"), pytest.importorskip("tifffile")
    fixes = fixes_of(PIXELS)
    turn = north_up(georeference(PLACES, views_of(fixes)))
    turned = georeference([turn @ place for place in PLACES], views_of(fixes))
    write_geotiff(np.zeros((40, 90), np.uint8), tmp_path / "m.tif", turned)
    with tifffile.TiffFile(tmp_path / "m.tif") as file:
        tags = file.pages[0].tags
        assert 34264 not in tags
        across, down, _ = tags[33550].value
        corner = tags[33922].value[3:5]
    assert across == pytest.approx(0.1, rel=2e-3)
    assert down == pytest.approx(across, rel=1e-9)
    projection = pyproj.Transformer.from_crs(4326, 32615, always_xy=True)
    for pixel, fix in zip(PIXELS, fixes, strict=True):
        x, y, _ = turn @ [*pixel, 1] + [0.5, 0.5, 0]
        place = corner[0] + across * x, corner[1] - down * y
        assert place == pytest.approx(projection.transform(*fix[::-1]), abs=0.05)


def oblique_views(lead_s=0.0):
    """A camera that looks aside and moves ever faster: its homographies, and what telemetry sends."""
    to_metres = np.array([[1.4, 0.3, 0.0], [0.2, -1.9, 0.0], [2e-4, 9e-4, 1.0]])
    corners = np.array([[149.5, 99.5], [-0.5, -0.5], [299.5, -0.5], [299.5, 199.5], [-0.5, 199.5]])
    scale = local_metres(DEGREES[np.newaxis] + 1e-3, ORIGIN)[0] / 1e-3
    east, north = scale.tolist()
    places, views = [], []
    for number in range(40):
        places.append(translation(np.array([0.2 * number**1.8, 3.0 * number])))
        later = number + 10 * lead_s
        ahead = translation(np.array([0.2 * later**1.8, 3.0 * later]))
        metres = project(normalised(to_metres @ ahead), corners)
        sent = DEGREES + metres[:, ::-1] / [north, east]
        views.append(GroundView(corners, sent, 5.0, number / 10))
    return to_metres, places, views


@pytest.mark.parametrize("lead_s", [0.0, 0.2])
def test_an_oblique_mosaic_lies_where_its_camera_looks(lead_s):
    """Telemetry's corners give the homography, even where they are ahead of the frames."""
    to_metres, places, views = oblique_views(lead_s)
    found = georeference(places, views)
    grid = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, 300.0], [0.0, 300.0], [150.0, 100.0]])
    offset = local_metres(np.array([[found.origin.latitude, found.origin.longitude]]), ORIGIN)[0]
    assert np.abs(project(found.to_local, grid) + offset - project(to_metres, grid)).max() < 5.0
    assert found.lead_s == pytest.approx(lead_s, abs=0.06)
    assert 5.0 <= found.error_m < 8.0
    assert not found.is_affine


def test_an_oblique_mosaic_is_turned_onto_the_ground():
    """After the change only scale and corner are left, with the scale of its middle."""
    pytest.importorskip("pyproj")
    _, places, views = oblique_views()
    found = georeference(places, views)
    upright = found.seen_through(north_up(found))
    assert upright.is_affine
    matrix, _ = to_utm(upright)
    assert abs(matrix[0, 1]) < 1e-6 * matrix[0, 0]
    middle = project(inverse(found.to_local), np.zeros((1, 2)))[0]
    beside = project(found.to_local, middle + np.array([[0, 0], [1, 0], [0, 1]]))
    area = abs(np.linalg.det(beside[1:] - beside[0]))
    assert upright.pixel_size_m((10, 10)) ** 2 == pytest.approx(area, rel=0.02)
