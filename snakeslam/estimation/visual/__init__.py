"""estimator.mode = visual: ORB odometry on RGB-D frames, without IMU."""
