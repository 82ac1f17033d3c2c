"""What a real robot has and a simulation lacks: motors, sensors, floors and loads that compose."""
