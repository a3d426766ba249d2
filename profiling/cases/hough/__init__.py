"""Cases of Hough transforms."""
