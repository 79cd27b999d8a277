"""Operations on boxes and images."""

import numpy as np

from streamkit_differencer.arrays import overlaps


def test_boxes_overlap_where_they_share_an_area():
    """Boxes that touch do not; every box is compared with every other one."""
    boxes = np.array([[0.0, 0, 10, 10], [20, 20, 30, 30]])
    others = np.array([[10.0, 0, 20, 10], [9, 9, 11, 11], [-5, -5, 40, 40], [0, 12, 30, 20]])
    assert overlaps(boxes, others).tolist() == [[False, True, True, False], [False, False, True, False]]
    assert overlaps(boxes, np.zeros((0, 4))).shape == (2, 0)
