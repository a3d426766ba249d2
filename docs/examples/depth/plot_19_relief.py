"""
A relief from lamps
===================

Twelve images of one surface, each under another lamp, tell how each pixel is turned, and these
directions add up to depth. Shadows take no part: the default leaves out what does not fit.
"""

import matplotlib.pyplot as plt
import numpy as np

import cvkern

y, x = np.indices((240, 240)) / 40 - 3
away = np.hypot(x, y)
petals = 9 * np.exp(-((away - 1.4) ** 2)) * np.cos(6 * np.arctan2(y, x)) * away**2 / (1 + away**2)
depth = 9 * away - petals + 2 * np.cos(9 * away)
turns = np.arange(12) * np.pi / 6
lights = np.stack([np.cos(turns), np.sin(turns), np.full(12, 0.9)], axis=1)
images = cvkern.lambertian(depth, lights, albedo=0.7, shadows="cast")

found = cvkern.photometric_stereo(images, lights)
relief = cvkern.integrate_normals(found.normals)
relit = cvkern.lambertian(relief, [-0.6, 0.6, 0.5])
print(f"depth is off by {np.std(relief - depth):.2f} of {np.ptp(depth):.0f} pixels")

figure, axes = plt.subplots(1, 3, figsize=(8, 2.8))
axes[0].imshow(images[2], cmap="gray")
axes[1].imshow(found.normals * 0.5 + 0.5)
axes[2].imshow(relit, cmap="gray")
for ax in axes:
    ax.axis("off")
plt.show()
