"""
A camera from photographs of a chessboard
=========================================

Five views of a board, rendered through a lens that bends lines, tell the camera and its lens. Then
`undistort` shows a view as a camera without that lens would have taken it.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import cvkern

shape = 320, 480
lens = cvkern.Camera([[420, 0, 240], [0, 420, 160], [0, 0, 1]], [-0.3, 0.08, 0, 0, 0], shape)
board = np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((30, 30)))
board = np.pad(board, 30, constant_values=1)  # 7 x 10 squares of 30 units, with a white rim
pixels = np.indices(shape).reshape(2, -1).T
rays = np.c_[cvkern.undistort_points(pixels, lens, np.eye(3))[:, ::-1], np.ones(len(pixels))]

views = []
for turn in ((0, 0, 0), (0.6, 0, 0), (-0.6, 0.1, 0.1), (0, 0.6, 0), (0.2, -0.6, -0.1)):
    axes = Rotation.from_rotvec(turn).as_matrix()[:, :2]
    pose = np.c_[axes, (0, 0, 400) - axes @ (179.5, 134.5)]  # from (x, y, 1) of the board
    seen = rays @ np.linalg.inv(pose).T
    places = (seen[:, 1::-1] / seen[:, 2:]).T.reshape(2, *shape)
    view = 200 * cvkern.gaussian(cvkern.remap(board, places, cval=0.5), 0.7) + 20
    views.append(view.astype(np.uint8))

corners = [cvkern.detect_chessboard(view, (6, 9)) for view in views]
found = cvkern.calibrate_camera(cvkern.chessboard_points((6, 9), 30), corners, shape)
print(f"focal length {found.matrix[0, 0]:.1f} of 420, k1 {found.distortion[0]:.3f} of -0.3")

figure, (before, after) = plt.subplots(1, 2, figsize=(9, 3))
before.imshow(views[3], cmap="gray")
before.plot(*corners[3].T[::-1], "o", color="tab:orange", ms=3)
after.imshow(cvkern.undistort(views[3], found.camera), cmap="gray")
_ = before.axis("off"), after.axis("off")
plt.show()
