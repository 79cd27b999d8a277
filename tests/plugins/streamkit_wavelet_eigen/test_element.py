"""waveleteigen in harness and pipeline: features for each detection, in a space learnt on the way."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streamkit import (
    Detections,
    ElementFailure,
    Features,
    FeatureSpace,
    Frame,
    Pipeline,
    ResourceError,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_wavelet_eigen.model_file import load_model
from streamkit_wavelet_eigen.windows import box_places, cut_windows


def _detections(count: int, seed: int = 0, width: int = 320, height: int = 240) -> Detections:
    generator = np.random.default_rng(seed)
    centres = generator.uniform((30, 30), (width - 30, height - 30), (count, 2))
    halves = generator.uniform(6, 14, (count, 2))
    return Detections(
        centroids=centres,
        boxes=np.hstack([centres - halves, centres + halves]),
        areas=np.ones(count),
        scores=np.ones(count),
    )


def _frame(count: int, seed: int = 0, pixel_format: str = "GRAY8") -> Frame:
    rows = 240 if pixel_format == "GRAY8" else 360
    image = np.random.default_rng(seed + 100).integers(0, 256, (rows, 320), np.uint8)
    return Frame(image, raw_video_caps(pixel_format, 320, 240), pts=seed).attach(_detections(count, seed))


def _vectors(frame: Frame) -> np.ndarray:
    features = frame.get(Features)
    assert features is not None
    return features.vectors


def _space(frame: Frame) -> Any:
    space = frame.get(FeatureSpace)
    assert space is not None
    return space


@pytest.mark.parametrize("pixel_format", ["GRAY8", "I420", "NV12"])
def test_one_row_per_detection(pixel_format: str) -> None:
    """Every frame with detections has one vector each, and the space they were made in; pixels pass."""
    with Harness("waveleteigen", components=6) as harness:
        for seed, count in enumerate((4, 1, 9)):
            given = _frame(count, seed, pixel_format)
            (frame,) = harness.push(given)
            assert frame.data is given.data
            assert _vectors(frame).shape == (count, 6)
            assert _vectors(frame).dtype == np.float32
            assert isinstance(_space(frame), FeatureSpace)
            assert _space(frame).patch_size == (32, 32)


def test_features_are_embeddings_in_the_attached_space() -> None:
    """Embedding the same windows again in the frame's space gives the frame's vectors."""
    with Harness("waveleteigen", components=4) as harness:
        given = _frame(7)
        (frame,) = harness.push(given)
    detections = _detections(7)
    windows = cut_windows(given.data, box_places(detections.centroids, detections.boxes), 32)
    np.testing.assert_allclose(_space(frame).embed(windows.patches), _vectors(frame), atol=0.05)


def test_before_two_windows_there_is_no_feature() -> None:
    """What cannot be known yet is left out, not faked."""
    with Harness("waveleteigen") as harness:
        (empty,), (single,), (third,) = (harness.push(_frame(n, n)) for n in (0, 1, 2))
    for frame in (empty, single):
        assert frame.get(Features) is None
        assert frame.get(FeatureSpace) is None
    assert _space(third).version == 1


def test_frames_without_detections_carry_the_space() -> None:
    """A tracker needs the space on every frame; features only where there are detections."""
    with Harness("waveleteigen") as harness:
        harness.push(_frame(5))
        (frame,) = harness.push(_frame(0, 1))
    assert frame.get(Features) is None
    assert _space(frame).version == 1


def test_version_rises_with_learning_and_stays_without() -> None:
    """`learn` may be switched off while playing; then vectors of the same window stay the same."""
    with Harness("waveleteigen", batch=8) as harness:
        versions = [_space(harness.push(_frame(8, seed))[0]).version for seed in range(3)]
        assert versions == [1, 2, 3]
        harness.element.set_property("learn", False)
        still = [harness.push(_frame(8, 50))[0] for _ in range(3)]
        assert [_space(frame).version for frame in still] == [3, 3, 3]
        np.testing.assert_array_equal(_vectors(still[0]), _vectors(still[2]))


def test_same_input_same_output() -> None:
    """Two runs over the same frames agree bit for bit."""
    runs = []
    for _ in range(2):
        with Harness("waveleteigen", batch=6) as harness:
            runs.append([_vectors(harness.push(_frame(5, seed))[0]) for seed in range(4)])
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_same_target_is_nearer_than_others() -> None:
    """A window seen again, with noise, is nearest to its own vector."""
    first = _frame(10)
    noise = np.random.default_rng(7).integers(-3, 4, first.data.shape)
    again = Frame(np.clip(first.data + noise, 0, 255).astype(np.uint8), first.caps).attach(_detections(10))
    with Harness("waveleteigen", batch=1000, mode="raw") as harness:
        known, seen = (_vectors(harness.push(frame)[0]) for frame in (first, again))
    distances = np.linalg.norm(known[:, None] - seen[None], axis=2)
    assert distances.argmin(axis=1).tolist() == list(range(10))


def test_unusable_windows_are_counted_and_finite() -> None:
    """Flat, clipped and tiny windows, and boxes of NaN, give finite rows and are told at the end."""
    image = np.random.default_rng(1).integers(0, 256, (240, 320), np.uint8)
    image[:, 200:] = 77
    boxes = np.array(
        [[20, 20, 50, 50], [90, 90, 120, 120], [220, 20, 250, 50], [-20, 20, 10, 50], [60, 60, 64, 64]]
    )
    boxes = np.vstack([boxes.astype(float), np.full(4, np.nan)])
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    detections = Detections(centres, boxes, np.ones(6), np.ones(6))
    with Harness("waveleteigen") as harness:
        (frame,) = harness.push(Frame(image, raw_video_caps("GRAY8", 320, 240)).attach(detections))
        harness.drain()
        message = next(message for message in harness.messages if message.text == "windows")
    vectors = _vectors(frame)
    assert np.isfinite(vectors).all()
    assert (vectors[[2, 5]] == 0).all()
    assert np.abs(vectors[0]).max() > 0
    told = message.fields
    assert (told["windows"], told["flat"], told["clipped"], told["tiny"]) == (6, 2, 2, 2)


def test_one_pixel_frames() -> None:
    """A picture of 1x1 gives flat windows and teaches nothing."""
    caps = raw_video_caps("GRAY8", 1, 1)
    with Harness("waveleteigen") as harness:
        (frame,) = harness.push(Frame(np.full((1, 1), 9, np.uint8), caps).attach(_detections(3)))
    assert frame.get(Features) is None


def test_a_saved_space_is_a_model(tmp_path: Path) -> None:
    """`save` writes at EOS what `model` starts from: same vectors, without learning."""
    path = tmp_path / "space.npz"
    with Harness("waveleteigen", save=str(path), patch=16, mode="denoise") as harness:
        (frame,) = harness.push(_frame(12))
        harness.drain()
    assert load_model(path).space.patch_size == (16, 16)
    with Harness("waveleteigen", model=str(path), learn=False) as harness:
        (again,) = harness.push(_frame(12))
    assert _space(again).version == _space(frame).version
    np.testing.assert_allclose(_vectors(again), _vectors(frame), atol=1e-3)


def test_a_stopped_stream_is_saved_too(tmp_path: Path) -> None:
    """Without EOS the space is written when the element stops."""
    path = tmp_path / "space.npz"
    with Harness("waveleteigen", save=str(path)) as harness:
        harness.push(_frame(4))
    assert load_model(path).space.version == 1


def test_files_that_cannot_be_used_are_errors_at_start(tmp_path: Path) -> None:
    """A missing or foreign model and an unwritable folder are refused before the first frame."""
    foreign = tmp_path / "foreign.npz"
    foreign.write_bytes(b"not a space")
    for properties in (
        {"model": str(tmp_path / "missing.npz")},
        {"model": str(foreign)},
        {"save": str(tmp_path / "missing" / "space.npz")},
    ):
        with pytest.raises(ResourceError, match=next(iter(properties))):
            Harness("waveleteigen", **properties)


@pytest.mark.parametrize(
    ("properties", "text"),
    [
        ({"patch": 31}, "even"),
        ({"wavelet": "morl"}, "no discrete wavelet"),
        ({"blocks": 5}, "multiple of blocks"),
        ({"components": 17, "blocks": 8}, "values of a block"),
    ],
)
def test_settings_that_do_not_fit_are_errors_at_start(properties: dict[str, Any], text: str) -> None:
    """What does not fit together is refused with the rule."""
    with pytest.raises(ValueError, match=text):
        Harness("waveleteigen", **properties)


def test_learning_off_without_a_model_is_told() -> None:
    """Such a pipeline would silently have no features."""
    with Harness("waveleteigen", learn=False) as harness:
        assert any("no model" in message.text for message in harness.messages)
        assert harness.push(_frame(3))[0].get(Features) is None


def test_pipeline() -> None:
    """In a described pipeline the element is found, negotiates and keeps every frame."""
    text = "appsrc name=in ! waveleteigen components=5 mode=raw ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for seed in range(6):
            pipeline["in"].push(_frame(3, seed))
        pipeline["in"].end()
        frames = list(pipeline["out"])
    assert [frame.pts for frame in frames] == list(range(6))
    assert all(_vectors(frame).shape == (3, 5) for frame in frames)


def test_pipeline_reports_a_bad_model(tmp_path: Path) -> None:
    """The error names the element and the file."""
    with pytest.raises(ElementFailure, match=r"waveleteigen0: model: .*missing\.npz"):
        Pipeline.parse(f"appsrc ! waveleteigen model={tmp_path}/missing.npz ! fakesink").run(timeout_s=5)
