"""
Depth from two photographs
==========================

Near objects shift more between the two views than far ones. `stereo_match` finds the shift of every
pixel; the focal length and the distance between the cameras turn it into metres.
"""

import matplotlib.pyplot as plt
from skimage import data

import cvkern

left, right, truth = data.stereo_motorcycle()
found = cvkern.stereo_match(left, right, disparities=(0, 64), channel_axis=-1)
depth = cvkern.disparity_to_depth(found.disparity, focal=994.978, baseline=193.001, doffs=31.086)

# sphinx_gallery_thumbnail_number = 2
plt.figure(figsize=(6, 4))
plt.imshow(left)
plt.axis("off")

plt.figure(figsize=(6, 4))
plt.imshow(depth / 1000, cmap="inferno_r", vmin=2, vmax=5)
plt.axis("off")
plt.colorbar(label="metres", shrink=0.7)
plt.show()
