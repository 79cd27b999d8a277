"""What slows the start of a pipeline is not imported before it is needed."""

import subprocess
import sys

LATE = ("scipy.fft", "scipy.linalg", "scipy.optimize", "scipy.sparse", "scipy.special")
WHOLE = "appsrc ! decode ! stitch ! framediff ! waveleteigen ! particletrack ! fakesink"


def test_scipy_is_imported_with_its_first_use() -> None:
    """It would be a third of what building the whole tracking pipeline takes."""
    code = (
        f"import sys\nfrom streamkit import Pipeline\nPipeline.parse({WHOLE!r})\n"
        f"assert 'cv2' in sys.modules\nprint([name for name in {LATE!r} if name in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=80, check=True
    )
    assert done.stdout.strip() == "[]"
