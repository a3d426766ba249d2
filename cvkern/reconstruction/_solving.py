"""Symmetric equations by Cholesky's method, in blocks that one thread multiplies.

LAPACK shares even small equations among all cores. Where these are busy, or a container has fewer
than it counts, its threads wait for each other: 300 equations were seen to take 2 s, not 1 ms.
Products of blocks of 64 are below the size from which BLAS takes more than one thread. So the
result does not depend on the number of threads either.
"""

from __future__ import annotations

import numpy as np

SIDE = 64  # rows of a block
MANY = 4096  # equations above which threads pay


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Return x with `matrix` (N, N) x = `right` (N,); None if it is not positive definite.

    Only the lower triangle is read.
    """
    from scipy.linalg import LinAlgError, cho_factor, cho_solve

    count = len(matrix)
    if count > MANY:
        try:
            factor = cho_factor(matrix, lower=True, check_finite=False)
        except LinAlgError:
            return None
        return cho_solve(factor, right, check_finite=False)
    number = -(-count // SIDE)
    whole = np.eye(number * SIDE)
    whole[:count, :count] = matrix
    blocks = whole.reshape(number, SIDE, number, SIDE).transpose(0, 2, 1, 3).copy()
    inverses = _factor(blocks)
    if inverses is None:
        return None
    found = np.zeros((number, SIDE))
    found.ravel()[:count] = right
    for k in range(number):
        found[k] = inverses[k] @ found[k]
        found[k + 1 :] -= blocks[k + 1 :, k] @ found[k]
    for k in range(number - 1, -1, -1):
        found[k] = inverses[k].T @ found[k]
        found[:k] -= found[k] @ blocks[k, :k]
    return found.ravel()[:count]


def _factor(blocks: np.ndarray) -> np.ndarray | None:
    """Replace blocks (M, M, S, S) on and below the diagonal by their factor.

    Return the inverses of the blocks on its diagonal, (M, S, S).
    """
    from scipy.linalg import get_lapack_funcs

    potrf, trtri = get_lapack_funcs(("potrf", "trtri"), dtype=np.float64)

    inverses = np.empty(blocks.shape[1:])
    for k in range(len(blocks)):
        factor, failed = potrf(blocks[k, k], lower=1)
        if failed:
            return None
        inverses[k] = trtri(factor, lower=1)[0]
        below = blocks[k + 1 :, k] @ inverses[k].T
        blocks[k + 1 :, k] = below
        for j in range(len(below)):
            blocks[k + 1 + j :, k + 1 + j] -= below[j:] @ below[j].T
    return inverses
