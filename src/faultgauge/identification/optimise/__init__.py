"""What least squares is solved by: Levenberg-Marquardt and its peer, where they start."""
