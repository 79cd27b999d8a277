"""waveleteigen in harness and pipeline: features for each detection, in a space learnt on the way."""

from pathlib import Path
from typing import Any

import cv2
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
    Track,
    Tracks,
    TrackState,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_wavelet_eigen.model_file import load_model
from streamkit_wavelet_eigen.target_features import TargetFeatures
from streamkit_wavelet_eigen.windows import cut_windows, rotated_boxes


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
    windows = cut_windows(given.data, rotated_boxes(detections.centroids, detections.boxes), 32)
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
        versions = [_space(harness.push(_frame(2, seed))[0]).version for seed in range(9)]
        assert versions == [1, 1, 1, 1, 2, 2, 2, 2, 3]
        harness.element.set_property("learn", False)
        still = [harness.push(_frame(8, 50))[0] for _ in range(3)]
        assert [_space(frame).version for frame in still] == [3, 3, 3]
        np.testing.assert_array_equal(_vectors(still[0]), _vectors(still[2]))


def test_a_crowd_does_not_update_with_each_frame() -> None:
    """However many targets a frame has, four of them make a batch."""
    with Harness("waveleteigen", batch=8) as harness:
        versions = [_space(harness.push(_frame(30, seed))[0]).version for seed in range(9)]
    assert versions == [1, 1, 1, 1, 2, 2, 2, 2, 3]


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
    """Flat, clipped and tiny windows, and boxes of NaN, give finite rows and are counted at the end."""
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
    counts = message.fields
    assert (counts["windows"], counts["flat"], counts["clipped"], counts["tiny"]) == (6, 2, 2, 2)


def test_one_pixel_frames() -> None:
    """An image of 1x1 gives flat windows and nothing is learnt."""
    caps = raw_video_caps("GRAY8", 1, 1)
    with Harness("waveleteigen") as harness:
        (frame,) = harness.push(Frame(np.full((1, 1), 9, np.uint8), caps).attach(_detections(3)))
    assert frame.get(Features) is None


def test_a_saved_space_is_a_model(tmp_path: Path) -> None:
    """`save` writes at EOS what `model` starts from: same vectors, without learning. Its folder is made."""
    path = tmp_path / "made" / "space.npz"
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
    """A missing or foreign model and a folder that is a file are refused before the first frame."""
    foreign = tmp_path / "foreign.npz"
    foreign.write_bytes(b"not a space")
    for properties in (
        {"model": str(tmp_path / "missing.npz")},
        {"model": str(foreign)},
        {"save": str(foreign / "space.npz")},
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


def test_learning_off_without_a_model_is_reported() -> None:
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
    with pytest.raises(ElementFailure, match=r"waveleteigen0: model: /.*missing\.npz: .*; check the path"):
        Pipeline.parse(f"appsrc ! waveleteigen model={tmp_path}/missing.npz ! fakesink").run(timeout_s=5)


def _picture(seed: int, side: int = 24) -> np.ndarray:
    coarse = np.random.default_rng(seed).integers(20, 230, (6, 6)).astype(np.uint8)
    return np.asarray(cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC))


def _scene(names: str, angle: float = 0.0, noise_seed: int = 0) -> Frame:
    """Targets in a row, one for each letter, turned about their middles."""
    image = np.random.default_rng(noise_seed).integers(90, 110, (120, 320)).astype(np.uint8)
    centres = np.array([[40.0 + 60 * index, 60.0] for index in range(len(names))])
    for name, (x, y) in zip(names, centres, strict=True):
        matrix = cv2.getRotationMatrix2D((23.5, 23.5), -np.degrees(angle), 1.0)
        turned = cv2.warpAffine(_picture(ord(name), 48), matrix, (48, 48), borderMode=cv2.BORDER_REPLICATE)
        image[int(y) - 24 : int(y) + 24, int(x) - 24 : int(x) + 24] = turned
    centres -= 0.5
    boxes = np.hstack([centres - 12, centres + 12])
    ones = np.ones(len(names))
    tracks = tuple(
        Track(ord(name), TrackState.CONFIRMED, x, y, 24.0, 20.0, angle, (0.0, 0.0), np.eye(2), 1.0, 0)
        for name, (x, y) in zip(names, centres, strict=True)
    )
    frame = Frame(image, raw_video_caps("GRAY8", 320, 120))
    return frame.attach(Detections(centres, boxes, ones, ones), Tracks(tracks))


