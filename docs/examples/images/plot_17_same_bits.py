"""
The same bits from two kernel sets
==================================

Every kernel is written in Warp and again in Taichi. `use` chooses between them; their results do
not differ in a single bit. Here one set computed the left half of the disparities, the other the
right.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

left, right, _ = data.stereo_motorcycle()
found = {}
for backend in ("warp", "taichi"):
    with cvkern.use(backend=backend):
        result = cvkern.stereo_match(left, right, (0, 64), channel_axis=-1)
    found[backend] = result.disparity

different = found["warp"].view(np.int32) != found["taichi"].view(np.int32)
print(f"{different.sum()} of {different.size:,} elements differ")
half = different.shape[1] // 2
joined = np.hstack((found["warp"][:, :half], found["taichi"][:, half:]))

plt.figure(figsize=(6, 4))
plt.imshow(joined, cmap="inferno")
plt.axvline(half, color="white", linewidth=1, linestyle=":")
plt.axis("off")
plt.show()
