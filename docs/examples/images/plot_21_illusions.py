"""
Equal light that does not look equal
====================================

Two places of each figure, marked below, send the same light to the eye, and look different. In Mach
bands they differ from the even field that they belong to. Cells that inhibit their neighbours
predict contrast, the shadow and the bands, of Cornsweet's fields only the edge, and the opposite of
White's bars.
"""

import matplotlib.pyplot as plt

import cvkern

kinds = ("simultaneous_contrast", "checker_shadow", "cornsweet", "mach_bands", "white")
figure, axes = plt.subplots(3, 5, figsize=(10, 5.6), height_ratios=(1, 1, 0.6))
for (above, middle, below), kind in zip(axes.T, kinds):
    image, lighter, darker = cvkern.illusion(kind, 256)
    seen = cvkern.lateral_inhibition(image, center=2, surround=24)
    above.imshow(image, cmap="gray", vmin=0, vmax=1)
    middle.imshow(seen, cmap="gray")
    middle.contour(lighter, [0.5], colors="tab:orange")
    middle.contour(darker, [0.5], colors="tab:blue")
    row = 107 if kind == "checker_shadow" else 128
    below.plot(image[row], color="0.6")
    below.plot(seen[row], color="black")
    above.set_title(kind.replace("_", " "), fontsize=9)
    difference = seen[lighter].mean() - seen[darker].mean()
    print(f"{kind}: the model answers {difference:+.2f} more where people see lighter")
    for ax in (above, middle):
        ax.axis("off")
figure.tight_layout()
plt.show()
