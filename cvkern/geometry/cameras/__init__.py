"""Cameras: the lens, chessboards, calibration and its files, images without lenses, pairs."""
