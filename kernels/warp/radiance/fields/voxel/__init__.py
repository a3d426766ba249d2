"""The voxel field, in Warp."""
