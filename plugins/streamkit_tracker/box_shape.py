"""Size, place and turn of targets from upright boxes, once the direction of their motion is known.

A row of what detections have shown of a target is float64[8]: width and height of its upright box, px; how
long it was detected by itself, s; how far detections lie from its window on average, across and down, px; in
how many frames it was detected but not recognised, and in how many the window did not fit the detection;
and the last step, s. A row of what is seen is float64[8]: x and y of the centroid, width and height of the
box, x and y of its middle, standard deviation of the centroid, all px, and 1 where it holds others too.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import ANGLE, LENGTH, MINIMUM_SIDE, WIDTH, FloatArray

CodeArray = NDArray[np.int64]

BOX_WIDTH, BOX_HEIGHT, DETECTED_S, ACROSS, DOWN, UNLIKE, UNFIT, STEP_S = range(8)
SEEN_X, SEEN_Y, SEEN_WIDTH, SEEN_HEIGHT, MIDDLE_X, MIDDLE_Y, SEEN_STD, CROWDED = range(8)
RIGHT, AGAIN_HERE, AGAIN_THERE = range(3)

YOUNG_S = 1.0  # first detections often show a part only: until then size and place follow at once
RATED_S = 0.04  # the step that the rates are for: targets move, turn and come out of hiding by the clock
BOX_RATE, SHRINK_RATE = 0.15, 0.5
OFFSET_RATE = 0.12
YOUNG_OFF, YOUNG_RESIZED = 0.1, 0.1  # relative to the side, and as a log ratio
RESIZED = 0.18  # log ratio of a side beyond which the window starts again
LEAST_FIT, HARDLY_FIT = 0.6, 0.35  # overlap of window and detection below which one of them is wrong
SAME_SIZE = 1.5
PATIENCE, ODD_SIZE_PATIENCE_S = 2, 0.32
MISFITS_BEFORE_RESTART = 3
TRUSTED = 0.3

USUAL_ASPECT = 2.0
ASPECT_WEIGHT = 0.3
LARGEST_ASPECT = 5.0
LEAST_AGREEMENT = 0.8


@compiled
def without_sign(direction: float) -> float:
    """A direction as the angle of a line, in [-pi/2, pi/2); plain numbers, once for each target and frame."""
    return (direction + math.pi / 2) % math.pi - math.pi / 2


@compiled
def window_shape(box_width: float, box_height: float, heading: float) -> tuple[float, float]:
    """Length along the heading and width across it, of a rectangle that fills an upright box.

    Box width = length |cos| + width |sin|, box height = length |sin| + width |cos|. Near 45 degrees the
    two equations are one; there a weak pull towards a length of twice the width decides.

    Args:
        box_width: of the upright box, px.
        box_height: likewise, px.
        heading: direction of the length, rad.

    Returns:
        Length and width, px.
    """
    cosine, sine = abs(math.cos(heading)), abs(math.sin(heading))
    pull = ASPECT_WEIGHT**2
    diagonal_length, diagonal_width = 1 + pull, 1 + pull * USUAL_ASPECT**2
    mixed = 2 * cosine * sine - pull * USUAL_ASPECT
    along = cosine * box_width + sine * box_height
    across = sine * box_width + cosine * box_height
    determinant = diagonal_length * diagonal_width - mixed**2
    length = (diagonal_width * along - mixed * across) / determinant
    width = (diagonal_length * across - mixed * along) / determinant
    side = max(math.sqrt(max(box_width * box_height, 1.0)), MINIMUM_SIDE)
    length = min(max(length, 0.3 * side, MINIMUM_SIDE), LARGEST_ASPECT * side)
    width = min(max(width, length / LARGEST_ASPECT, MINIMUM_SIDE), 2.0 * side)
    return length, width


@compiled
def window_turn(box_width: float, box_height: float, heading: float) -> tuple[float, float, float]:
    """Length, width and angle of the window in an upright box: turned into the motion, where that can be.

    A car from above fills its box turned; a person who walks upright through a slanted view does not: no
    rectangle along the motion has that box. Then the box itself is the window.

    Args:
        box_width: of the upright box, px.
        box_height: likewise, px.
        heading: direction of motion, rad.

    Returns:
        Length and width, px, and the angle, rad.
    """
    length, width = window_shape(box_width, box_height, heading)
    cosine, sine = abs(math.cos(heading)), abs(math.sin(heading))
    sides = (length * cosine + width * sine, length * sine + width * cosine)
    common = min(sides[0], box_width) * min(sides[1], box_height)
    if common < LEAST_AGREEMENT * (sides[0] * sides[1] + box_width * box_height - common):
        return box_width, box_height, 0.0
    return length, width, without_sign(heading)


@compiled
def turn_boxes(shapes: FloatArray, headings: FloatArray, turned: FloatArray) -> None:
    """Fills in `window_turn` of rows float64[n, 8] at headings float64[n]: float64[n, 3]."""
    for row in range(len(shapes)):
        turned[row] = window_turn(shapes[row, BOX_WIDTH], shapes[row, BOX_HEIGHT], headings[row])


@compiled
def follow_detections(shapes: FloatArray, seen: FloatArray, step_s: float) -> None:
    """Lets the boxes of rows float64[n, 8] follow what is seen, float64[n, 8], where it shows nothing else.

    While a target is young its box is as long as was ever seen, or nearly.
    """
    for row in range(len(shapes)):
        shape = shapes[row]
        shape[STEP_S] = step_s
        if seen[row, CROWDED] > 0:
            continue
        for side in range(2):
            known, now = shape[BOX_WIDTH + side], seen[row, SEEN_WIDTH + side]
            rate = 1.0 if now > known else SHRINK_RATE
            if shape[DETECTED_S] >= YOUNG_S:
                rate = _share(BOX_RATE, step_s)
            shape[BOX_WIDTH + side] = known * (now / known) ** rate
        shape[DETECTED_S] += step_s


@compiled
def settle_windows(
    shapes: FloatArray,
    windows: FloatArray,
    means: FloatArray,
    seen: FloatArray,
    headings: FloatArray,
    deviations: FloatArray,
    trusts: FloatArray,
    alike: NDArray[np.bool_],
    looked_at: NDArray[np.bool_],
    verdicts: CodeArray,
    better: FloatArray,
) -> None:
    """Finds the windows that detections contradict, and where these are to begin again.

    Args:
        shapes: float64[n, 8], is changed in place.
        windows: float64[n, 5], as found by appearance.
        means: float64[n, 4], states of the targets.
        seen: float64[n, 8], the targets' detections in this frame, which show nothing else.
        headings: float64[n], directions of motion, or the windows' own, rad.
        deviations: float64[n], their standard deviations, rad; infinite where they are not known.
        trusts: float64[n], 0 to 1, how well the detections' sizes are those of the targets.
        alike: bool[n], whether the target was recognised.
        looked_at: bool[n], whether anybody tried.
        verdicts: int64[n], is filled: RIGHT, AGAIN_HERE at the state's place, or AGAIN_THERE, where the
            state moves along.
        better: float64[n, 5], is filled for all but RIGHT.
    """
    for row in range(len(shapes)):
        shape, verdicts[row] = shapes[row], RIGHT
        if alike[row]:
            shape[UNLIKE] = 0.0
        elif looked_at[row]:
            shape[UNLIKE] += 1.0 if trusts[row] > TRUSTED else 0.0
            if shape[UNLIKE] >= MISFITS_BEFORE_RESTART:
                verdicts[row] = AGAIN_HERE
                better[row, :2] = means[row, :2]
                better[row, 2:] = window_turn(shape[BOX_WIDTH], shape[BOX_HEIGHT], headings[row])
                continue
        if correct_window(
            shape, windows[row], seen[row], headings[row], deviations[row], trusts[row], better[row]
        ):
            verdicts[row] = AGAIN_THERE


@compiled
def correct_window(
    shape: FloatArray,
    window: FloatArray,
    seen: FloatArray,
    heading: float,
    deviation: float,
    trust: float,
    better: FloatArray,
) -> bool:
    """Whether one window is wrong; then `better`, float64[5], is filled. See `settle_windows`."""
    wrong = _wrong(shape, window, seen, heading, deviation, trust, better)
    if wrong:
        shape[ACROSS : UNFIT + 1] = 0.0
    return wrong


@compiled
def _wrong(
    shape: FloatArray,
    window: FloatArray,
    seen: FloatArray,
    heading: float,
    deviation: float,
    trust: float,
    better: FloatArray,
) -> bool:
    """Whether the window is wrong, and fills in where it would be right."""
    x, y, length, width, angle = window
    side = math.sqrt(length * width)
    better[0], better[1] = seen[MIDDLE_X], seen[MIDDLE_Y]
    better[2:] = window_turn(shape[BOX_WIDTH], shape[BOX_HEIGHT], heading)
    resized = max(abs(math.log(better[LENGTH] / length)), abs(math.log(better[WIDTH] / width)))
    if shape[DETECTED_S] < YOUNG_S:
        return bool(np.hypot(better[0] - x, better[1] - y) > YOUNG_OFF * side or resized > YOUNG_RESIZED)
    if _contradicted(shape, window, seen):
        shape[BOX_WIDTH], shape[BOX_HEIGHT] = seen[SEEN_WIDTH], seen[SEEN_HEIGHT]
        better[2:] = window_turn(shape[BOX_WIDTH], shape[BOX_HEIGHT], heading)
        return True
    rate = trust * _share(OFFSET_RATE, shape[STEP_S])
    shape[ACROSS] += rate * (seen[SEEN_X] - x - shape[ACROSS])
    shape[DOWN] += rate * (seen[SEEN_Y] - y - shape[DOWN])
    better[0], better[1] = x + shape[ACROSS], y + shape[DOWN]
    return bool(
        np.hypot(shape[ACROSS], shape[DOWN]) > max(0.8, 0.06 * side)
        or abs(without_sign(better[ANGLE] - angle)) > max(0.25, 2.5 * deviation)
        or resized > RESIZED
    )


@compiled
def _contradicted(shape: FloatArray, window: FloatArray, seen: FloatArray) -> bool:
    """Whether window and detection have lain apart for so long that the window must be wrong."""
    ratio = seen[SEEN_WIDTH] * seen[SEEN_HEIGHT] / (shape[BOX_WIDTH] * shape[BOX_HEIGHT])
    fit = _overlap(window, seen)
    shape[UNFIT] = 0.0 if fit >= LEAST_FIT else shape[UNFIT] + 1.0
    usual = 1 / SAME_SIZE < ratio < SAME_SIZE
    patience = PATIENCE if usual else max(PATIENCE, np.rint(ODD_SIZE_PATIENCE_S / shape[STEP_S]))
    return bool(shape[UNFIT] >= patience or (usual and fit < HARDLY_FIT))


@compiled
def _overlap(window: FloatArray, seen: FloatArray) -> float:
    """Intersection over union of a window's upright box and a detection's."""
    x, y, length, width, angle = window
    cosine, sine = abs(math.cos(angle)), abs(math.sin(angle))
    across, down = length * cosine + width * sine, length * sine + width * cosine
    shared_x = (across + seen[SEEN_WIDTH]) / 2 - abs(x - seen[MIDDLE_X])
    shared_y = (down + seen[SEEN_HEIGHT]) / 2 - abs(y - seen[MIDDLE_Y])
    shared_x = min(shared_x, across, seen[SEEN_WIDTH])
    shared_y = min(shared_y, down, seen[SEEN_HEIGHT])
    common = max(shared_x, 0.0) * max(shared_y, 0.0)
    return float(common / (across * down + seen[SEEN_WIDTH] * seen[SEEN_HEIGHT] - common))


@compiled
def _share(rate: float, step_s: float) -> float:
    """What a rate for steps of `RATED_S` comes to in another step."""
    return float(1.0 - (1.0 - rate) ** (step_s / RATED_S))
