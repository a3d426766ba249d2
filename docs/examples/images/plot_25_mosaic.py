"""
Colours from a mosaic
=====================

A camera's sensor measures one colour at each pixel. `demosaic` computes the two that are missing:
bilinear means blur edges and give them false colours, and the default follows the edges.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo = data.astronaut()[20:220, 150:350]
raw = cvkern.mosaic(photo, "RGGB")
methods = "bilinear", "malvar", "menon", "residual"
found = {method: cvkern.demosaic(raw, "RGGB", method) for method in methods}
for method, image in found.items():
    error = np.square(image.astype(float) - photo)[8:-8, 8:-8].mean()
    print(f"{method}: {10 * np.log10(255**2 / error):.1f} dB")

figure, axes = plt.subplots(1, 4, figsize=(10, 2.6))
shown = photo, raw, found["bilinear"], found["residual"]
for ax, image, title in zip(axes, shown, ("photograph", "raw", *methods[::3]), strict=True):
    ax.imshow(image[20:90, 60:130], cmap="gray")
    ax.set_title(title)
    ax.axis("off")
plt.show()
