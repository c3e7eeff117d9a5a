"""Generative models between SLAM maps and CAD maps."""
