"""
Edges at four scales
====================

The width of the Gaussian decides what counts as an edge. With thresholds that are quantiles of the
gradient, nothing else has to change from scale to scale.
"""

import matplotlib.pyplot as plt
from skimage import data

import cvkern
from cvkern.images import luma

gray = luma(data.chelsea())

figure, axes = plt.subplots(2, 2, figsize=(6, 4))
for ax, sigma in zip(axes.flat, (1, 2, 3, 5)):
    edges = cvkern.canny(gray, sigma, low_threshold=0.8, high_threshold=0.93, use_quantiles=True)
    ax.imshow(edges, cmap="gray_r", interpolation="antialiased")
    print(f"sigma {sigma}: {edges.sum():,} edge pixels")
    ax.axis("off")
plt.show()
