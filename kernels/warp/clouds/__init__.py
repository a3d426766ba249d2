"""Pictures of point clouds, in Warp."""
