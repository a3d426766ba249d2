"""
Spherical harmonics
===================

The colour of a node of a `VoxelField` depends on the viewing direction: it is a sum of these
functions on the sphere. Rows are degrees, columns are orders; blue is negative, red positive.
"""

import matplotlib.pyplot as plt
import numpy as np

from cvkern.images import apply_colormap
from cvkern.radiance import spherical_harmonics

y, x = np.mgrid[1:-1:120j, -1:1:120j]
outside = x**2 + y**2 > 1
front = np.sqrt(np.where(outside, 0, 1 - x**2 - y**2))
values = spherical_harmonics(np.stack((x, -front, y), axis=-1), degree=3)

figure, axes = plt.subplots(4, 7, figsize=(7.2, 4.3))
for ax in axes.flat:
    ax.axis("off")
for degree in range(4):
    for order in range(-degree, degree + 1):
        value = np.where(outside, np.nan, values[..., degree * (degree + 1) + order])
        ball = apply_colormap(value, "diverging", vmin=-1, vmax=1, nan=(255, 255, 255))
        axes[degree, 3 + order].imshow(ball)
plt.show()
