"""
Gaussian splats
===============

A :class:`~cvkern.radiance.SplatField` has thousands of soft ellipsoids, which are sorted by depth
and drawn one over the other, so that pictures of any size take little time. Viewers of splats read
the file.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

from cvkern.radiance import SplatField, fit, load_splats, make_scene, render, write_splats

scene = make_scene(train=40, test=1, size=64)
held_out = int(scene.test.argmax())

model = fit(scene, SplatField(splats=4096), steps=600, progress=False)

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "solids.ply"
    write_splats(file, model)
    again = load_splats(file, scene.cameras)

large = again.cameras.scaled(6)
view = render(again, large, held_out, background=(1, 1, 1))
image = scene.images[held_out] / 255
shown = (
    ("a held-out photograph", image[..., :3] * image[..., 3:] + 1 - image[..., 3:]),
    ("4096 splats, six times as large", view.color),
    ("their depth", view.depth),
)
figure, panels = plt.subplots(1, 3, figsize=(10, 3.6))
for panel, (title, picture) in zip(panels, shown, strict=True):
    panel.imshow(picture, cmap="magma_r")
    panel.set_title(title)
    panel.axis("off")
plt.show()
