"""MosaicTiles: which parts of a growing mosaic have changed, so that pages are not sent the whole again."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import msgspec
import numpy as np

from streamkit.geometry.homography import FloatArray, corners, inverse, normalised, project
from streamkit_view.messages import MOSAIC, TILE, PageMessage, binary_message, text_message
from streamkit_zenoh.wire.frame_header import FrameHeader, MotionRecord
from streamkit_zenoh.wire.images import Image, ImageFormat, decode_image, encode_image, image_size

PIXEL_LIMIT = 8192**2  # of the largest frame of the pad `mosaic` of stitch
TILES_ACROSS = 10
BLOCK_PX = 16  # that JPEG codes together: what has not changed decodes to the same pixels
BLACK = 8  # most brightness of pixels without ground, which JPEG has changed
GRID_ERROR_PX = 0.1
FARTHEST_PX = 1 << 20

Key = tuple[int, int]


class MosaicTiles:
    """Cuts the mosaics of one feed into square tiles, and makes messages of those that have changed.

    `stitch` shows a mosaic on a grid of pixels that is fixed to the plane. While the next image continues
    the grid of the last, tiles stay where they are. One of another plane, size or scale, or that has lost
    ground, begins anew.

    Args:
        feed: index of the feed.
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
        size = image_size(data)
        if size is None or not 0 < size[0] * size[1] <= PIXEL_LIMIT:
            raise ValueError(f"a mosaic must be an image of 1 to {PIXEL_LIMIT} px, got {size}")
        if size != (header.record.width, header.record.height):
            raise ValueError(f"a mosaic must not be scaled, got {size} px")
        motion = header.motion
        if motion is None or motion.to_reference is None:
            return []
        side = BLOCK_PX * -(-max(size) // (TILES_ACROSS * BLOCK_PX))
        identity, to_plane = (run, motion.reference, size), np.array(motion.to_reference)
        origin = self._origin(to_plane, size) if identity == self._identity else None
        image = decode_image(data)
        tiles = {} if origin is None else dict(cut(image, origin, side))
        messages = []
        if origin is None or not self._checksums.keys() <= tiles.keys():
            self._identity, self._to_plane, self._checksums = identity, to_plane, {}
            tiles = dict(cut(image, (0, 0), side))
            messages.append(self._beginning(motion, side, len(tiles)))
        image_format = ImageFormat.PNG if data.startswith(b"\x89") else ImageFormat.JPEG
        for key, tile in tiles.items():
            checksum = zlib.crc32(np.ascontiguousarray(inner(tile)).data)
            if self._checksums.get(key) != checksum:
                self._checksums[key] = checksum
                messages.append(self._tile(key, encode_image(tile, image_format), image_format))
        return messages

    def _origin(self, to_plane: FloatArray, size: Key) -> Key | None:
        """Where the first pixel of an image lies on the grid; None if its pixels do not lie on that."""
        points = corners(size[::-1])
        with np.errstate(all="ignore"):
            moved = project(normalised(inverse(self._to_plane) @ to_plane), points) - points
            origin = np.rint(moved[0])
            if not (np.abs(moved - origin) < GRID_ERROR_PX).all() or np.abs(origin).max() > FARTHEST_PX:
                return None
        return int(origin[0]), int(origin[1])

    def _beginning(self, motion: MotionRecord, side: int, tiles: int) -> PageMessage:
        place = {"reference": motion.reference, "to_reference": motion.to_reference}
        body = msgspec.json.encode({**place, "side": side, "tiles": tiles})
        return text_message(MOSAIC, self._feed, body)

    def _tile(self, key: Key, data: bytes, image_format: ImageFormat) -> PageMessage:
        body = msgspec.json.encode({"column": key[0], "row": key[1]})
        extra: dict[str, object] = {"png": image_format is ImageFormat.PNG}
        return binary_message(TILE, self._feed, body, data, extra, part=key)


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
