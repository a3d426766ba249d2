"""
A line is where votes meet
==========================

Each edge point draws a wave in the votes: the angle of the line's normal increases from left to
right, its distance from top to bottom. The brightest spots, marked, are the longest lines.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo = data.camera()
edges = cvkern.canny(photo, 1.5, low_threshold=0.85, high_threshold=0.95, use_quantiles=True)
votes, theta, rho = cvkern.hough_line(edges)
peaks = cvkern.hough_line_peaks(votes, theta, rho, num_peaks=8)

plt.figure(figsize=(6, 4))
extent = (np.degrees(theta[0]), np.degrees(theta[-1]), rho[-1], rho[0])
plt.imshow(np.sqrt(votes), cmap="inferno", aspect="auto", extent=extent)
plt.plot(np.degrees(peaks.theta), peaks.rho, "o", mfc="none", mec="white", ms=11, mew=1.5)
plt.xlabel("angle of the normal, degrees")
plt.ylabel("distance, pixels")
plt.show()
