"""From keypoints of an animal to configurations of a robot: the parts of the retarget stage."""
