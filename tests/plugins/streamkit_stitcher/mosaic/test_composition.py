"""The finished mosaic: gains, seams, bands."""

import errno

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.mosaic.composition import PlacedFrame, compose
from streamkit_stitcher.mosaic.seams import SeamKind

SMALL = (360, 640)


def shift(x, y=0.0):
    """The homography of a shift."""
    return translation(np.array([float(x), float(y)]))


def row(ground, gains=(1.0, 1.0, 1.0), moved=0):
    """Three frames side by side, each with its gain, and the ground they show."""
    views = [
        np.clip(ground[:360, x : x + 640] * gain, 0, 255)
        for x, gain in zip((0, 300, 600), gains, strict=True)
    ]
    places = [PlacedFrame(n, SMALL, shift(300 * n + (moved if n == 1 else 0))) for n in range(3)]
    return [view.astype(np.uint8) for view in views], places, ground[:360, :1240]


@pytest.mark.parametrize("seam", list(SeamKind))
def test_exact_homographies_give_the_ground(ground, seam):
    """The blended frames are the ground, to a grey level or two."""
    views, places, truth = row(ground)
    whole = compose(places, views.__getitem__, seam, 64_000_000)
    assert whole.frames == 3
    assert whole.image.shape == truth.shape
    difference = np.abs(whole.image.astype(int) - truth)
    assert np.percentile(difference, 99) <= 2


def test_exposures_are_made_even(ground):
    """A frame half as bright again does not stand out after its gain is taken back."""
    views, places, truth = row(ground // 2 + 20, (1.0, 1.3, 1.0))
    whole = compose(places, views.__getitem__, SeamKind.VORONOI, 64_000_000)
    ratio = whole.image[40:320, 40:1200] / truth[40:320, 40:1200].astype(float)
    columns = ratio.mean(axis=0)
    assert columns.max() / columns.min() < 1.12


def test_each_part_shows_one_frame(ground):
    """A thing that moved between two frames is there once or not at all, never as a ghost."""
    views, places, _ = row(ground * 0 + 100)
    views[0][150:180, 500:530] = 250
    views[1][150:180, 260:290] = 250
    whole = compose(places, views.__getitem__, SeamKind.VORONOI, 64_000_000)
    bright = whole.image[165, :].astype(int)
    half_way = ((bright > 130) & (bright < 220)).sum()
    assert half_way < 12


def test_a_cut_seam_goes_round_what_leans(ground):
    """A tall object with parallax is whole, as one of the frames shows it."""
    views, places, _ = row(ground // 2, (1.0, 1.25, 1.0))
    for view, left in zip(views, (450, 470 - 300), strict=False):
        view[150:200, left : left + 40] = 250
    wide = {}
    for seam in SeamKind:
        shown = compose(places, views.__getitem__, seam, 64_000_000).image[155:195, 430:530]
        wide[seam] = np.median((shown > 180).sum(axis=1))
    assert wide[SeamKind.GRAPHCUT] == pytest.approx(40, abs=2)
    assert wide[SeamKind.VORONOI] == pytest.approx(60, abs=5)


def test_a_large_mosaic_is_put_together_in_a_file(ground):
    """Beyond the memory it may take, the frame is a map of a file with the same pixels."""
    views, places, _ = row(ground)
    small = compose(places, views.__getitem__, SeamKind.VORONOI, 64_000_000)
    mapped = compose(places, views.__getitem__, SeamKind.VORONOI, 1000)
    assert isinstance(mapped.image.base, np.memmap) or isinstance(mapped.image, np.memmap)
    assert np.array_equal(mapped.image, small.image)


def test_without_room_for_the_file_there_is_an_error(ground, monkeypatch):
    """The room is asked for before the first pixel is written, where a full disk would end the process."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full)
    views, places, _ = row(ground)
    with pytest.raises(OSError, match="No space left"):
        compose(places, views.__getitem__, SeamKind.VORONOI, 1000)


def test_degenerate_homographies_are_left_out(ground):
    """A frame that cannot be placed does not smear the mosaic; without any there is none."""
    view = ground[:360, :640]
    wrong = PlacedFrame(0, SMALL, np.diag([-1.0, 1.0, 1.0]))
    assert compose([wrong], lambda _: view, SeamKind.VORONOI, 1_000_000) is None
    whole = compose([wrong, PlacedFrame(0, SMALL, np.eye(3))], lambda _: view, SeamKind.VORONOI, 1_000_000)
    assert whole.frames == 1
    assert np.array_equal(whole.image, view)


def test_what_fills_gaps_gives_way(ground):
    """It shows only beyond the others."""
    views = [ground[:360, :640], np.full(SMALL, 255, np.uint8)]
    places = [PlacedFrame(0, SMALL, np.eye(3)), PlacedFrame(1, SMALL, shift(320), fills_gaps=True)]
    whole = compose(places, views.__getitem__, SeamKind.VORONOI, 64_000_000)
    assert np.abs(whole.image[100:260, 40:400].astype(float) - ground[100:260, 40:400]).mean() < 25
    assert whole.image[180, 900] > 120
