"""featuresink writes each vector with its frame and box, whatever the feature space."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streamkit import (
    NO_TIME,
    Detections,
    Features,
    FeatureSpace,
    Frame,
    Pipeline,
    ResourceError,
    StreamkitError,
    raw_video_caps,
)
from streamkit.testing import Harness

CAPS = raw_video_caps("GRAY8", 160, 120)


def _frame(count: int, seq: int, **fields: Any) -> Frame:
    image = np.random.default_rng(seq).integers(0, 256, (120, 160), np.uint8)
    centres = np.random.default_rng(seq + 50).uniform(30, 90, (count, 2))
    boxes = np.hstack([centres - 10, centres + np.array([12, 10])])
    detections = Detections(centres, boxes, np.ones(count), np.ones(count))
    return Frame(image, CAPS, seq=seq, **fields).attach(detections)


def _read(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def test_pipeline_writes_what_waveleteigen_attaches(tmp_path: Path) -> None:
    """Vectors, version, places and flags of every frame, in order."""
    path = tmp_path / "features.npz"
    text = (
        "appsrc name=in ! waveleteigen components=4 batch=2 ! tee name=t "
        f"t. ! featuresink location={path} t. ! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for seq in range(4):
            pipeline["in"].push(_frame(3, seq + 7, pts=seq * 1000))
        pipeline["in"].end()
        frames = list(pipeline["out"])
        assert pipeline.wait(timeout_s=10) is not None
    read = _read(path)
    expected = [frame.get(Features).vectors for frame in frames]  # type: ignore[union-attr]
    np.testing.assert_array_equal(read["vectors"], np.concatenate(expected))
    assert read["seq"].tolist() == [frame.seq for frame in frames for _ in range(3)]
    assert read["pts_ns"].tolist() == [0] * 3 + [1000] * 3 + [2000] * 3 + [3000] * 3
    assert read["version"].tolist() == [
        frame.metadata[FeatureSpace].version
        for frame in frames
        for _ in range(3)  # type: ignore[attr-defined]
    ]
    assert read["id"].tolist() == [0, 1, 2] * 4
    np.testing.assert_allclose(read["length"], 22)
    np.testing.assert_allclose(read["width"], 20)
    assert not read["flat"].any()


def test_vectors_of_another_space(tmp_path: Path) -> None:
    """Without TargetFeatures boxes come from the detections; what is unknown is NaN."""
    path = tmp_path / "features.npz"
    vectors = np.array([[1.0, 2.0], [0.0, 0.0]], np.float32)
    with Harness("featuresink", location=str(path)) as harness:
        harness.push(_frame(2, 5).attach(Features(vectors)))
        harness.push(_frame(0, 6))
        harness.push(_frame(1, 7).attach(Features(vectors)))
        harness.drain()
    read = _read(path)
    np.testing.assert_array_equal(read["vectors"], np.concatenate([vectors, vectors]))
    assert read["pts_ns"].tolist() == [NO_TIME] * 4
    assert read["flat"].tolist() == [False, True] * 2
    assert np.isfinite(read["x"][:2]).all()
    assert np.isnan(read["x"][2:]).all()
    assert np.isnan(read["clipped"]).all()


def test_a_stopped_stream_keeps_its_rows(tmp_path: Path) -> None:
    """Without EOS the file is completed when the element stops."""
    path = tmp_path / "features.npz"
    with Harness("featuresink", location=str(path)) as harness:
        harness.push(_frame(2, 1).attach(Features(np.ones((2, 3), np.float32))))
    assert _read(path)["vectors"].shape == (2, 3)


@pytest.mark.parametrize("location", ["", "features.csv", "file/features.npz"])
def test_places_that_cannot_be_written_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, location: str
) -> None:
    """No name, another form and a folder that is not there are errors before the first frame."""
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    with pytest.raises(StreamkitError, match="location"):
        Harness("featuresink", location=location)


def test_parquet_without_its_library_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the extra to install."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ResourceError, match=r"streamkit\[parquet\]"):
        Harness("featuresink", location=str(tmp_path / "features.parquet"))


def test_two_spaces_in_one_file_are_an_error(tmp_path: Path) -> None:
    """The error names the file and both lengths."""
    with Harness("featuresink", location=str(tmp_path / "features.npz")) as harness:
        harness.push(_frame(2, 1).attach(Features(np.ones((2, 3), np.float32))))
        with pytest.raises(StreamkitError, match="got 4 values after 3"):
            harness.push(_frame(2, 2).attach(Features(np.ones((2, 4), np.float32))))
