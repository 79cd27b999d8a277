"""MosaicTiles: which parts of a growing mosaic have changed, so that pages are not sent the whole again."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import msgspec
import numpy as np

from streamkit.geometry.homography import FloatArray, corners, inverse, normalised, project
from streamkit_view.messages import MOSAIC, TILE, PageMessage, binary_message, text_message
from streamkit_zenoh.wire.frame_header import FrameHeader
from streamkit_zenoh.wire.images import Image, ImageFormat, decode_image, encode_image, image_size

PIXEL_LIMIT = 8192**2  # of the largest frame of the pad `mosaic` of stitch
TILES_ACROSS = 10
BLOCK_PX = 16  # that JPEG codes together: what has not changed decodes to the same pixels
BLACK = 8  # most brightness of pixels without ground, which JPEG has changed
GRID_ERROR_PX = 0.1
MAX_PX = 1 << 20

Key = tuple[int, int]


class MosaicTiles:
    """Cuts the mosaics of one feed into square tiles, and makes messages of those that have changed.

    `stitch` shows a mosaic on a grid of pixels that is fixed to the plane. While the next image continues
    the grid of the last, tiles stay where they are. One of another plane, size or scale, or that has lost
    ground, begins anew.
    """

    def __init__(self, feed: int) -> None:
        self._feed = feed
        self._identity: object = None
        self._to_plane: FloatArray = np.eye(3)
        self._checksums: dict[Key, int] = {}

    def update(self, data: bytes, header: FrameHeader, run: int) -> list[PageMessage]:
        """The messages for an image: a new beginning if there is one, then the changed tiles.

        Args:
            data: JPEG or PNG.
            header: of the image; without its place on the plane there are no messages.
            run: of the publisher.

        Raises:
            ValueError: the image is invalid, or scaled.
        """
        size, said = image_size(data), (header.record.width, header.record.height)
        if size is None or size != said or size[0] * size[1] > PIXEL_LIMIT:
            raise ValueError(f"a mosaic must be an image of {said} and at most {PIXEL_LIMIT} px, got {size}")
        motion = header.motion
        if motion is None or motion.to_reference is None:
            return []
        image, image_format = decode_image(data), ImageFormat.PNG if data[:1] == b"\x89" else ImageFormat.JPEG
        side = BLOCK_PX * -(-max(size) // (TILES_ACROSS * BLOCK_PX))
        identity, to_plane = (run, motion.reference, size), np.array(motion.to_reference)
        tiles = self._continued(image, to_plane, side) if identity == self._identity else None
        messages = []
        if tiles is None:
            self._identity, self._to_plane, self._checksums = identity, to_plane, {}
            tiles = dict(cut(image, (0, 0), side))
            place = {"reference": motion.reference, "to_reference": motion.to_reference}
            body = msgspec.json.encode({**place, "side": side, "tiles": len(tiles)})
            messages.append(text_message(MOSAIC, self._feed, body))
        for key, tile in tiles.items():
            checksum = zlib.crc32(np.ascontiguousarray(inner(tile)).data)
            if self._checksums.get(key) != checksum:
                self._checksums[key] = checksum
                body = msgspec.json.encode({"column": key[0], "row": key[1]})
                coded = encode_image(tile, image_format)
                messages.append(binary_message(TILE, self._feed, body, coded, part=key))
        return messages

    def _continued(self, image: Image, to_plane: FloatArray, side: int) -> dict[Key, Image] | None:
        """The tiles of an image; None if its pixels do not lie on the grid, or it has lost ground."""
        points = corners((image.shape[0], image.shape[1]))
        with np.errstate(all="ignore"):
            moved = project(normalised(inverse(self._to_plane) @ to_plane), points) - points
            origin = np.rint(moved[0])
            if not (np.abs(moved - origin) < GRID_ERROR_PX).all() or np.abs(origin).max() > MAX_PX:
                return None
        tiles = dict(cut(image, (int(origin[0]), int(origin[1])), side))
        return tiles if self._checksums.keys() <= tiles.keys() else None


def cut(image: Image, origin: Key, side: int) -> Iterator[tuple[Key, Image]]:
    """Column, row and pixels of the tiles that are not black, of an image whose first pixel is at `origin`.

    Pixels of a tile outside of the image are black.
    """
    height, width = image.shape[:2]
    (x, y) = origin
    for row in range(y // side, -(-(y + height) // side)):
        for column in range(x // side, -(-(x + width) // side)):
            left, top = column * side - x, row * side - y
            part = image[max(0, top) : top + side, max(0, left) : left + side]
            tile = np.zeros((side, side, *image.shape[2:]), np.uint8)
            down, across = max(0, -top), max(0, -left)
            tile[down : down + part.shape[0], across : across + part.shape[1]] = part
            if inner(tile).max() > BLACK:
                yield (column, row), tile


def inner(tile: Image) -> Image:
    """A tile without its outermost pixels, which its neighbours colour.

    JPEG has one colour for two pixels across and down; decoders interpolate.
    """
    return tile[1:-1, 1:-1]