def _facts(frame: Frame) -> TargetFeatures:
    facts = frame.get(TargetFeatures)
    assert facts is not None
    return facts


def test_windows_of_tracks_are_rotated_by_their_angle() -> None:
    """A turned track has nearly the vector it had upright; as an upright detection it has another."""
    with Harness("waveleteigen", targets="tracks", mode="raw", learn=True, batch=1000, margin=1.0) as harness:
        (upright,) = harness.push(_scene("abcd"))
        harness.element.set_property("learn", False)
        (turned,) = harness.push(_scene("abcd", angle=0.9))
    assert _facts(upright).kind == "tracks"
    assert _facts(turned).ids.tolist() == [97, 98, 99, 100]
    distances = np.linalg.norm(_vectors(upright)[:, None] - _vectors(turned)[None], axis=2)
    assert distances.argmin(axis=1).tolist() == [0, 1, 2, 3]
    assert np.diag(distances).max() < 0.25 * (distances + 1e9 * np.eye(4)).min()


def test_a_given_window_has_one_row() -> None:
    """Whatever is detected, the fixed window is used in each frame."""
    with Harness("waveleteigen", window="16,36,48,48", mode="raw") as harness:
        for seed in range(3):
            (frame,) = harness.push(_scene("ab", noise_seed=seed))
    assert _facts(frame).kind == "window"
    assert _vectors(frame).shape == (1, 16)


def test_target_features_describe_windows() -> None:
    """Flags, reconstruction error and energy, row by row with the vectors."""
    with Harness("waveleteigen", components=2, batch=1000) as harness:
        harness.push(_frame(6))
        (frame,) = harness.push(_frame(9, 1))
    facts = _facts(frame)
    assert len(facts.flat) == len(facts.clipped) == len(facts.errors) == len(facts.energy) == 9
    assert (facts.errors > 1).all()
    assert ((facts.energy > 0) & (facts.energy < 1)).all()
    assert facts.version == _space(frame).version
    assert facts.labels == ()


@pytest.mark.parametrize(
    "properties", [{"blocks": 4}, {"blocks": 2, "basis": "per-block"}, {"approximation": 1}]
)
def test_blocks_learn_from_the_stream(properties: dict[str, Any]) -> None:
    """Vectors have the blocks' components one after the other, in a space that goes on learning."""
    with Harness("waveleteigen", components=5, batch=4, **properties) as harness:
        versions = [_space(harness.push(_frame(5, seed))[0]).version for seed in range(5)]
        (frame,) = harness.push(_frame(5, 9))
    assert versions == [1, 1, 2, 2, 3]
    assert _vectors(frame).shape == (5, 5 * properties.get("blocks", 1) ** 2)


def _gallery(folder: Path, names: str = "abcd", views: int = 4) -> Path:
    for name in names:
        (folder / name).mkdir(parents=True)
        for view in range(views):
            noise = np.random.default_rng(view).normal(0, 6, (48, 48))
            image = np.clip(_picture(ord(name), 48) + noise, 0, 255).astype(np.uint8)
            cv2.imwrite(str(folder / name / f"{view}.png"), image)
    return folder


@pytest.mark.parametrize(
    "properties",
    [{"preset": "recognition"}, {"preset": "modular"}, {"preset": "paper"}, {"mode": "raw"},
     {"mode": "raw", "discriminative": True, "components": 8}],
)  # fmt: skip
def test_targets_are_recognised_by_a_gallery(tmp_path: Path, properties: dict[str, Any]) -> None:
    """A folder of images is space and gallery; each detection gets the label of its nearest neighbour."""
    gallery = str(_gallery(tmp_path / "gallery"))
    with Harness("waveleteigen", gallery=gallery, learn=False, margin=2.0, **properties) as harness:
        (frame,) = harness.push(_scene("dbca"))
    detections = frame.get(Detections)
    assert detections is not None
    assert detections.labels == _facts(frame).labels == ("d", "b", "c", "a")
    assert (_facts(frame).margins > 0).all()


