"""What slows the start of a pipeline is not imported before it is needed."""

import subprocess
import sys

LATE = ("scipy.fft", "scipy.linalg", "scipy.optimize", "scipy.sparse", "scipy.special")
TRACKING = "stitch ! framediff ! waveleteigen ! particletrack ! fakesink"
WHOLE = f"appsrc ! decode ! {TRACKING}"
ONE_FRAME = f"videotestsrc num-buffers=1 ! video/x-raw, format=GRAY8, width=640, height=360 ! {TRACKING}"


def late_imports(code: str) -> str:
    """The modules of `LATE` that a process has imported after some code, as a list in Python."""
    found = f"print([name for name in {LATE!r} if name in sys.modules])"
    whole = f"import sys\nfrom streamkit import Pipeline\n{code}\n{found}\n"
    done = subprocess.run(
        [sys.executable, "-c", whole], capture_output=True, text=True, timeout=80, check=True
    )
    return done.stdout.strip()


def test_scipy_is_imported_with_its_first_use() -> None:
    """It would be a third of what building the whole tracking pipeline takes."""
    assert late_imports(f"Pipeline.parse({WHOLE!r})\nassert 'cv2' in sys.modules") == "[]"


def test_the_first_frame_of_a_file_needs_no_scipy() -> None:
    """The tracker imports it with the first frame that has targets, numba with what calls for linear algebra.

    Both together would be a fifth of the start of the whole pipeline.
    """
    code = f"with Pipeline.parse({ONE_FRAME!r}) as pipeline:\n    pipeline.run(timeout_s=60)"
    assert late_imports(code) == "[]"
