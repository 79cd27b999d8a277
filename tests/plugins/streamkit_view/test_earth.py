"""The geographic map in a real browser, with and without a base map."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
import tifffile
import zenoh
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By

METRES_PER_DEGREE = 111_320
LATITUDE, LONGITUDE = 47.0, 8.0
METRES_PER_PX = 0.1
YELLOW, RED, BLUE = (10, 214, 255), (0, 0, 255), (200, 60, 0)  # BGR
PLACES_PX = ((100, 100), (700, 320), (1100, 650))
MVT, PNG = 1, 2
WINDOW_PX = (960, 600)  # a larger map takes a processor that draws it a minute


def place(x: float, y: float) -> tuple[float, float]:
    """Longitude and latitude of a pixel of the plane, whose y runs south."""
    east, south = x * METRES_PER_PX, y * METRES_PER_PX
    across = METRES_PER_DEGREE * math.cos(math.radians(LATITUDE))
    return LONGITUDE + east / across, LATITUDE - south / METRES_PER_DEGREE


def record(number: int) -> dict[str, Any]:
    """Three targets that stand still, with their coordinates."""
    tracks = []
    for index, (x, y) in enumerate(PLACES_PX):
        lon, lat = place(x, y)
        tracks.append({
            "id": index + 1, "state": "confirmed", "x": x, "y": y, "length": 40, "width": 20, "angle": 0,
            "vx": 0, "vy": 0, "bbox": [x - 20, y - 10, x + 20, y + 10], "score": 0.9, "age_ns": 1,
            "geo": {"lat": lat, "lon": lon, "error_m": 3.0},
        })  # fmt: skip
    return {
        "schema": "streamkit.tracks/1", "source": "s", "seq": number, "epoch": 0,
        "pts_ns": number * 200_000_000, "width": 1280, "height": 720, "tracks": tracks, "dropped": 0,
        "registration": {"reference": 0, "status": "ok", "to_reference": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
    }  # fmt: skip


@pytest.fixture
def publish(key: str, session: zenoh.Session) -> Callable[[], None]:
    """Publishes the next record."""
    encoding = zenoh.Encoding("application/json;streamkit.tracks/1")
    publisher = session.declare_publisher(f"{key}/tracks", encoding=encoding)
    numbers = iter(range(100_000))
    return lambda: publisher.put(msgspec.json.encode(record(next(numbers))))


def pixels(browser: Chrome) -> np.ndarray[Any, Any]:
    """The map as it is shown, uint8[h, w, 3] BGR."""
    data = browser.find_element(By.ID, "earth-map").screenshot_as_png
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))


def has_colour(image: np.ndarray[Any, Any], colour: tuple[int, int, int]) -> np.ndarray[Any, Any]:
    """Which pixels have about this colour, bool[h, w]."""
    return np.asarray((np.abs(image.astype(int) - colour) < 40).all(2))


def blobs(image: np.ndarray[Any, Any], colour: tuple[int, int, int]) -> np.ndarray[Any, Any]:
    """Centres of the spots of a colour, px, from left to right."""
    mask = has_colour(image, colour).astype(np.uint8)
    _, _, rows, centres = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found = [centre for centre, row in zip(centres[1:], rows[1:], strict=True) if row[4] >= 15]
    return np.array(sorted(found, key=lambda centre: centre[0]))


def write_geotiff(path: Path) -> None:
    """Green ground with a red square around the second target, 0.1 m per pixel."""
    image = np.full((900, 1500, 3), (40, 90, 40), np.uint8)
    x, y = PLACES_PX[1][0] + 100, PLACES_PX[1][1] + 100
    image[y - 40 : y + 40, x - 40 : x + 40] = RED[::-1]
    west, north = place(-100, -100)
    east, south = place(1400, 800)
    keys = (1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326)
    tags = [
        (33550, "d", 3, ((east - west) / 1500, (north - south) / 900, 0.0), True),
        (33922, "d", 6, (0.0, 0.0, 0.0, west, north, 0.0), True),
        (34735, "H", len(keys), keys, True),
    ]
    tifffile.imwrite(path, image, photometric="rgb", metadata=None, extratags=tags)


def write_pmtiles(path: Path, tile: bytes, kind: int) -> None:
    """An archive of the one tile of zoom 0.

    Source: PMTiles version 3 specification, sections 3 and 4.
    """
    directory, metadata = bytes([1, 0, 1]), b'{"vector_layers": [{"id": "land", "fields": {}}]}'
    directory += bytes([len(tile) & 0x7F | 0x80, len(tile) >> 7, 1])
    data_at = 127 + len(directory) + len(metadata)
    spans = (127, len(directory), 127 + len(directory), len(metadata), data_at, 0, data_at, len(tile))
    header = b"PMTiles\x03" + struct.pack("<11Q", *spans, 1, 1, 1)
    header += struct.pack("<6B4iB2i", 1, 1, 1, kind, 0, 0, -(10**9), -(10**9), 10**9, 10**9, 0, 0, 0)
    path.write_bytes(header + directory + metadata + tile)


def vector_tile() -> bytes:
    """A square over the whole tile, in the layer `land`.

    Source: Mapbox Vector Tile specification 2.1, section 4.
    """

    def varint(value: int) -> bytes:
        return bytes([value]) if value < 0x80 else bytes([value & 0x7F | 0x80]) + varint(value >> 7)

    def field(number: int, content: bytes) -> bytes:
        return varint(number << 3 | 2) + varint(len(content)) + content

    side = 2 * 4096  # zigzag
    geometry = b"".join(map(varint, (9, 0, 0, 26, side, 0, 0, side, side - 1, 0, 15)))
    feature = bytes([0x18, 3]) + field(4, geometry)
    return field(3, field(1, b"land") + field(2, feature) + bytes([0x28]) + varint(4096) + bytes([0x78, 2]))


def open_map(
    browser: Chrome, url: str, publish: Callable[[], None], wait_for: Callable[..., Any]
) -> Callable[[], bool]:
    """Opens the page and publishes until the map knows where the plane lies, shows all targets, and rests."""
    browser.set_window_size(*WINDOW_PX)
    browser.get(url)
    last = np.zeros(0)

    def is_shown() -> bool:
        nonlocal last
        publish()
        shows = (
            "isFitted && streamkit.earth.map.loaded() && !streamkit.earth.map.isMoving() "
            "&& streamkit.earth.geo.error !== null"
        )
        if not browser.execute_script(f"return Boolean(streamkit.earth.{shows})"):
            return False
        before, last = last, pixels(browser)
        return np.array_equal(before, last) and len(blobs(last, YELLOW)) == len(PLACES_PX)

    wait_for(is_shown, 60)
    return is_shown


def assert_all_is_local(browser: Chrome, url: str) -> None:
    """Every request went to the server of the page, and nothing failed."""
    names = browser.execute_script(
        "return performance.getEntriesByType('resource').map((entry) => entry.name)"
    )
    assert any("maplibre-gl-worker" in name for name in names)
    assert [name for name in names if not name.startswith((url.partition("?")[0], "blob:"))] == []
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.mark.timeout(180)
def test_targets_lie_on_the_image_where_their_coordinates_say(
    browser: Chrome, serve_keys: Callable[..., str], key: str, publish: Callable[[], None],
    wait_for: Callable[..., Any], tmp_path: Path,
) -> None:  # fmt: skip
    """Within 0.3 m of the mark on the ground; a click follows one, at the cursor's coordinates."""
    write_geotiff(tmp_path / "base.tif")
    url = serve_keys(key, basemap=tmp_path / "base.tif")
    open_map(browser, url, publish, wait_for)
    shown = pixels(browser)
    dots = blobs(shown, YELLOW)
    px_per_m = np.linalg.norm(dots[2] - dots[0]) / math.dist(PLACES_PX[2], PLACES_PX[0]) / METRES_PER_PX
    rows, columns = np.nonzero(has_colour(shown, RED))
    middle = (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2
    assert math.dist(dots[1], middle) / px_per_m < 0.3 + 1 / px_per_m
    ground = browser.find_element(By.ID, "earth-map")
    offset = dots[1] - np.array([ground.size["width"], ground.size["height"]]) / 2
    ActionChains(browser).move_to_element_with_offset(ground, *map(round, offset)).click().perform()
    wait_for(lambda: browser.execute_script("return streamkit.page.followed") == 2)
    text = browser.find_element(By.ID, "earth-cursor").text
    latitude, longitude = (float(word) for word in text.partition(" ±")[0].split(", "))
    lon, lat = place(*PLACES_PX[1])
    assert latitude == pytest.approx(lat, abs=2 / px_per_m / METRES_PER_DEGREE)
    assert longitude == pytest.approx(lon, abs=3 / px_per_m / METRES_PER_DEGREE)
    assert text.endswith("± 3.0 m")
    assert browser.find_element(By.CSS_SELECTOR, ".maplibregl-ctrl-scale").text.endswith(" m")
    assert_all_is_local(browser, url)


@pytest.mark.timeout(180)
@pytest.mark.parametrize("kind", [MVT, PNG])
def test_an_archive_of_tiles_is_shown(
    browser: Chrome, serve_keys: Callable[..., str], key: str, publish: Callable[[], None],
    wait_for: Callable[..., Any], tmp_path: Path, kind: int,
) -> None:  # fmt: skip
    """Tiles of images, and vectors as areas; the page reads parts of the file from the server."""
    image = cv2.imencode(".png", np.full((256, 256, 3), BLUE, np.uint8))[1].tobytes()
    write_pmtiles(tmp_path / "base.pmtiles", image if kind == PNG else vector_tile(), kind)
    url = serve_keys(key, basemap=tmp_path / "base.pmtiles")
    open_map(browser, url, publish, wait_for)
    ground = np.median(pixels(browser).reshape(-1, 3), axis=0)
    bare = np.array([26, 20, 16])
    assert (
        np.abs(ground - (BLUE if kind == PNG else bare + 0.15 * (np.array([163, 148, 138]) - bare))).max() < 6
    )
    assert_all_is_local(browser, url)


@pytest.mark.timeout(180)
def test_the_mosaic_lies_on_the_map(
    browser: Chrome, serve_keys: Callable[..., str], key: str, publish: Callable[[], None],
    publish_mosaic: Callable[[np.ndarray[Any, Any]], None], wait_for: Callable[..., Any],
) -> None:  # fmt: skip
    """Between its corners on the plane, not where it is black; without base map none is requested."""
    url = serve_keys(key)
    is_shown = open_map(browser, url, publish, wait_for)
    image = np.zeros((100, 100, 3), np.uint8)
    image[:, 50:] = RED
    publish_mosaic(image)
    wait_for(lambda: has_colour(pixels(browser), RED).any())
    wait_for(is_shown)
    shown = pixels(browser)
    red, dots = has_colour(shown, RED), blobs(shown, YELLOW)
    px = np.linalg.norm(dots[2] - dots[0]) / math.dist(PLACES_PX[2], PLACES_PX[0])
    columns = np.nonzero(red.any(0))[0]
    assert columns[-1] - columns[0] == pytest.approx(200 * px, abs=3)
    assert columns[0] == pytest.approx(dots[1][0], abs=3)
    assert not any(name.endswith("/basemap") for name in browser.execute_script(
        "return performance.getEntriesByType('resource').map((entry) => entry.name)"
    ))  # fmt: skip
