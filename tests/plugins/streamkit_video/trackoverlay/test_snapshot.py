"""Tests of writing an image whole or not at all."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit_video.trackoverlay.element import check_target, write_snapshot

IMAGE = np.full((6, 8, 3), 77, np.uint8)


def test_only_the_image_is_written(tmp_path: Path) -> None:
    """The file holds the image; no temporary file stays; an older file is replaced."""
    target = tmp_path / "shot.png"
    target.write_bytes(b"old")
    write_snapshot(target, IMAGE)
    np.testing.assert_array_equal(cv2.imread(str(target)), IMAGE)
    assert [path.name for path in tmp_path.iterdir()] == ["shot.png"]


def test_a_failure_leaves_the_old_file(tmp_path: Path) -> None:
    """A target that cannot be replaced is untouched and no temporary file stays."""
    target = tmp_path / "shot.png"
    target.mkdir()
    with pytest.raises(OSError, match=r"shot\.png"):
        write_snapshot(target, IMAGE)
    assert [path.name for path in tmp_path.iterdir()] == ["shot.png"]


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("gone/shot.png", "does not exist; make it first"),
        ("shot.odd", "no image format has the ending '.odd'"),
        ("shot", "no image format has the ending ''"),
        ("", "is a folder"),
    ],
)
def test_bad_targets_are_refused(tmp_path: Path, name: str, rule: str) -> None:
    """The error says what is wrong and what to do."""
    with pytest.raises(OSError, match=rule):
        check_target(tmp_path / name)
