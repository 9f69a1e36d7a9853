"""Sources of packets that take joint targets: simulator, real robot, replay."""
