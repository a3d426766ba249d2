"""
The same place in two photographs
=================================

SIFT describes points of a photograph, and of a tilted and darker copy of it. Descriptors that are
closest to each other are matches. Some of them are wrong, so the homography is estimated robustly.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo = cvkern.images.luma(data.astronaut()).round().astype(np.uint8)
tilt = [[0.75, -0.35, 190], [0.3, 0.8, -20], [1e-4, -2e-4, 1]]
other = cvkern.warp_perspective(photo, tilt, photo.shape, dtype=np.uint8) // 2

one, two = cvkern.sift(photo, 800), cvkern.sift(other, 800)
pairs = cvkern.match_descriptors(one.descriptors, two.descriptors, max_ratio=0.9)
here, there = one.points[pairs[:, 0]], two.points[pairs[:, 1]]
fit = cvkern.find_homography(here, there, threshold=2)
assert fit.matrix is not None
print(f"{len(pairs)} matches, {fit.inliers.sum()} of them of one plane")
print(f"largest error of the matrix: {np.abs(fit.matrix / fit.matrix[2, 2] - tilt).max():.3f}")

plt.figure(figsize=(9, 4.4))
plt.imshow(np.hstack((photo, other)), cmap="gray")
for (y, x), (v, u), inside in zip(here[::4], there[::4], fit.inliers[::4], strict=True):
    plt.plot([x, u + photo.shape[1]], [y, v], "tab:green" if inside else "tab:red", lw=0.6)
plt.axis("off")
plt.show()
