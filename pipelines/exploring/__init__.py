"""A trained policy in somebody's hands: one robot, live, and the latents that steer it."""
