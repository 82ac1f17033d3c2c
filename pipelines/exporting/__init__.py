"""What `lacoloco export` writes: two networks, a description, a model and a controller."""
