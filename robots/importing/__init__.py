"""From a published MJCF or URDF to the two files of a robot."""
