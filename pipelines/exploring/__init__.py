"""One robot, live in the browser, and the latents by which a person steers it."""
