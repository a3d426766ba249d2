"""
A cloud of your own
===================

`composite_rays` is the last step of a radiance field: it turns densities and colours along rays
into the colours of the rays. Here the field is a formula: two soft balls in front of a white wall.
"""

import matplotlib.pyplot as plt
import numpy as np

from cvkern.radiance import composite_rays

rows, columns, samples = 160, 240, 48
y, x = np.mgrid[-1 : 1 : rows * 1j, -1.5 : 1.5 : columns * 1j].astype(np.float32)
z = np.linspace(-1, 1, samples, dtype=np.float32)

place = np.stack(np.broadcast_arrays(x[..., None], y[..., None], z), axis=-1)
balls = [((-0.45, 0, -0.2), (0.95, 0.45, 0.2)), ((0.4, 0.1, 0.3), (0.2, 0.5, 0.95))]
each = [40 * np.maximum(0, 0.75 - np.linalg.norm(place - np.float32(c), axis=-1)) for c, _ in balls]
density = np.sum(each, axis=0)
color = np.sum([d[..., None] * np.float32(rgb) for d, (_, rgb) in zip(each, balls)], axis=0)
color /= np.maximum(density, 1e-6)[..., None]

distances = np.stack((np.tile(z + 2, rows * columns), np.full(density.size, z[1] - z[0])), axis=1)
spans = np.stack((np.arange(rows * columns) * samples, np.full(rows * columns, samples)), axis=1)
seen = composite_rays(density.ravel() / 8, color.reshape(-1, 3), distances, spans)

plt.figure(figsize=(6, 4))
plt.imshow((seen.color + 1 - seen.opacity[:, None]).reshape(rows, columns, 3).clip(0, 1))
plt.axis("off")
plt.show()