def test_targets_that_are_not_sure_have_no_label(tmp_path: Path) -> None:
    """`min-margin` is the least distance to the next label; an unknown target does not have it."""
    gallery = str(_gallery(tmp_path / "gallery"))
    properties = {"preset": "recognition", "gallery": gallery, "margin": 2.0, "min_margin": 0.5}
    with Harness("waveleteigen", **properties) as harness:
        (frame,) = harness.push(_scene("axcy"))
    assert _facts(frame).labels == ("a", "", "c", "")


def test_a_label_is_added_and_saved(tmp_path: Path) -> None:
    """While `label` is set windows join the gallery; the model file brings it to the next stream."""
    path = str(tmp_path / "model.npz")
    with Harness("waveleteigen", mode="raw", window="16,36,48,48", margin=1.0, batch=3, save=path) as harness:
        for name in "ab":
            harness.element.set_property("label", name)
            for seed in range(3):
                (frame,) = harness.push(_scene(name, noise_seed=seed))
        harness.element.set_property("label", "")
        assert _facts(frame).labels == ("b",)
        harness.drain()
    with Harness("waveleteigen", model=path, window="16,36,48,48", margin=1.0, learn=False) as harness:
        assert [_facts(harness.push(_scene(name, noise_seed=9))[0]).labels[0] for name in "ab"] == ["a", "b"]


def test_the_gallery_of_a_label_is_bounded(tmp_path: Path) -> None:
    """However long windows are added, a label keeps at most `gallery-limit` windows."""
    path = tmp_path / "model.npz"
    with Harness("waveleteigen", label="car", gallery_limit=7, save=str(path)) as harness:
        for seed in range(5):
            harness.push(_frame(5, seed))
    assert load_model(path).gallery.labels == ("car",) * 7


def test_a_fisher_space_needs_labels(tmp_path: Path) -> None:
    """Without labelled windows, or with one label, the element does not start."""
    with pytest.raises(ResourceError, match="discriminative needs labelled windows"):
        Harness("waveleteigen", discriminative=True)
    with pytest.raises(ResourceError, match="gallery: Fisher step: at least two labels"):
        Harness("waveleteigen", discriminative=True, gallery=str(_gallery(tmp_path / "gallery", "a")))


def test_a_fisher_space_stays(tmp_path: Path) -> None:
    """Axes learnt from labels are kept: the version does not rise with the stream."""
    gallery = str(_gallery(tmp_path / "gallery"))
    with Harness("waveleteigen", preset="recognition", gallery=gallery, batch=2) as harness:
        versions = {_space(harness.push(_frame(9, seed))[0]).version for seed in range(3)}
    assert versions == {1}


def test_a_broken_gallery_is_an_error_at_start(tmp_path: Path) -> None:
    """A folder that is not there or empty is refused with its name."""
    for folder in (tmp_path / "missing", tmp_path):
        with pytest.raises(ResourceError, match=f"gallery: .*{folder.name}"):
            Harness("waveleteigen", gallery=str(folder))


def test_a_frame_of_4000_px() -> None:
    """A window as large as a 4000x4000 frame passes, with a finite vector."""
    image = np.asarray(cv2.resize(_picture(3), (4000, 4000)))
    box = np.array([[0.0, 0, 4000, 4000], [1000, 1000, 1800, 1900]])
    detections = Detections((box[:, :2] + box[:, 2:]) / 2, box, np.ones(2), np.ones(2))
    with Harness("waveleteigen") as harness:
        (frame,) = harness.push(Frame(image, raw_video_caps("GRAY8", 4000, 4000)).attach(detections))
    assert np.isfinite(_vectors(frame)).all()
    assert _facts(frame).clipped[0] < 0.4
