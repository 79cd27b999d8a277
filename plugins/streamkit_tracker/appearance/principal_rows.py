"""Principal directions of a few long rows, without a library call for each small step."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled

Float32Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

WEAKEST = 1e-6  # of the largest eigenvalue: what is below is rounding
MOST_STEPS = 50
PRECISION = 2.0**-52


@compiled
def principal_rows(rows: Float32Array, basis: Float32Array, singular_values: Float32Array) -> int:
    """Leading right singular vectors of float32[m, p], by the eigenvectors of the small Gram matrix.

    Args:
        rows: float32[m, p], m a few dozen at most.
        basis: float32[k, p], is filled: orthonormal rows, strongest first.
        singular_values: float32[k], is filled.

    Returns:
        How many of the k are filled; what is rounding is left out.
    """
    count = len(rows)
    gram, vectors = np.empty((count, count)), np.empty((count, count))
    for row in range(count):
        for column in range(row + 1):
            gram[row, column] = gram[column, row] = np.dot(rows[row], rows[column])
    values, off_diagonal = np.empty(count), np.zeros(count)
    tridiagonalise(gram, values, off_diagonal, vectors)
    diagonalise(values, off_diagonal, vectors)
    order = np.argsort(values)[::-1]
    least = WEAKEST * max(values[order[0]], 1e-12)
    kept = 0
    while kept < min(len(basis), count) and values[order[kept]] > least:
        singular = math.sqrt(values[order[kept]])
        singular_values[kept] = singular
        direction = basis[kept]
        direction[:] = 0
        for row in range(count):
            weight = np.float32(vectors[order[kept], row] / singular)
            for pixel in range(rows.shape[1]):
                direction[pixel] += weight * rows[row, pixel]
        kept += 1
    return kept


@compiled
def tridiagonalise(
    matrix: FloatArray, diagonal: FloatArray, off_diagonal: FloatArray, vectors: FloatArray
) -> None:
    """Turns a symmetric matrix into a tridiagonal one by reflections.

    Args:
        matrix: float64[n, n], is overwritten.
        diagonal: float64[n], is filled.
        off_diagonal: float64[n], is filled; the last one is 0.
        vectors: float64[n, n], is filled: rows V such that the matrix was V^T T V.

    Source: Golub and Van Loan, Matrix Computations, section 8.3.1 (Householder).
    """
    size = len(matrix)
    normal, product = np.zeros(size), np.zeros(size)
    vectors[:] = np.eye(size)
    off_diagonal[:] = 0.0
    for step in range(size - 2):
        length = math.sqrt(np.sum(matrix[step, step + 1 :] ** 2))
        off_diagonal[step] = -length if matrix[step, step + 1] > 0 else length
        if length > 0.0:
            normal[step + 1 :] = matrix[step, step + 1 :]
            normal[step + 1] -= off_diagonal[step]
            _reflect(matrix, vectors, normal, product, step + 1)
    for row in range(size):
        diagonal[row] = matrix[row, row]
    if size > 1:
        off_diagonal[size - 2] = matrix[size - 2, size - 1]


@compiled
def _reflect(
    matrix: FloatArray, vectors: FloatArray, normal: FloatArray, product: FloatArray, first: int
) -> None:
    """Reflects matrix and vectors at a plane with the normal `normal`, float64[n], from `first` on."""
    size = len(matrix)
    scale = 2.0 / np.sum(normal[first:] ** 2)
    product[first:] = 0.0
    for row in range(first, size):
        weight = scale * normal[row]
        for column in range(first, size):
            product[column] += weight * matrix[row, column]
    inner = 0.5 * scale * np.sum(normal[first:] * product[first:])
    for row in range(first, size):
        product[row] -= inner * normal[row]
    for row in range(first, size):
        for column in range(first, size):
            matrix[row, column] -= normal[row] * product[column] + product[row] * normal[column]
    product[:] = 0.0
    for row in range(first, size):
        for column in range(size):
            product[column] += normal[row] * vectors[row, column]
    for row in range(first, size):
        weight = scale * normal[row]
        for column in range(size):
            vectors[row, column] -= weight * product[column]


@compiled
def diagonalise(diagonal: FloatArray, off_diagonal: FloatArray, vectors: FloatArray) -> None:
    """Turns a tridiagonal matrix into eigenvalues and eigenvectors, by implicit shifts.

    Args:
        diagonal: float64[n], becomes the eigenvalues, in no order.
        off_diagonal: float64[n], is overwritten.
        vectors: float64[n, n], rows, see `tridiagonalise`; become the eigenvectors.

    Source: Golub and Van Loan, Matrix Computations, section 8.3.3; Bowdler, Martin, Reinsch and Wilkinson,
        The QR and QL algorithms for symmetric matrices, 1968.
    """
    size = len(diagonal)
    for low in range(size):
        for _ in range(MOST_STEPS):
            high = low
            while high < size - 1:
                if abs(off_diagonal[high]) <= PRECISION * (abs(diagonal[high]) + abs(diagonal[high + 1])):
                    break
                high += 1
            if high == low:
                break
            _shifted_step(diagonal, off_diagonal, vectors, low, high)


@compiled
def _shifted_step(
    diagonal: FloatArray, off_diagonal: FloatArray, vectors: FloatArray, low: int, high: int
) -> None:
    """One shifted step on the part from low to high."""
    ahead = (diagonal[low + 1] - diagonal[low]) / (2.0 * off_diagonal[low])
    root = math.hypot(ahead, 1.0)
    ahead = diagonal[high] - diagonal[low] + off_diagonal[low] / (ahead + math.copysign(root, ahead))
    sine, cosine, shift = 1.0, 1.0, 0.0
    for row in range(high - 1, low - 1, -1):
        across, along = sine * off_diagonal[row], cosine * off_diagonal[row]
        root = math.sqrt(across * across + ahead * ahead)
        off_diagonal[row + 1] = root
        if root == 0.0:
            diagonal[row + 1] -= shift
            off_diagonal[high] = 0.0
            return
        sine, cosine = across / root, ahead / root
        ahead = diagonal[row + 1] - shift
        root = (diagonal[row] - ahead) * sine + 2.0 * cosine * along
        shift = sine * root
        diagonal[row + 1] = ahead + shift
        ahead = cosine * root - along
        upper, lower = vectors[row], vectors[row + 1]
        for column in range(vectors.shape[1]):
            value = lower[column]
            lower[column] = sine * upper[column] + cosine * value
            upper[column] = cosine * upper[column] - sine * value
    diagonal[low] -= shift
    off_diagonal[low], off_diagonal[high] = ahead, 0.0
