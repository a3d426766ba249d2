"""Pictures of point clouds, in Taichi."""
