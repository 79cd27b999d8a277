"""Of a growing mosaic pages get the tiles that have changed; another mosaic begins anew."""

from __future__ import annotations

import json
import struct
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit import Pipeline, Registration
from streamkit.geometry.homography import translation
from streamkit_view.messages import MOSAIC, TILE, PageMessage
from streamkit_view.mosaic_tiles import MosaicTiles
from streamkit_zenoh.wire.frame_header import FrameHeader, frame_header, read_header

SIDE = 32  # of the tiles of a mosaic of 320 px
HALF = np.diag([2.0, 2.0, 1.0])
Pixels = np.ndarray[Any, Any]


def header(image: Pixels, to_plane: Pixels | None = HALF, reference: int = 3) -> FrameHeader:
    """The header of a mosaic."""
    size = {"width": image.shape[1], "height": image.shape[0]}
    motion = {"reference": reference, "status": "ok"}
    record = {"schema": "streamkit.tracks/1", "source": "s", "seq": 0, "epoch": 0, "tracks": [], "dropped": 0}
    whole = {
        "schema": "streamkit.frame/1", "record": record | size, "format": "BGR",
        "picture_width": image.shape[1], "picture_height": image.shape[0],
        "motion": motion if to_plane is None else motion | {"to_reference": to_plane.tolist()},
    }  # fmt: skip
    return read_header(json.dumps(whole).encode())


def coded(image: Pixels, suffix: str = ".jpg") -> bytes:
    """As it is published."""
    return bytes(cv2.imencode(suffix, image)[1])


def ground(seed: int = 1) -> Pixels:
    """A photograph's like, uint8[400, 600, 3], brighter than black."""
    coarse = np.random.default_rng(seed).integers(40, 255, (50, 75, 3), np.uint8)
    return cv2.resize(coarse, (600, 400), interpolation=cv2.INTER_CUBIC)


def window(painted: Pixels, left: int, top: int) -> Pixels:
    """A mosaic of 320 x 240 that shows the ground from there on."""
    return np.ascontiguousarray(painted[top : top + 240, left : left + 320])


def parts(messages: list[PageMessage]) -> dict[tuple[int, int], Pixels]:
    """The tiles of messages, by column and row."""
    found = {}
    for message in messages:
        if message.kind == TILE:
            assert isinstance(message.data, bytes)
            (length,) = struct.unpack_from("<I", message.data)
            body = json.loads(message.data[4 : 4 + length])["body"]
            assert (body["column"], body["row"]) == message.part
            pixels = cv2.imdecode(np.frombuffer(message.data[4 + length :], np.uint8), cv2.IMREAD_COLOR)
            found[body["column"], body["row"]] = np.asarray(pixels)
    return found


def beginning(messages: list[PageMessage]) -> dict[str, Any]:
    """The message that begins a mosaic, which must be the first."""
    assert [message.kind for message in messages].count(MOSAIC) == 1
    assert messages[0].kind == MOSAIC
    return dict(json.loads(messages[0].data)["body"])


def test_the_first_mosaic_comes_whole_but_for_what_is_black() -> None:
    """With its place on the plane and the number of its tiles."""
    painted = np.zeros((400, 600, 3), np.uint8)
    painted[40:150, 70:250] = ground()[40:150, 70:250]
    messages = MosaicTiles(0).update(coded(window(painted, 0, 0)), header(window(painted, 0, 0)), 1)
    begun, tiles = beginning(messages), parts(messages)
    assert begun == {"reference": 3, "to_reference": HALF.tolist(), "side": SIDE, "tiles": len(tiles)}
    assert set(tiles) == {(column, row) for column in range(2, 8) for row in range(1, 5)}
    shown = np.zeros((240, 320, 3), np.uint8)
    for (column, row), tile in tiles.items():
        shown[row * SIDE : (row + 1) * SIDE, column * SIDE : (column + 1) * SIDE] = tile[: 240 - row * SIDE]
    assert np.abs(shown.astype(int) - window(painted, 0, 0)).mean() < 5


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_what_has_not_changed_is_not_sent_though_the_window_moves(suffix: str) -> None:
    """The same ground 48 px further left in the image lies on the same tiles."""
    tiles, painted = MosaicTiles(0), np.zeros((400, 600, 3), np.uint8)
    painted[64:192, 64:256] = ground()[64:192, 64:256]
    first = window(painted, 0, 0)
    assert len(parts(tiles.update(coded(first, suffix), header(first), 1))) == 6 * 4
    assert tiles.update(coded(first, suffix), header(first), 1) == []
    painted[64:192, 256:300] = ground()[64:192, 256:300]
    second = window(painted, 48, 16)
    messages = tiles.update(coded(second, suffix), header(second, HALF @ translation(np.array([48, 16]))), 1)
    assert set(parts(messages)) == {(column, row) for column in (8, 9) for row in range(2, 6)}
    assert {message.kind for message in messages} == {TILE}


