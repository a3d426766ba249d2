"""Initial camera from planes by Z. Zhang's closed form, and the poses of planes."""

from __future__ import annotations

import numpy as np

from cvkern.geometry._matrices import nearest_rotations
from cvkern.geometry.cameras.lens import matrix_of
from cvkern.geometry.fitting import fit_homography

LEAST_FOCAL, MOST_FOCAL = 0.2, 50.0  # range of accepted focal lengths, in sides of the image


def plane_map(board: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the homography from board points (N, 2), X and Y, to places (N, 2), x and y."""
    return fit_homography(board[:, ::-1], places[:, ::-1])


def first_camera(maps: list[np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """Return a camera matrix from homographies of planes.

    With the image of the absolute conic, w = K^-T K^-1, the first two columns of a homography meet
    h1' w h2 = 0 and h1' w h1 = h2' w h2. Three or more planes also determine the principal point.
    For fewer planes, or if it falls outside the image, the middle of the image is used.
    """
    height, width = shape
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    size = max(height, width)
    norm = np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]])
    planes = [norm @ h / np.linalg.norm(norm @ h) for h in maps]
    found = _conic(planes, whole=True) if len(planes) >= 3 else None
    if found is None:
        found = _conic(planes, whole=False)
    if found is None:
        found = np.array([1.2, 1.2, 0.0, 0.0])
    return np.linalg.inv(norm) @ matrix_of(*found)


def _conic(planes: list[np.ndarray], *, whole: bool) -> np.ndarray | None:
    """Return fx, fy, cx, cy in sides of the image, or None if they are not plausible."""

    def row(a: np.ndarray, b: np.ndarray) -> list[float]:
        """Coefficients of a' w b in w11, w22, w33, w13, w23."""
        return [a[0] * b[0], a[1] * b[1], a[2] * b[2],
                a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1]]  # fmt: skip

    rows = []
    for h in planes:
        one, two = h[:, 0], h[:, 1]
        rows.append(row(one, two))
        rows.append(np.subtract(row(one, one), row(two, two)))
    equations = np.array(rows)
    if whole:
        w11, w22, w33, w13, w23 = np.linalg.svd(equations)[2][-1]
    else:  # w33 = 1, and no w13, w23
        if np.linalg.matrix_rank(equations[:, :2]) < 2:
            total = equations[:, :2].sum(axis=1)
            if not np.any(total):
                return None
            w11 = w22 = -float(total @ equations[:, 2] / (total @ total))
        else:
            w11, w22 = np.linalg.lstsq(equations[:, :2], -equations[:, 2], rcond=None)[0]
        w33, w13, w23 = 1.0, 0.0, 0.0
    with np.errstate(all="ignore"):
        cx, cy = -w13 / w11, -w23 / w22
        scale = w33 - w11 * cx * cx - w22 * cy * cy
        focal = np.sqrt(np.array([scale / w11, scale / w22]))
    right = bool(((focal > LEAST_FOCAL) & (focal < MOST_FOCAL)).all())  # not for NaN
    if not right or max(abs(cx), abs(cy)) > 0.5:
        return None
    return np.array([*focal, cx, cy])


def plane_pose(matrix: np.ndarray, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation and translation of a plane relative to the camera, X = R W + t."""
    columns = np.linalg.solve(camera, matrix)
    scale = 2 / (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1]))
    columns = columns * (scale if columns[2, 2] > 0 else -scale)
    turn = np.column_stack((columns[:, :2], np.cross(columns[:, 0], columns[:, 1])))
    return nearest_rotations(turn), columns[:, 2]
