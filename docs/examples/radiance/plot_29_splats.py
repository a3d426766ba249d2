"""
Gaussian splats
===============

A :class:`~cvkern.radiance.SplatField` has thousands of soft ellipsoids, which are sorted by depth
and drawn one over the other, so that pictures of any size take little time.
"""

import matplotlib.pyplot as plt

from cvkern.radiance import SplatField, fit, make_scene, render

scene = make_scene(train=40, test=1, size=64)
held_out = int(scene.test.argmax())

model = fit(scene, SplatField(splats=4096), steps=400, progress=False)
# write_splats("solids.ply", model) writes them for viewers of splats.

view = render(model, scene.cameras.scaled(6), held_out)
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
