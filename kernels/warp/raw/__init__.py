"""Raw pictures, in Warp."""
