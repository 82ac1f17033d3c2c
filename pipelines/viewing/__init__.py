"""Recordings as pages for the browser: the scene, its animation, and the numbers beside it."""
