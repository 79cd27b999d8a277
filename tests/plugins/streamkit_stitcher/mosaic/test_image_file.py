"""Mosaics on disk."""

import cv2
import numpy as np
import pytest

from streamkit_stitcher.mosaic.image_file import check_location, is_numbered, location_of, write_image


@pytest.mark.parametrize("name", ["m.png", "m.jpg", "m.JPEG", "m-%d.png", "m-%03d.png"])
def test_images_are_accepted_locations(tmp_path, name):
    """Suffix and number format are known, the directory is there."""
    check_location(str(tmp_path / name))


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("m.mp4", r"must end in \.png, \.jpg, \.jpeg, \.tif, \.tiff, got"),
        ("m", "must end in"),
        ("file/m.png", "cannot be written: Not a directory; name another file"),
        ("m-%s%s.png", "must be one number"),
        ("m-%q.png", "must be one number"),
    ],
)
def test_other_locations_are_refused_at_once(tmp_path, name, reason):
    """The error says the rule and the remedy before the flight, not after it."""
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=reason):
        check_location(str(tmp_path / name))


def test_a_directory_is_no_location(tmp_path):
    """A directory with a image's name is refused."""
    (tmp_path / "m.png").mkdir()
    with pytest.raises(OSError, match="cannot be written: Is a directory"):
        check_location(str(tmp_path / "m.png"))


def test_the_number_of_the_plane_goes_into_the_name():
    """%d stands for it; without it the name is as written."""
    assert location_of("m-%03d.png", 7).name == "m-007.png"
    assert location_of("m.png", 7).name == "m.png"
    assert location_of("100%%.png", 7).name == "100%.png"
    assert is_numbered("m-%03d.png")
    assert not is_numbered("100%%.png")


@pytest.mark.parametrize("shape", [(30, 40), (30, 40, 3)])
def test_a_png_holds_the_very_pixels(tmp_path, shape):
    """What is read back is what was written, and no partial file stays."""
    image = np.random.default_rng(0).integers(0, 255, shape, dtype=np.uint8)
    write_image(image, tmp_path / "m.png")
    assert np.array_equal(cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_UNCHANGED), image)
    assert [path.name for path in tmp_path.iterdir()] == ["m.png"]


def test_a_jpeg_that_is_too_long_is_refused(tmp_path):
    """The error names the size and the remedy, and the file that was there stays."""
    (tmp_path / "m.jpg").write_bytes(b"old")
    with pytest.raises(OSError, match=r"at most 65500 px, got 70000 x 2; write a \.png"):
        write_image(np.zeros((2, 70000), np.uint8), tmp_path / "m.jpg")
    assert (tmp_path / "m.jpg").read_bytes() == b"old"


def test_a_missing_folder_is_made_and_one_that_refuses_is_an_error(tmp_path):
    """A file in place of the folder is an OSError."""
    write_image(np.zeros((8, 8), np.uint8), tmp_path / "new" / "m.png")
    assert (tmp_path / "new" / "m.png").is_file()
    with pytest.raises(OSError, match="exists"):
        write_image(np.zeros((8, 8), np.uint8), tmp_path / "new" / "m.png" / "m.png")
