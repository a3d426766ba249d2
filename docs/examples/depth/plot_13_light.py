"""
When one camera receives less light
===================================

Differences of grey values depend on the light. A census records only which neighbours are darker,
and this does not change. The right photograph has 60 % of its light. The disparities above come
from differences, those below from a census.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

left, right, truth = data.stereo_motorcycle()
dim = (0.6 * right).astype(np.uint8)
known = np.isfinite(truth)

figure, axes = plt.subplots(2, 1, figsize=(4.2, 6))
for ax, cost in zip(axes, ("sad", "census")):
    costs = cvkern.stereo_cost(left, dim, (0, 64), cost=cost, window=9, channel_axis=-1)
    disparity = cvkern.winner_take_all(costs).disparity
    bad = np.mean(np.abs(disparity - truth)[known] > 1)
    ax.imshow(disparity, cmap="inferno", vmin=0, vmax=63)
    print(f"{cost}: {bad:.0%} of the pixels are off by more than one")
    ax.axis("off")
plt.show()
