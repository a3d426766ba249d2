"""
Changing light and passers-by
=============================

Photographs by many people differ in their light, and somebody stands in the way. ``appearance``
learns a map of colours for each photograph, and ``transient`` what passes in front of it.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from cvkern.radiance import VoxelField, fit, make_scene, render, render_transient

scene = make_scene(train=30, test=1, size=48)
images, rng = scene.images.copy(), np.random.default_rng(0)
for image in images[1:]:
    image[..., :3] = np.clip(rng.uniform(0.8, 1.2, 3) * image[..., :3], 0, 255)
    left = rng.integers(4, 36)
    image[14:40, left : left + 8] = *rng.integers(0, 256, 3), 255
wild = replace(scene, images=images)

field = VoxelField(resolutions=(16, 32), shares=(0.3,), rays=2048)
model = fit(wild, field, steps=500, appearance="affine", transient=True, progress=False)

passing = render_transient(model, 9)
shown = (
    ("a photograph", images[9, ..., :3]),
    ("what passes", 1 - passing.opacity[..., None] * (1 - passing.color)),
    ("what stays", render(model, scene.cameras, 9).color),
    ("in another light", render(model, scene.cameras, 9, appearance=5).color),
)
figure, panels = plt.subplots(1, 4, figsize=(10, 3))
for panel, (title, image) in zip(panels, shown, strict=True):
    panel.imshow(image)
    panel.set_title(title)
    panel.axis("off")
plt.tight_layout()
plt.show()
