"""Other programs on the photographs of a survey, for `photographs.py`."""

import importlib
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def scans(paths: list[Path], location: Path) -> tuple[int, float]:
    """How many photographs cv2.Stitcher (SCANS) joins, and the seconds from the files to the mosaic's."""
    began = time.perf_counter()
    stitcher = cv2.Stitcher.create(cv2.Stitcher_SCANS)
    status, mosaic = stitcher.stitch([np.asarray(cv2.imread(str(path)), dtype=np.uint8) for path in paths])
    is_done = status == cv2.Stitcher_OK
    if is_done:
        cv2.imwrite(str(location), mosaic)
    return len(stitcher.component()) if is_done else 0, time.perf_counter() - began


def colmap_cameras(paths: list[Path], focal_px: float, shape: tuple[int, int]) -> FloatArray:
    """The points below COLMAP's cameras on the ground that it finds, float64[n, 2]; NaN where it has none."""
    colmap = importlib.import_module("pycolmap")
    folder = Path(tempfile.mkdtemp())
    (folder / "images").mkdir()
    for path in paths:
        (folder / "images" / path.name).symlink_to(path)
    database, images = str(folder / "database.db"), str(folder / "images")
    reader = colmap.ImageReaderOptions()
    reader.camera_model = "SIMPLE_RADIAL"
    reader.camera_params = f"{focal_px},{shape[1] / 2},{shape[0] / 2},0"
    features = colmap.FeatureExtractionOptions()
    features.sift.max_num_features = 3000
    single = colmap.CameraMode.SINGLE
    colmap.extract_features(
        database, images, camera_mode=single, reader_options=reader, extraction_options=features
    )
    colmap.match_exhaustive(database)
    models = colmap.incremental_mapping(database, images, str(folder)).values()
    model = max(models, key=lambda one: one.num_reg_images())
    cameras = {one.name: one for one in model.images.values() if one.has_pose}
    points = np.array([point.xyz for point in model.points3D.values()])
    points -= np.median(points, axis=0)
    points = points[np.abs(points).max(axis=1) < 6 * np.median(np.abs(points), axis=0).max()]
    axes = np.linalg.svd(points, full_matrices=False)[2]
    ahead = np.mean([one.cam_from_world().matrix()[2, :3] for one in cameras.values()], axis=0)
    up = axes[2] if axes[2] @ ahead < 0 else -axes[2]
    plane = np.stack([axes[0], np.cross(up, axes[0])])
    nowhere = np.full(2, np.nan)
    found = (cameras.get(path.name) for path in paths)
    return np.array([nowhere if one is None else plane @ one.projection_center() for one in found])
