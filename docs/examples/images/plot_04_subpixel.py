"""
Edges with sub-pixel positions
==============================

For each edge pixel, `subpixel_edges` gives a point, to a small fraction of a pixel, and the
direction in which the photograph gets brighter there. The picture shows a coin's letters and rim,
enlarged.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo = data.coins()
found = cvkern.subpixel_edges(
    photo, 1.2, low_threshold=0.85, high_threshold=0.93, use_quantiles=True
)
row, column = found.points.T
angle = found.orientation

plt.figure(figsize=(6, 4))
plt.imshow(photo, cmap="gray", interpolation="nearest")
across = {"angles": "xy", "scale_units": "xy", "scale": 0.6, "width": 0.004}
plt.quiver(column, row, np.cos(angle), np.sin(angle), angle, cmap="hsv", **across)
plt.plot(column, row, "o", ms=2.5, color="white", mec="black", mew=0.4)
plt.xlim(326, 377)
plt.ylim(55, 21)
plt.axis("off")
plt.show()
