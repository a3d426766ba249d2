"""
A page, straightened
====================

The four corners of a page in a photograph fix a homography. `rectify_plane` samples the page
through it, as if it had been photographed from above.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

page = data.page()
corners = np.array([[20, 40], [5, 350], [185, 380], [170, 10]])  # clockwise from the top left
matrix = cvkern.fit_homography([[0, 0], [0, 383], [190, 383], [190, 0]], corners)
photo = cvkern.warp_perspective(page, matrix, page.shape, order=3, dtype=np.uint8)

straight = cvkern.rectify_plane(photo, corners, page.shape, order=3)
half = cvkern.resize(straight, (96, 192))
print(
    f"mean difference from the page: {np.abs(straight - page)[9:-9, 9:-9].mean():.1f} grey levels"
)

figure, axes = plt.subplots(1, 3, figsize=(10, 1.9), width_ratios=(2, 2, 1))
for ax, image in zip(axes, (photo, straight, half), strict=True):
    ax.imshow(image, cmap="gray")
    ax.axis("off")
axes[0].plot(*np.vstack((corners, corners[:1])).T[::-1], color="tab:orange")
plt.show()
