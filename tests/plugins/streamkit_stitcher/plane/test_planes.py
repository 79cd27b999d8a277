"""The planes of a stream."""

from streamkit.geometry.homography import translation
from streamkit_stitcher.plane.planes import Planes
from streamkit_stitcher.plane.settings import PlaneSettings


def test_nothing_relates_a_plane_after_a_cut_to_an_adjustment_under_the_same_frame(ground):
    """An adjustment taken over by the frame of a cut moves the plane that ends, not the one that begins."""
    planes = Planes(PlaneSettings())
    planes.start((ground, ground[::2, ::2], ground[::4, ::4], ground[::8, ::8]), 1)
    assert planes.anchor is not None
    planes.adopt(planes.anchor, translation([5.0, 0.0]))
    planes.leave()
    assert planes.has_jumped
    assert planes.change is None
    assert planes.rebase is None
    planes.close()
