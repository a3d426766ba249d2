"""
Votes that know their direction
===============================

With its gradient, an edge point votes only for the lines across it. The haze of chance votes
disappears, and the peaks stay. The left picture shows votes at all angles, the right one votes
across the gradient.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo = data.brick()
points, orientation, _ = cvkern.subpixel_edges(
    photo, 2, low_threshold=0.85, high_threshold=0.95, use_quantiles=True
)
given = {"points": points, "shape": photo.shape, "rho_step": 0.5}
every = cvkern.hough_line(**given)
across = cvkern.hough_line(**given, orientation=orientation, orientation_tolerance=np.radians(4))

figure, axes = plt.subplots(1, 2, figsize=(6, 4))
for ax, found in zip(axes, (every, across)):
    ax.imshow(np.sqrt(found.votes), cmap="inferno", aspect="auto", vmax=12)
    ax.axis("off")
plt.show()
