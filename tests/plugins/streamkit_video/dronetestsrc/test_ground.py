"""Tests of reading the image of the ground."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit_video.dronetestsrc.element import load_ground


def test_the_shipped_photograph_is_there_and_small() -> None:
    """It is colour, large enough for 720p at 1:1, and no more than a megabyte."""
    image = load_ground(None)
    assert image.shape == (1980, 2640, 3)
    import streamkit_video

    folder = Path(streamkit_video.__file__).parent / "data"
    assert (folder / "aerial.jpg").stat().st_size <= 1_000_000
    assert "CC0" in (folder / "README.md").read_text(encoding="utf-8")


def test_another_image(tmp_path: Path) -> None:
    """A grey image file is read as colour."""
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((70, 80), 9, np.uint8))
    assert load_ground(str(tmp_path / "grey.png")).shape == (70, 80, 3)


@pytest.mark.parametrize("content", [b"", b"no image", b"\x89PNG\r\n\x1a\n"])
def test_a_file_without_an_image_is_refused(tmp_path: Path, content: bytes) -> None:
    """The error names the file and the remedy."""
    (tmp_path / "odd.png").write_bytes(content)
    with pytest.raises(OSError, match=r"odd\.png: .*give a JPEG or PNG file"):
        load_ground(str(tmp_path / "odd.png"))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    """It is FileNotFoundError, with the path."""
    with pytest.raises(FileNotFoundError, match=r"nowhere\.jpg"):
        load_ground(str(tmp_path / "nowhere.jpg"))