@pytest.mark.parametrize(
    ("to_plane", "reference", "run"),
    [
        (HALF, 4, 1),
        (HALF, 3, 2),
        (np.diag([4.0, 4.0, 1.0]), 3, 1),
        (HALF @ translation(np.array([0.5, 0.0])), 3, 1),
        (HALF @ translation(np.array([1e9, 0.0])), 3, 1),
        (np.array([[2, 0, 0], [0, 2, 0], [1e-5, 0, 1.0]]), 3, 1),
        (np.full((3, 3), 1e300), 3, 1),
    ],
)
def test_another_plane_publisher_or_grid_begins_anew(to_plane: Pixels, reference: int, run: int) -> None:
    """Nothing of the mosaic before is kept."""
    tiles, image = MosaicTiles(0), window(ground(), 0, 0)
    first = tiles.update(coded(image), header(image), 1)
    again = tiles.update(coded(image), header(image, to_plane, reference), run)
    assert beginning(again)["tiles"] == len(parts(again)) == len(parts(first)) == 80
    assert set(parts(again)) == set(parts(first))


def test_a_mosaic_that_has_lost_ground_begins_anew() -> None:
    """A mosaic grows; one with black tiles where there was ground is another one."""
    tiles, image = MosaicTiles(0), window(ground(), 0, 0)
    tiles.update(coded(image), header(image), 1)
    image[:64] = 0
    again = tiles.update(coded(image), header(image), 1)
    assert beginning(again)["tiles"] == len(parts(again)) == 60


def test_a_mosaic_that_lies_nowhere_is_not_sent() -> None:
    """Without a registration a page cannot draw it."""
    image = window(ground(), 0, 0)
    assert MosaicTiles(0).update(coded(image), header(image, None), 1) == []


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", b"\x89PNG", coded(ground()), coded(ground())[:200]])
def test_what_is_no_mosaic_is_refused(data: bytes) -> None:
    """No image, one of another size than its header says, and a part of one."""
    image = window(ground(), 0, 0)
    with pytest.raises(ValueError):  # noqa: PT011
        MosaicTiles(0).update(data, header(image), 1)


def test_the_tiles_of_a_flight_stay_where_they_are() -> None:
    """A page that keeps the tiles sees the last mosaic whole; it was sent less than half of the images."""
    text = (
        "dronetestsrc num-buffers=120 seed=1 ! video/x-raw, width=640, height=360 "
        "! stitch name=s preview-interval=0.4  s.src ! fakesink "
        "s.mosaic ! video/x-raw, format=BGR, width=640, height=480 ! appsink name=out"
    )
    tiles = MosaicTiles(0)
    kept: dict[tuple[int, int], Pixels] = {}
    whole = sent = 0
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for frame in pipeline["out"]:
            data = coded(np.asarray(frame.data))
            described = read_header(frame_header(frame, "s", 1, 0, frame.data.shape))
            messages = tiles.update(data, described, 1)
            if messages and messages[0].kind == MOSAIC:
                kept, place = {}, np.array(json.loads(messages[0].data)["body"]["to_reference"])
            kept |= parts(messages)
            whole, sent = whole + len(data), sent + sum(len(message.data) for message in messages)
    registration = frame.get(Registration)
    x, y = np.rint(np.linalg.solve(place, registration.to_reference)[:2, 2]).astype(int)
    shown = np.zeros((2000, 2000, 3), np.uint8)  # from 1000 px above and left of the grid's origin on
    for (column, row), tile in kept.items():
        left, top = 1000 + column * 64, 1000 + row * 64
        shown[top : top + 64, left : left + 64] = tile
    part = shown[1000 + y : 1480 + y, 1000 + x : 1640 + x]
    assert np.abs(part.astype(int) - frame.data).mean() < 3
    assert sent < whole / 2


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=9, max_size=9), st.booleans())
def test_no_place_on_the_plane_breaks_it(values: list[float], is_small: bool) -> None:
    """A matrix from the network may be anything: the mosaic begins anew or continues, with all its tiles."""
    tiles, image = MosaicTiles(0), window(ground(), 0, 0)[:32, :64]
    place = np.array(values).reshape(3, 3) * (1e-300 if is_small else 1.0)
    for to_plane in (HALF, place, HALF):
        messages = tiles.update(coded(image), header(image, to_plane), 1)
        assert len(parts(messages)) == (8 if messages else 0)
