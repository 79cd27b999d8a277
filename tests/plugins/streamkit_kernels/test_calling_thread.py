"""Products in blocks."""

import numpy as np
import pytest

from streamkit_kernels import product


@pytest.mark.parametrize(
    ("left", "right"),
    [((220, 1024), (1024, 18)), ((2, 220, 3), (3, 1024)), ((3, 7, 5), (3, 5, 4)), ((900, 40), (40, 600))],
)
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_blocks_give_the_plain_product(
    left: tuple[int, ...], right: tuple[int, ...], kind: type[np.floating]
):
    """Cutting rows or sums changes the time, not the result, nor its type."""
    generator = np.random.default_rng(0)
    a, b = (generator.standard_normal(shape).astype(kind) for shape in (left, right))
    assert product(a, b).dtype == kind
    np.testing.assert_allclose(product(a, b), a @ b, atol=2e-3)
