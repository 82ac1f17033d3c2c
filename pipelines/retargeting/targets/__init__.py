"""What is asked of the robot: keypoints, contacts, where feet stand."""
