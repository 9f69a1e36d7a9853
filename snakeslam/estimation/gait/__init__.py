"""The gait as a velocity sensor: joints and ground friction give the motion of the head."""
