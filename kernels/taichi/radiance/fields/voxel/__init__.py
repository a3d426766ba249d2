"""The voxel field, in Taichi."""
